"""The history of the live tree: the states of the last minute, and the memory that they take."""

import asyncio
import gc
import weakref
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.replay.history import MAX_PINNED, TreeHistory
from gateway.scene.tree.geometry import Part, PointCloud
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.nodes import Node, Path, changes
from gateway.scene.tree.timeline import TimeError, state_at
from renderers.drawlist import Material
from tests.scene.tree.test_merge import Command, execute
from tests.support.waiting import wait_until

SECOND = 1_000_000_000
MIB = 1 << 20

paths = st.lists(st.sampled_from(["a", "b", 1]), min_size=0, max_size=3).map(tuple)
commands = st.lists(
    st.tuples(st.sampled_from(["parts", "pose", "matrix", "visible", "opacity", "delete"]), paths, st.floats(0, 1)),
    max_size=6,
)


class Recorder:
    """A live tree and its history, whose clock is set by the test."""

    def __init__(
        self,
        seconds: float = 60.0,
        max_bytes: int = 256 * MIB,
        to_thread: Callable[[Callable[[], Snapshot]], Awaitable[Snapshot]] = asyncio.to_thread,
    ) -> None:
        self.now = 100 * SECOND
        self.tree = LiveTree(lambda: self.now)
        self.history = TreeHistory(self.tree, seconds, max_bytes, to_thread, lambda: self.now)

    def edit(self, commands: list[Command]) -> Snapshot:
        with self.tree.edit() as edit:
            edit.set_subtree((), execute(edit.root, commands))
        self.history.record()
        return self.tree.snapshot

    def move(self, count: int, value: float) -> Snapshot:
        with self.tree.edit() as edit:
            edit.set_poses([("body", number) for number in range(count)], [(value, 0, 0, 1, 0, 0, 0)] * count)
        self.history.record()
        return self.tree.snapshot

    def cloud(self, points: int) -> weakref.ref[PointCloud]:
        cloud = PointCloud(np.zeros((points, 3), np.float32))
        with self.tree.edit() as edit:
            edit.set_parts(("cloud",), (Part(cloud, Material()),))
        self.history.record()
        return weakref.ref(cloud)

    def at(self, time: int) -> Snapshot:
        return asyncio.run(self.history.snapshot_at(time))


def content(root: Node) -> list[tuple[Path, tuple[Any, ...]]]:
    """Return everything of each node that readers see, in the order of children."""
    return [
        (path, (node.parts, node.matrix.tolist(), node.visible, node.opacity, node.node_count, node.nodes_with_parts))
        for path, node in root.walk()
    ]


def x_of(snapshot: Snapshot) -> float:
    return float(snapshot.root.children["body"].children[0].matrix[0, 3])


@given(st.lists(st.tuples(commands, st.integers(0, SECOND)), max_size=12), st.randoms())
def test_each_recorded_state_is_found_again(steps: list[tuple[list[Command], int]], random: Any) -> None:
    recorder = Recorder()
    recorded = {recorder.now: recorder.tree.snapshot}
    for edits, pause in steps:
        recorder.now += pause
        recorded[recorder.now] = recorder.edit(edits)
    recorder.now += 1
    times = list(recorded)
    random.shuffle(times)
    for time in times:
        found = recorder.at(time)
        assert (found.revision, found.timestamp) == (recorded[time].revision, recorded[time].timestamp)
        assert content(found.root) == content(recorded[time].root)
        assert recorder.at(time + SECOND // 1000).revision >= found.revision


def test_geometry_that_did_not_change_is_the_same_object() -> None:
    recorder = Recorder()
    recorder.cloud(10)
    first = recorder.move(20, 0.0)
    for step in range(1, 5):
        recorder.now += SECOND // 10
        recorder.move(20, step)
    found = recorder.at(recorder.now - SECOND // 10)
    assert {change.kind for change in changes(first.root, found.root)} == {"transform"}
    assert recorder.at(recorder.now - SECOND // 10).root is found.root, "not rebuilt"


def test_a_state_is_kept_though_an_older_one_is_dropped_while_it_is_rebuilt() -> None:
    async def drop_before(rebuild: Callable[[], Snapshot]) -> Snapshot:
        recorder.now += SECOND
        recorder.history.record()
        return rebuild()

    recorder = Recorder(seconds=4.0, to_thread=drop_before)
    for step in range(40):
        recorder.now += SECOND // 10
        recorder.move(1, step)
    first = recorder.history.span[0]
    time = recorder.now - SECOND // 4
    found = recorder.at(time)
    assert recorder.history.span[0] > first
    assert recorder.at(time).root is found.root, "not rebuilt"


def test_times_outside_the_span_are_clamped() -> None:
    recorder = Recorder(seconds=2.0)
    snapshots = []
    for step in range(6):
        recorder.now += SECOND
        snapshots.append(recorder.move(1, step))
    recorder.now += SECOND // 2
    assert recorder.history.span == (recorder.now - 2 * SECOND, recorder.now)
    assert recorder.at(0).revision == snapshots[3].revision, "valid two seconds ago"
    assert recorder.at(recorder.now + SECOND) is snapshots[-1]


def test_held_states_stay() -> None:
    recorder = Recorder(seconds=2.0)
    for step in range(40):
        recorder.now += SECOND // 10
        recorder.move(1, step)
    recorder.now += 1
    first, last = recorder.history.span
    held = recorder.history.held()
    expected = {time: recorder.at(time) for time in range(first, last, SECOND // 10)}
    for step in range(40, 100):
        recorder.now += SECOND // 10
        recorder.move(1, step)
    assert recorder.at(first).revision > recorder.at(last).revision - 25 > expected[first].revision
    assert held.span == held.held().span == (first, last)
    for time, snapshot in expected.items():
        found = asyncio.run(held.snapshot_at(time))
        assert found.revision == snapshot.revision
        assert content(found.root) == content(snapshot.root)
    assert x_of(asyncio.run(held.snapshot_at(last))) == 39


def test_old_states_go_even_if_nothing_changes() -> None:
    recorder = Recorder(seconds=60.0)
    cloud = recorder.cloud(1000)
    recorder.edit([("delete", ("cloud",), 0.0)])
    recorder.now += 59 * SECOND
    recorder.history.record()
    gc.collect()
    assert cloud() is not None
    recorder.now += 2 * SECOND
    recorder.history.record()
    gc.collect()
    assert cloud() is None


def test_deleted_geometry_counts_and_goes_beyond_the_limit() -> None:
    recorder = Recorder(max_bytes=10 * MIB)
    small = recorder.cloud(MIB // 12)
    recorder.now += SECOND // 10
    large = recorder.cloud(20 * MIB // 12)
    assert recorder.history.nbytes > 0.9 * MIB
    recorder.now += SECOND // 10
    recorder.edit([("delete", ("cloud",), 0.0)])
    gc.collect()
    assert (small(), large()) == (None, None)
    assert recorder.history.nbytes < MIB
    assert recorder.history.span[0] == recorder.tree.snapshot.timestamp


def test_the_oldest_states_go_first() -> None:
    recorder = Recorder(max_bytes=4 * MIB)
    for step in range(3000):
        recorder.now += SECOND // 60
        recorder.move(100, step)
        assert recorder.history.nbytes <= 4 * MIB
    first, last = recorder.history.span
    assert 5 < (last - first) / SECOND < 20, "60 Hz × 100 × 60 bytes, and keyframes"
    assert recorder.at(first).root.children["body"].children[0].matrix[0, 3] > 1000


def test_poses_take_a_fraction_of_the_memory_of_nodes() -> None:
    recorder = Recorder()
    for step in range(61):
        recorder.now += SECOND // 60
        recorder.move(1000, step)
    assert recorder.history.nbytes / 60_000 < 80


def test_a_clock_that_is_set_back_begins_another_history() -> None:
    recorder = Recorder()
    recorder.move(1, 1.0)
    recorder.now -= 50 * SECOND
    moved = recorder.move(1, 2.0)
    assert recorder.history.span == (recorder.now, recorder.now)
    assert recorder.at(recorder.now).revision == moved.revision


def test_replaced_subtrees_and_orders_are_found_again() -> None:
    recorder = Recorder()
    names = [("a",), ("b",), ("c",)]
    recorder.edit([("pose", path, 0.5) for path in names])
    states = [recorder.tree.snapshot]
    steps: list[list[Command]] = [
        [("delete", ("a",), 0.0), ("pose", ("a", "x"), 1.0)],  # a is the last child now
        [("delete", (), 0.0), ("parts", (), 1.0)],
        [("delete", (), 0.0), ("pose", ("a",), 1.0)],  # the root has no geometry any more
    ]
    for edits in steps:
        recorder.now += SECOND // 100
        states.append(recorder.edit(edits))
    recorder.now += 1
    for state in states:
        assert content(recorder.at(state.timestamp).root) == content(state.root)


def test_a_thread_records_until_close() -> None:
    tree = LiveTree()
    history = TreeHistory(tree, 60.0, MIB, asyncio.to_thread)
    history.start()
    with tree.edit() as edit:
        edit.set_pose(("a",), (1, 0, 0, 1, 0, 0, 0))
    wait_until(lambda: history.nbytes > 0)
    history.close()
    recorded = history.nbytes
    with tree.edit() as edit:
        edit.delete(("a",))
    assert history.nbytes == recorded


def test_a_pinned_state_is_found_until_nobody_uses_it() -> None:
    recorder = Recorder(seconds=10.0)
    recorder.move(1, 1.0)
    time, snapshot = recorder.now, replace(recorder.at(recorder.now))
    recorder.now += 60 * SECOND
    recorder.move(1, 2.0)
    with pytest.raises(TimeError):
        asyncio.run(state_at(recorder.history, time / 1e9))
    assert recorder.history.pin(time, snapshot)
    assert asyncio.run(state_at(recorder.history, time / 1e9)) is snapshot
    del snapshot
    gc.collect()
    with pytest.raises(TimeError):
        asyncio.run(state_at(recorder.history, time / 1e9))


def test_number_of_pinned_states_is_limited() -> None:
    recorder = Recorder()
    snapshots = [recorder.move(1, float(number)) for number in range(MAX_PINNED + 1)]
    pinned = [recorder.history.pin(number, snapshot) for number, snapshot in enumerate(snapshots)]
    assert pinned == [True] * MAX_PINNED + [False]
    assert recorder.history.pin(0, snapshots[0])
