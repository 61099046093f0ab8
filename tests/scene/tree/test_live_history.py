"""Recent states of the live tree: which one was valid at a time, and how many are kept."""

import numpy as np
import pytest

from gateway.scene.tree import live
from gateway.scene.tree.geometry import Part, PointCloud
from gateway.scene.tree.live import LiveTree
from renderers.drawlist import Material

SECOND = 1_000_000_000


class Tree:
    def __init__(self) -> None:
        self.now = 0
        self.live = LiveTree(lambda: self.now)
        self.live.keep_recent("camera", active=True)

    def move(self, now: int, x: float = 0.0) -> None:
        self.now = now
        with self.live.edit() as edit:
            edit.set_pose(("body",), (x, 0, 0, 1, 0, 0, 0))

    def revisions(self, *times: int) -> list[int]:
        return [self.live.snapshot_at(time).revision for time in times]


def test_a_state_is_valid_until_the_next_one() -> None:
    tree = Tree()
    for now in (100, 200, 300):
        tree.move(now)
    assert tree.revisions(99, 100, 199, 200, 299, 300, 1000) == [0, 1, 1, 2, 2, 3, 3]
    with tree.live.edit():
        pass
    assert tree.live.snapshot.timestamp == 300, "no change, no state"


def test_states_of_one_message_are_valid_together() -> None:
    tree = Tree()
    tree.move(100)
    tree.move(100)
    assert tree.revisions(99, 100) == [0, 2]


def test_a_message_that_arrived_earlier_is_valid_after_those_that_were_applied_before_it() -> None:
    tree = Tree()
    tree.move(200)
    tree.move(150)
    assert tree.revisions(149, 150, 199, 200) == [0, 0, 0, 2]


def test_states_are_kept_for_a_second() -> None:
    tree = Tree()
    for now in range(0, 3 * SECOND, SECOND // 10):
        tree.move(now)
    assert tree.revisions(0, 2 * SECOND) == [19, 21], "older ones are forgotten, the oldest stands for them"
    tree.live.snapshot_at(9 * SECOND)
    assert tree.revisions(0) == [30], "and without further changes, too"


def test_nothing_is_kept_without_a_camera_that_streams() -> None:
    tree = Tree()
    tree.live.keep_recent("other", active=True)
    tree.live.keep_recent("camera", active=False)
    tree.live.keep_recent("camera", active=False)
    tree.move(100)
    assert tree.revisions(0) == [0]
    tree.live.keep_recent("other", active=False)
    assert tree.revisions(0) == [1]
    tree.move(200)
    assert tree.revisions(0) == [2]


def test_a_clock_that_is_set_back_begins_anew() -> None:
    tree = Tree()
    tree.move(9 * SECOND)
    tree.move(SECOND)
    assert tree.live.snapshot.timestamp == SECOND
    assert tree.revisions(0, SECOND, 20 * SECOND) == [2, 2, 2]


def test_the_memory_of_kept_states_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "MAX_KEPT_BYTES", 10_000)
    tree = Tree()
    for now in range(1, 101):
        tree.move(now)
    kept = 101 - tree.revisions(0)[0]
    assert 3 <= kept < 30
    assert tree.revisions(99, 100) == [99, 100]
    with tree.live.edit() as edit:
        edit.set_parts(("cloud",), (Part(PointCloud(np.zeros((1000, 3), np.float32)), Material()),))
    assert tree.revisions(99) == [99], "a state costs what only the state before it needs"
    with tree.live.edit() as edit:
        edit.delete(("cloud",))
    assert tree.revisions(0) == [102], "arrays count, too"


def test_a_large_subtree_is_forgotten_at_once() -> None:
    tree = Tree()
    with tree.live.edit() as edit:
        for number in range(1000):
            edit.set_pose(("many", number), (0, 0, 0, 1, 0, 0, 0))
    with tree.live.edit() as edit:
        edit.delete(("many",))
    assert tree.revisions(-1) == [2]
