"""States of a section of a timeline, which is sampled at a rate."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Final, NamedTuple

from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.timeline import Timeline

MAX_SAMPLES: Final = 200_000
"""Default limit of the number of samples: an hour at 50 Hz."""


class FileTooLargeError(ValueError):
    """A file of the scene, or the number of its samples, is above the limit; the message is one sentence."""


class Sample(NamedTuple):
    """State of the scene at a time."""

    time: int
    """Nanoseconds since the epoch."""
    snapshot: Snapshot
    done: float
    """Fraction of the samples up to this one, 0 to 1."""


async def samples(
    timeline: Timeline, start: int, end: int, rate: float, max_samples: int = MAX_SAMPLES
) -> AsyncIterator[Sample]:
    """Yield the first state with a node, and each further sample with another state; if all are empty, the last one.

    Args:
        start: first time, nanoseconds since the epoch.
        end: last time. It is the time of the last sample, so that the last state is not missed.
        rate: samples per second.

    Raises:
        FileTooLargeError: there are more samples than the limit.
    """
    seconds = (end - start) / 1e9
    count = int(seconds * rate) + 1
    if count > max_samples:
        raise FileTooLargeError(
            f"{seconds:.1f} s at {rate:g} Hz are {count} samples of the scene; the limit is {max_samples}: take a "
            "shorter time, or a lower rate"
        )
    last_revision, is_empty = None, True
    for number in range(count + 1):
        time = min(start + int(number / rate * 1e9), end) if number < count else end
        snapshot = await timeline.snapshot_at(time)
        is_empty = is_empty and not snapshot.root.children and snapshot.root.parts is None
        if snapshot.revision != last_revision and (not is_empty or number == count):
            last_revision = snapshot.revision
            yield Sample(time, snapshot, number / count)
