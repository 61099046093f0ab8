"""Samples of a timeline: each change once, and the last state."""

import pytest

from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.nodes import Node
from gateway.scene.tree.timeline import FileTooLargeError, samples
from tests.adapters.viewer.recordings import SECOND, States

TREE = Node(children={"box": Node()})
STATES = States([Snapshot(TREE, number, round(time * SECOND)) for number, time in enumerate((10, 11, 11.1, 13, 13.9))])


async def sampled(start: float, end: float, rate: float) -> list[tuple[float, int]]:
    section = samples(STATES, round(start * SECOND), round(end * SECOND), rate)
    return [(sample.time / SECOND, sample.snapshot.revision) async for sample in section]


async def test_each_change_and_the_last_state_once() -> None:
    assert await sampled(10, 13.9, 1) == [(10, 0), (11, 1), (12, 2), (13, 3), (13.9, 4)]
    assert await sampled(10, 13.9, 0.5) == [(10, 0), (12, 2), (13.9, 4)]
    assert await sampled(11.5, 12.5, 30) == [(11.5, 2)]
    assert await sampled(11, 11, 30) == [(11, 1)]


async def test_empty_states_at_the_start_are_left_out() -> None:
    trees = (Node(), Node(), TREE, Node())
    states = States([Snapshot(tree, number, (10 + number) * SECOND) for number, tree in enumerate(trees)])
    assert [each.snapshot.revision async for each in samples(states, 10 * SECOND, 14 * SECOND, 1)] == [2, 3]
    assert [each.snapshot.revision async for each in samples(states, 10 * SECOND, 11 * SECOND, 1)] == [1]


async def test_the_fraction_that_is_done_ascends_to_one() -> None:
    done = [sample.done async for sample in samples(STATES, 10 * SECOND, 14 * SECOND, 10)]
    assert done == sorted(done)
    assert done[0] == 0.0
    assert done[-1] <= 1.0


async def test_the_number_of_samples_is_limited() -> None:
    section = samples(STATES, 0, 10 * SECOND, 10, max_samples=100)
    with pytest.raises(FileTooLargeError, match=r"10 Hz .*101 .* 100"):
        await anext(section)
