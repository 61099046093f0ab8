import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from gateway.scene.tree.live import LiveTree, Snapshot


def test_an_edit_that_changes_nothing_is_no_revision() -> None:
    live = LiveTree()
    with live.edit() as edit:
        edit.delete(("nothing", "here"))
    assert live.snapshot.revision == 0


def test_a_failed_edit_leaves_no_trace_and_frees_the_lock() -> None:
    live = LiveTree()
    with live.edit() as edit:
        edit.set_parts(("a",), ())
    kept = live.snapshot

    def fail() -> None:
        with live.edit() as edit:
            edit.set_parts(("b",), ())
            edit.delete(("a",))
            raise RuntimeError("midway")

    with pytest.raises(RuntimeError, match="midway"):
        fail()
    assert live.snapshot is kept
    assert kept.root.find(("a",)) is not None
    assert kept.root.find(("b",)) is None
    with live.edit() as edit:
        edit.set_parts(("c",), ())
    assert live.snapshot.revision == 2


def test_listeners_get_every_revision_in_order_until_they_stop() -> None:
    live = LiveTree()
    heard: list[Snapshot] = []
    stop = live.listen(lambda: heard.append(live.snapshot))
    for index in range(3):
        with live.edit() as edit:
            edit.set_parts((index,), ())
    stop()
    stop()
    with live.edit() as edit:
        edit.set_parts((9,), ())
    assert [snapshot.revision for snapshot in heard] == [1, 2, 3]
    assert heard[2].root.find((2,)) is not None


def test_writers_in_threads_lose_nothing_and_readers_see_whole_batches() -> None:
    live = LiveTree()
    writers, batches = 4, 60
    torn: list[int] = []
    done = threading.Event()

    def write(writer: int) -> None:
        for batch in range(batches):
            with live.edit() as edit:
                for copy in range(3):
                    edit.set_pose((writer, copy), (float(batch), 0, 0, 1, 0, 0, 0))

    def read() -> None:
        while not done.is_set():
            root = live.snapshot.root
            for writer, node in root.children.items():
                poses = {child.pose for child in node.children.values()}
                if len(poses) != 1 or len(node.children) != 3:
                    torn.append(int(writer))

    heard: list[Snapshot] = []
    live.listen(lambda: heard.append(live.snapshot))
    with ThreadPoolExecutor(writers + 1) as pool:
        reader = pool.submit(read)
        try:
            for future in [pool.submit(write, writer) for writer in range(writers)]:
                future.result()
        finally:
            done.set()
        reader.result()
    assert torn == []
    assert live.snapshot.revision == writers * batches
    assert [snapshot.revision for snapshot in heard] == list(range(1, writers * batches + 1))
    last = [child.pose for node in live.snapshot.root.children.values() for child in node.children.values()]
    assert last == [(float(batches - 1), 0, 0, 1, 0, 0, 0)] * (3 * writers)


def test_a_state_of_another_tree() -> None:
    """It replaces the latest state with its revision; edits go on from there."""
    other, tree = LiveTree(), LiveTree()
    for name in "abc":
        with other.edit() as edit:
            edit.set_visible((name,), True)
    heard: list[Snapshot] = []
    tree.listen(lambda: heard.append(tree.snapshot))
    tree.replace(other.snapshot)
    assert heard == [other.snapshot] == [tree.snapshot]
    with tree.edit() as edit:
        edit.delete(("a",))
    assert (tree.snapshot.revision, set(tree.snapshot.root.children)) == (4, {"b", "c"})
