"""States of a tree over time: the history of the live tree, or a log."""

from __future__ import annotations

from collections.abc import AsyncIterator
from datetime import UTC, datetime
from math import copysign
from typing import Final, NamedTuple, Protocol

from gateway.scene.tree.live import Snapshot

FIRST_STEP_NS: Final = 1_000_000
"""Time after which the next change is first looked for. It is doubled until there is one."""
MAX_SECONDS: Final = 1e10
"""Maximum of a time that a client names, either sign."""
MAX_SAMPLES: Final = 200_000
"""Default limit of the number of samples: an hour at 50 Hz."""
TIME_DESCRIPTION: Final = (
    "Time of the scene: seconds since the epoch, or before now if negative, as far as --history-seconds goes back."
)
"""Description for OpenAPI."""


class Timeline(Protocol):
    """States of the tree over time. Times are nanoseconds since the epoch."""

    @property
    def span(self) -> tuple[int, int]:
        """First and last time that have a state. Those of a live tree advance."""

    async def snapshot_at(self, timestamp: int) -> Snapshot:
        """Return the state that was valid at a time; times outside the span are clamped.

        A call with a time at which the same state was valid returns a snapshot of the same revision.
        """

    def simulation_seconds_at(self, time: int) -> float | None:
        """Return the time of the simulation, seconds, at a time of the timeline; None if it is not known."""
        return None

    def pin(self, time: int, snapshot: Snapshot) -> bool:
        """Keep the state of a time for ``pinned_at`` while the snapshot is used; False: there are too many."""
        return True

    def pinned_at(self, time: int) -> Snapshot | None:
        """Return a pinned state although the span has passed it, or None."""
        return None

    def held(self) -> Timeline:
        """Return the states of the present span, which stay as long as the result is used."""
        return self


class TimeError(ValueError):
    """A time has no state. The message has the time and the span."""


class FileTooLargeError(ValueError):
    """A file of the scene, or the number of its samples, is above the limit; the message is one sentence."""


class TimedSnapshot(NamedTuple):
    """State of the scene at a time."""

    time: int
    """Nanoseconds since the epoch."""
    snapshot: Snapshot
    done: float
    """Fraction of the samples up to this one, 0 to 1."""


async def next_state(timeline: Timeline, snapshot: Snapshot, steps: int) -> Snapshot:
    """Return the state that came a number of changes after another one, or before it if negative; the last or first one
    if there are fewer.
    """
    first, last = timeline.span
    for _ in range(-steps):
        snapshot = await timeline.snapshot_at(max(first, snapshot.timestamp - 1))
    for _ in range(steps):
        snapshot = await _state_after(timeline, snapshot, max(first, snapshot.timestamp), last)
    return snapshot


async def _state_after(timeline: Timeline, snapshot: Snapshot, start: int, last: int) -> Snapshot:
    """Return the state after the first change between ``start`` and ``last``; ``snapshot`` if there is none."""
    later, step = snapshot, FIRST_STEP_NS
    while later.revision == snapshot.revision and start + step // 2 < last:
        later = await timeline.snapshot_at(min(start + step, last))
        step *= 2
    next_one = snapshot
    while later.revision != snapshot.revision:  # there may be another one before it
        next_one = later
        if later.timestamp <= start:
            break
        later = await timeline.snapshot_at(later.timestamp - 1)
    return next_one


async def state_at(timeline: Timeline | None, seconds: float) -> Snapshot:
    """Return the state at a time that a client names. Raises TimeError if there is none; None: none are kept.

    ``seconds``: since the epoch; if negative, or -0, before the end of the span.
    """
    if timeline is None:
        raise TimeError(f"time={seconds:g}: this gateway keeps no history (--history-seconds 0)")
    first, last = timeline.span
    time = round(seconds * 1e9) + (last if copysign(1.0, seconds) < 0 else 0)
    if not first <= time <= last:
        if (snapshot := timeline.pinned_at(time)) is not None:
            return snapshot
        raise TimeError(
            f"time={seconds:.15g} is {_text(time)}; the history has {_text(first)} to {_text(last)}, "
            f"the last {(last - first) / 1e9:.1f} seconds"
        )
    return await timeline.snapshot_at(time)


async def samples(
    timeline: Timeline, start: int, end: int, rate: float, max_samples: int = MAX_SAMPLES
) -> AsyncIterator[TimedSnapshot]:
    """Yield the first state with a node, and each further sample with another state; if all are empty, the last one.

    The last sample is at ``end``, so that the last state is not missed. ``rate``: samples per second. Raises
    FileTooLargeError if there are more samples than the limit.
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
            yield TimedSnapshot(time, snapshot, number / count)


def _text(time: int) -> str:
    """Return a time in nanoseconds since the epoch as seconds, with the time of day, UTC."""
    return f"{time / 1e9:.3f}" + (f" ({datetime.fromtimestamp(time / 1e9, UTC):%H:%M:%S} UTC)" if time >= 0 else "")
