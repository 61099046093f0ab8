"""Merging two edits of one tree."""

from typing import Any

from hypothesis import assume, given
from hypothesis import strategies as st

from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree, Snapshot, merged
from gateway.scene.tree.nodes import Node, Path, TreeEdit
from renderers.drawlist import Material
from scenegate.messages.geometry import Box

BOX = Part(Box((1.0, 1.0, 1.0)), Material())

Command = tuple[str, Path, float]

paths = st.lists(st.sampled_from(["a", "b", "c"]), min_size=1, max_size=3).map(tuple)
commands = st.lists(
    st.tuples(st.sampled_from(["parts", "pose", "matrix", "visible", "opacity", "delete"]), paths, st.floats(0, 1)),
    max_size=8,
)


def execute(root: Node, commands: list[Command]) -> Node:
    edit = TreeEdit(root)
    for command, path, value in commands:
        match command:
            case "parts":
                edit.set_parts(path, (BOX,) * round(3 * value))
            case "pose":
                edit.set_pose(path, (value, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
            case "matrix":
                edit.set_matrix(path, Node().matrix * value)
            case "visible":
                edit.set_visible(path, value < 0.5)
            case "opacity":
                edit.set_opacity(path, value)
            case _:
                edit.delete(path)
    return edit.commit()


def content(root: Node) -> dict[Path, tuple[Any, ...]]:
    return {
        path: (node.parts, node.matrix.tolist(), node.visible, node.opacity, node.node_count, node.nodes_with_parts)
        for path, node in root.walk()
    }


@given(commands, commands, commands)
def test_edits_of_different_paths_give_the_same_tree_as_one_after_the_other(
    before: list[Command], ours: list[Command], theirs: list[Command]
) -> None:
    for _, path, _ in ours:
        assume(all(path[: len(other)] != other and other[: len(path)] != path for _, other, _ in theirs))
    base = execute(Node(), before)
    both = merged(base, execute(base, ours), execute(base, theirs))
    assert content(both) == content(execute(execute(base, theirs), ours))


def test_ours_is_kept_where_both_changed_the_same_property() -> None:
    base = execute(Node(), [("parts", ("a",), 1.0), ("parts", ("b", "c"), 1.0)])
    ours = execute(base, [("opacity", ("a",), 0.25), ("delete", ("b",), 0.0)])
    theirs = execute(base, [("opacity", ("a",), 0.75), ("visible", ("a",), 1.0), ("opacity", ("b", "c"), 0.5)])
    both = merged(base, ours, theirs)
    assert list(both.children) == ["a"]
    assert (both.children["a"].opacity, both.children["a"].visible) == (0.25, False)


def test_what_they_deleted_comes_back_only_as_far_as_we_set_it() -> None:
    base = execute(Node(), [("parts", ("a",), 1.0), ("parts", ("a", "b"), 1.0), ("parts", ("a", "c"), 1.0)])
    both = merged(base, execute(base, [("opacity", ("a", "b"), 0.5)]), execute(base, [("delete", ("a",), 0.0)]))
    assert {path: (node.parts, node.opacity) for path, node in both.walk()} == {
        (): (None, 1.0),
        ("a",): (None, 1.0),
        ("a", "b"): (None, 0.5),
    }


def test_an_edit_is_published_as_one_revision_with_what_others_have_changed_since() -> None:
    live = LiveTree()
    revisions: list[Snapshot] = []
    live.listen(lambda: revisions.append(live.snapshot))
    edit = TreeEdit(live.snapshot.root)
    for number in range(3):
        edit.set_parts(("ours", number), (BOX,))
        with live.edit() as other:
            other.set_parts(("theirs", number), (BOX,))
    live.publish(edit)
    assert [snapshot.root.node_count for snapshot in revisions] == [3, 4, 5, 9]
    assert revisions[-1].revision == 4


def test_an_edit_without_changes_is_no_revision() -> None:
    live = LiveTree()
    live.publish(TreeEdit(live.snapshot.root))
    assert live.snapshot.revision == 0
