"""Time of a log's events on the time bar: that of the recorder's clock, as long as that clock is not set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

SECOND_US: Final = 1_000_000
MAX_BACK_US: Final = SECOND_US
"""Maximum step back that is no set clock. Recorders with threads write messages in another order than they arrived."""
MAX_STEP_US: Final = 3600 * SECOND_US
"""Maximum time between two events. With a clock that is set from 1970 to now, the bar would have decades."""
SET_STEP_US: Final = SECOND_US
"""Time between two events on the bar if the clock was set between them."""
MAX_START_US: Final = 1 << 52
"""Limit of the first event's time, in the year 2112. A log with a later one begins at 0."""


@dataclass(frozen=True, slots=True)
class LogClock:
    """Time of an event on the time bar. It never decreases from one event to the next."""

    time_us: int = -1
    """Microseconds since the epoch; -1 before the first event."""
    shift_us: int = 0
    """Difference from the time of the recorder's clock."""
    sets: int = 0
    """Number of times that the recorder's clock was set so far."""

    def after(self, recorded_us: int) -> LogClock:
        """Return the time of the next event, given its time in the log."""
        if self.time_us < 0:
            start = recorded_us if 0 <= recorded_us < MAX_START_US else 0
            return LogClock(start, start - recorded_us)
        step = recorded_us + self.shift_us - self.time_us
        if -MAX_BACK_US <= step <= MAX_STEP_US:
            return LogClock(self.time_us + max(step, 0), self.shift_us, self.sets)
        time_us = self.time_us + SET_STEP_US
        return LogClock(time_us, time_us - recorded_us, self.sets + 1)

    @property
    def time_ns(self) -> int:
        """The time in nanoseconds."""
        return 1000 * self.time_us
