"""Timestamps of frames: from the system clock, or simulated; and as text."""

from __future__ import annotations

import time
from typing import Protocol

NANOSECONDS_PER_SECOND = 1_000_000_000


class Clock(Protocol):
    """Source of frame timestamps."""

    @property
    def simulated(self) -> bool:
        """True if timestamps count frames instead of time; then no frame may be skipped for lack of time."""

    def next_timestamp(self, previous: int | None, period: int, age: int = 0) -> int:
        """Return the timestamp of a frame, nanoseconds since the epoch.

        Args:
            previous: timestamp of the previous frame; None for the first.
            period: nanoseconds between frames at the current rate.
            age: nanoseconds that have passed since the middle of the frame's exposure.
        """


class SystemClock:
    """Timestamps from the system clock."""

    simulated = False

    def next_timestamp(self, previous: int | None, period: int, age: int = 0) -> int:
        now = time.time_ns() - age
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

    def next_timestamp(self, previous: int | None, period: int, age: int = 0) -> int:
        return self._start if previous is None else previous + period


def parse_timestamp(timestamp: str) -> int:
    """Return the nanoseconds of ``1700000000.040000000``, exactly.

    The digits after the point are nanoseconds, padded on the right.

    Raises:
        ValueError: malformed timestamp.
    """
    seconds, _, fraction = timestamp.partition(".")
    digits = seconds + fraction
    if not (digits.isascii() and digits.isdigit() and seconds and len(seconds) <= 12 and len(fraction) <= 9):
        raise ValueError(f"timestamp {timestamp[:40]!r} is not like 1700000000.040000000")
    return int(seconds) * NANOSECONDS_PER_SECOND + int(fraction.ljust(9, "0"))


def timestamp_text(nanoseconds: int) -> str:
    """Return a timestamp as text; the inverse of ``parse_timestamp``."""
    return f"{nanoseconds // NANOSECONDS_PER_SECOND}.{nanoseconds % NANOSECONDS_PER_SECOND:09d}"
