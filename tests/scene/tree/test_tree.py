from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, Path, TreeEdit, changes
from renderers.drawlist import Material
from scenegate.messages.geometry import Box

BOX = Part(Box((1.0, 1.0, 1.0)), Material())

Model = dict[Path, dict[str, Any]]
"""Path to {"parts", "pose", "visible", "opacity"}: the tree as the dullest possible data structure."""

paths = st.lists(st.sampled_from(["a", "b", 1, "1", "a/b"]), max_size=4).map(tuple)
poses = st.tuples(*[st.floats(-9, 9)] * 3, st.just(1.0), *[st.floats(-1, 1)] * 3)


def blank() -> dict[str, Any]:
    return {"parts": None, "pose": None, "visible": True, "opacity": 1.0}


def properties(node: Node) -> dict[str, Any]:
    return {"parts": node.parts, "pose": node.pose, "visible": node.visible, "opacity": node.opacity}


def as_model(root: Node) -> Model:
    return {path: properties(node) for path, node in root.walk()}


def touch(model: Model, path: Path) -> dict[str, Any]:
    for end in range(len(path) + 1):
        model.setdefault(path[:end], blank())
    return model[path]


def replay(old: Node, new: Node) -> Model:
    """The old tree brought up to date by nothing but the reported changes."""
    model = as_model(old)
    for change in changes(old, new):
        if change.kind == "removed":
            for path in [p for p in model if p[: len(change.path)] == change.path]:
                del model[path]
            continue
        assert change.node is not None
        if change.kind == "reordered":
            continue
        now = properties(change.node)
        if change.kind == "added":
            assert change.path not in model
            assert change.path[:-1] in model
            model[change.path] = now
        else:
            field = {"geometry": "parts", "transform": "pose"}.get(change.kind, change.kind)
            model[change.path][field] = now[field]
    return model


class TreeMachine(RuleBasedStateMachine):
    """Random batches of edits on the persistent tree and on a plain dict side by side."""

    @initialize()
    def start(self) -> None:
        self.root = Node()
        self.model: Model = {(): blank()}
        self.history: list[tuple[Node, Model]] = []
        self.edit = TreeEdit(self.root)

    @rule()
    def commit(self) -> None:
        self.history.append((self.root, as_model(self.root)))
        self.root = self.edit.commit()
        self.edit = TreeEdit(self.root)

    @rule(path=paths, count=st.integers(0, 2))
    def set_parts(self, path: Path, count: int) -> None:
        parts = (BOX,) * count
        self.edit.set_parts(path, parts)
        touch(self.model, path)["parts"] = parts

    @rule(path=paths, pose=poses)
    def set_pose(self, path: Path, pose: Any) -> None:
        self.edit.set_pose(path, pose)
        touch(self.model, path)["pose"] = pose

    @rule(path=paths)
    def set_matrix(self, path: Path) -> None:
        self.edit.set_matrix(path, tf.translation(1, 2, 3))
        touch(self.model, path)["pose"] = None

    @rule(path=paths, visible=st.booleans())
    def set_visible(self, path: Path, visible: bool) -> None:
        self.edit.set_visible(path, visible)
        touch(self.model, path)["visible"] = visible

    @rule(path=paths, opacity=st.sampled_from([0.0, 0.5, 1.0]))
    def set_opacity(self, path: Path, opacity: float) -> None:
        self.edit.set_opacity(path, opacity)
        touch(self.model, path)["opacity"] = opacity

    @rule(path=paths)
    def delete(self, path: Path) -> None:
        if path:
            existed = path in self.model
        else:
            existed = len(self.model) > 1 or self.model[()]["parts"] is not None
        assert self.edit.delete(path) == existed
        for gone in [p for p in self.model if p[: len(path)] == path]:
            del self.model[gone]
        if not path:
            self.model[()] = blank()

    @rule(path=paths, count=st.integers(0, 2))
    def set_subtree(self, path: Path, count: int) -> None:
        inner = TreeEdit(Node())
        for index in range(count):
            inner.set_parts(("sub", index), (BOX,))
        subtree = inner.commit()
        self.edit.set_subtree(path, subtree)
        if path:
            touch(self.model, path[:-1])
        for gone in [p for p in self.model if p[: len(path)] == path]:
            del self.model[gone]
        self.model.update({(*path, *below): values for below, values in as_model(subtree).items()})

    @invariant()
    def the_tree_is_the_model(self) -> None:
        assert as_model(self.edit.root) == self.model

    @invariant()
    def counts_are_exact(self) -> None:
        for path, node in self.edit.root.walk():
            below = [values for p, values in self.model.items() if p[: len(path)] == path]
            assert node.nodes_with_parts == sum(values["parts"] is not None for values in below)
            assert node.node_count == len(below)

    @invariant()
    def snapshots_are_unaffected_and_changes_replay_them_into_the_present(self) -> None:
        for old, model in self.history[-3:]:
            assert as_model(old) == model
            assert replay(old, self.root) == as_model(self.root)


TreeMachine.TestCase.settings = settings(deadline=None, max_examples=60, stateful_step_count=25)
test_the_persistent_tree_against_a_dict = TreeMachine.TestCase


def order_after(old: Node, new: Node, path: Path = ()) -> list[str | int]:
    """Return the children's names in the order that the changes lead to: added and reordered ones come last."""
    node = old.find(path)
    names = [] if node is None else list(node.children)
    for change in changes(old, new):
        if change.path[:-1] == path and change.path and change.kind in ("added", "removed", "reordered"):
            names = [name for name in names if name != change.path[-1]]
            if change.kind != "removed":
                names.append(change.path[-1])
    return names


@pytest.mark.parametrize("names", ["", "abc", "cba", "bac", "axbc", "xcab", "a", "cb", "abcx", "xy"])
def test_changes_tell_the_order_of_siblings(names: str) -> None:
    shared: dict[str | int, Node] = {name: Node() for name in "abc"}
    old, new = Node(children=dict(shared)), Node(children={name: shared.get(name, Node()) for name in names})
    assert order_after(old, new) == list(names)
    reordered = [change.path for change in changes(old, new) if change.kind == "reordered"]
    assert not (names in ("abc", "a", "abcx") and reordered), "nothing moved"


def test_untouched_siblings_are_shared_between_revisions() -> None:
    first = TreeEdit(Node())
    first.set_parts(("a", "x"), (BOX,))
    first.set_parts(("b", "y"), (BOX,))
    old = first.commit()
    second = TreeEdit(old)
    second.set_pose(("a", "x"), (1, 0, 0, 1, 0, 0, 0))
    new = second.commit()
    assert new.find(("b",)) is old.find(("b",))
    assert new.find(("a",)) is not old.find(("a",))
    assert [(c.kind, c.path) for c in changes(old, new)] == [("transform", ("a", "x"))]


def test_deep_paths_do_not_recurse() -> None:
    path = tuple(range(5000))
    edit = TreeEdit(Node())
    edit.set_parts(path, (BOX,))
    root = edit.commit()
    assert root.nodes_with_parts == 1
    assert sum(1 for _ in root.walk()) == root.node_count == 5001
    assert sum(1 for _ in changes(Node(), root)) == 5000


def test_a_committed_edit_cannot_be_used_again() -> None:
    edit = TreeEdit(Node())
    edit.set_parts(("a",), ())
    edit.commit()
    for method, *arguments in (
        (edit.set_parts, ("b",), ()), (edit.delete, ("a",)), (edit.delete, ()), (edit.set_subtree, (), Node()),
    ):  # fmt: skip
        with pytest.raises(RuntimeError, match="committed"):
            method(*arguments)


def test_a_pose_becomes_a_matrix_on_first_use_and_keeps_it() -> None:
    edit = TreeEdit(Node())
    edit.set_pose(("a",), (1, 2, 3, 1, 0, 0, 0))
    node = edit.commit().find(("a",))
    np.testing.assert_array_equal(node.matrix, tf.translation(1, 2, 3))
    assert node.matrix is node.matrix


def test_many_poses_are_set_as_one_after_the_other() -> None:
    paths: list[Path] = [("a", "x"), ("a", "y"), ("a",), ("b", "x", "z"), ("b", "x"), ("a", "x")]
    poses = [(float(index), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) for index in range(len(paths))]
    before = TreeEdit(Node())
    before.set_pose(("a", "y"), poses[0])
    root = before.commit()
    one, many = TreeEdit(root), TreeEdit(root)
    for path, pose in zip(paths, poses, strict=True):
        one.set_pose(path, pose)
    nodes = many.set_poses(paths, poses)
    expected, found = one.commit(), many.commit()
    assert [(path, node.pose, node.node_count) for path, node in found.walk()] == [
        (path, node.pose, node.node_count) for path, node in expected.walk()
    ]
    assert nodes == [found.find(path) for path in paths]
    assert root.find(("a", "y")) is not found.find(("a", "y")), "the committed tree is unchanged"
