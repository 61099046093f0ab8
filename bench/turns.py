"""Measure contestants in turns within one run, so that a change of the machine's speed hits all of them."""

import random
import statistics
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

WARM = 3
"""Calls of each contestant that are made first and not counted."""
TURN = 10
"""Calls of one contestant in a row: only the first of them finds the caches as another contestant left them."""


class Time(NamedTuple):
    """Milliseconds of one call."""

    wall: float
    cpu: float
    """CPU time of all threads of the process that did the work."""


def timed(call: Callable[[], object]) -> Time:
    """Call and measure in this process."""
    wall, cpu = time.perf_counter(), time.process_time()
    call()
    return Time(1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu))


def in_turns(
    contestants: Mapping[str, Callable[[int], Time]], count: int, *, warm: int = WARM, turn: int = TURN
) -> dict[str, list[Time]]:
    """Call each contestant ``warm + count`` times or more, in turns of random order; return the times after ``warm``.

    Args:
        contestants: by name; called with the number of the call, return its time (``timed``, or a peer's own figure).
    """
    chance = random.Random(0)
    times: dict[str, list[Time]] = {name: [] for name in contestants}
    for first in range(0, warm + count, turn):
        for name in chance.sample(list(contestants), len(contestants)):
            times[name] += [contestants[name](number) for number in range(first, first + turn)]
    return {name: values[warm:] for name, values in times.items()}


def median(times: list[Time]) -> Time:
    """Return the medians of wall and CPU time."""
    return Time(statistics.median(each.wall for each in times), statistics.median(each.cpu for each in times))
