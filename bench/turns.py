"""Measures several programs in turns, so that all of them see the same load of the machine."""

from __future__ import annotations

import random
import statistics
from collections.abc import Callable, Mapping

WARM = 3
"""Frames before the measurement."""
TURN = 10
"""Consecutive frames of one program. What other programs leave in the CPU's caches costs the first frame of a turn,
which hardly changes the median."""


def in_turns(calls: Mapping[str, Callable[[int], tuple[float, float]]], frames: int) -> dict[str, tuple[float, float]]:
    """Return the median wall and CPU time of each program; turns are in random order.

    Args:
        calls: functions that render the frame with a number and return its wall and CPU time.
        frames: minimum number of measured frames of each program.
    """
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    order = list(calls)
    for first in range(0, frames + WARM, TURN):
        random.shuffle(order)
        for name in order:
            times[name] += [calls[name](frame) for frame in range(first, first + TURN)]
    return {
        name: (statistics.median(t[0] for t in values[WARM:]), statistics.median(t[1] for t in values[WARM:]))
        for name, values in times.items()
    }
