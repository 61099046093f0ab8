"""Timestamps of frames: from the system clock, or simulated."""

from __future__ import annotations

import time
from typing import Protocol

NANOSECONDS_PER_SECOND = 1_000_000_000


class Clock(Protocol):
    """Source of frame timestamps."""

    @property
    def simulated(self) -> bool:
        """True if timestamps count frames instead of time; then no frame may be skipped for lack of time."""

    def next_timestamp(self, previous: int | None, period: int) -> int:
        """Return the timestamp of a frame, nanoseconds since the epoch.

        Args:
            previous: timestamp of the previous frame; None for the first.
            period: nanoseconds between frames at the current rate.
        """


class SystemClock:
    """Timestamps from the system clock."""

    simulated = False

    def next_timestamp(self, previous: int | None, period: int) -> int:
        now = time.time_ns()
        # Timestamps identify frames: they stay unique when the system clock is set back by up to a second.
        return now if previous is None or not previous - NANOSECONDS_PER_SECOND < now <= previous else previous + 1


class SimulatedClock:
    """Timestamps that advance by one period with every frame."""

    simulated = True

    def __init__(self, start: int = NANOSECONDS_PER_SECOND) -> None:
        """
        Args:
            start: timestamp of the first frame, nanoseconds since the epoch.
        """
        self._start = start

    def next_timestamp(self, previous: int | None, period: int) -> int:
        return self._start if previous is None else previous + period
