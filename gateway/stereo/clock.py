"""Which timestamp a frame carries. How fast frames come is not decided here."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Gives the timestamps of frames."""

    @property
    def simulated(self) -> bool:
        """Whether timestamps depend on the frames alone; then no frame may be skipped for lack of time."""

    def stamp(self, previous: int | None, period: int) -> int:
        """Timestamp of a frame, nanoseconds since the epoch.

        Args:
            previous: that of the frame before; None: it is the first.
            period: nanoseconds between frames at the present rate.
        """


class SystemClock:
    """The computer's time."""

    simulated = False

    def stamp(self, previous: int | None, period: int) -> int:
        now = time.time_ns()
        # Timestamps identify frames: never twice the same, even when the clock is set back a little.
        return now if previous is None or not previous - 1_000_000_000 < now <= previous else previous + 1


class SimulatedClock:
    """Advances by one period with every frame, from a fixed start."""

    simulated = True

    def __init__(self, start: int = 1_000_000_000) -> None:
        """
        Args:
            start: timestamp of the first frame, nanoseconds.
        """
        self._start = start

    def stamp(self, previous: int | None, period: int) -> int:
        return self._start if previous is None else previous + period
