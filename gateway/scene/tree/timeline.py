"""States of a tree over time: the history of the live tree, or a log."""

from __future__ import annotations

from datetime import UTC, datetime
from math import copysign
from typing import Final, Protocol

from gateway.scene.tree.live import Snapshot

FIRST_STEP_NS: Final = 1_000_000
"""Time after which the next change is first looked for. It is doubled until there is one."""
MAX_SECONDS: Final = 1e10
"""Maximum of a time that a client names, either sign."""
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

    def held(self) -> Timeline:
        """Return the states of the present span, which stay as long as the result is used."""


class TimeError(ValueError):
    """A time has no state. The message has the time and the span."""


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
    """Return the state at a time that a client names.

    Args:
        timeline: None: no states are kept.
        seconds: seconds since the epoch; if negative, or -0, before the end of the span.

    Raises:
        TimeError: there is no state of this time.
    """
    if timeline is None:
        raise TimeError(f"time={seconds:g}: this gateway keeps no history (--history-seconds 0)")
    first, last = timeline.span
    time = round(seconds * 1e9) + (last if copysign(1.0, seconds) < 0 else 0)
    if not first <= time <= last:
        raise TimeError(
            f"time={seconds:.15g} is {_text(time)}; the history has {_text(first)} to {_text(last)}, "
            f"the last {(last - first) / 1e9:.1f} seconds"
        )
    return await timeline.snapshot_at(time)


def _text(time: int) -> str:
    """Return a time in nanoseconds since the epoch as seconds, with the time of day, UTC."""
    return f"{time / 1e9:.3f}" + (f" ({datetime.fromtimestamp(time / 1e9, UTC):%H:%M:%S} UTC)" if time >= 0 else "")
