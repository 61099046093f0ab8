"""Due times and timestamps of camera and depth frames: computation only, no waiting."""

from __future__ import annotations

import math
import time
from typing import Final

from gateway.stereo.device.camera_config import Rate
from gateway.stereo.device.stream_settings import ALTERNATE_GAP_NS, StreamSettings
from gateway.stereo.device.timestamps import NANOSECONDS_PER_SECOND

ROUNDING_PERIODS: Final = 1e-6
"""Maximum rounding error of a due time, in periods."""
FIRST_SIMULATED: Final = NANOSECONDS_PER_SECOND
"""Simulated timestamp of the first frame, nanoseconds since the epoch."""


class FrameClock:
    """Schedule of the next frame: when it is due, its timestamp, and whether it includes depth.

    Due times of frames are seconds of the event loop's clock, as ``now`` of all methods. Timestamps are nanoseconds
    since the epoch.
    """

    def __init__(self, rate: Rate, *, simulated: bool) -> None:
        """
        Args:
            rate: see ``StereoConfig.rate``.
            simulated: see ``StereoConfig.simulated_clock``.
        """
        self.simulated = simulated
        self.timestamp: int | None = None
        """Timestamp of the last frame; a simulated one includes delays since. None before the first frame."""
        self.frame_due = 0.0
        """Due time of the newest frame."""
        self._unlimited = rate == "max"
        """True if frames are captured without a schedule, whenever clients need one."""
        self._next_frame_due = 0.0
        """Due time of the frame after it."""
        self._stopped = True
        """True while no client streams: no frames are missed."""
        self._next_depth_timestamp: float | None = None
        """Timestamp from which frames include depth; None: the next one does."""
        self._needed_from = 0.0
        """Due time of the next frame that is needed. Those before it are not missed."""

    def current_timestamp(self) -> int:
        """Return the system time, or the simulated time of the last frame."""
        return time.time_ns() if not self.simulated else self.timestamp or FIRST_SIMULATED

    def next_timestamp(self, settings: StreamSettings, now: float) -> int:
        """Return the timestamp of the frame that is due: the middle of an exposure that ended when it was due."""
        if self.simulated:
            return FIRST_SIMULATED if self.timestamp is None else self.timestamp + settings.period_ns
        age = now - self._exposure_end(now) + 0.5 * settings.longest_exposure
        timestamp, last = time.time_ns() - round(age * NANOSECONDS_PER_SECOND), self.timestamp
        # Timestamps identify frames: they stay unique when the system clock is set back by up to a second.
        if last is not None and last - NANOSECONDS_PER_SECOND < timestamp <= last:
            return last + 1
        return timestamp

    def seconds_until_frame(self, settings: StreamSettings, now: float, *, depth_only: bool = False) -> float:
        """Return the seconds until the next frame that is needed is due, at most 0 if it is due.

        Args:
            settings: current parameters.
            now: seconds of the event loop's clock.
            depth_only: True: frames without depth are not needed.
        """
        seconds = self._next_frame_due - now
        self._needed_from = min(self._needed_from, now)  # a wait beyond now has ended early
        if depth_only and not settings.single_frame and not self.simulated:
            age = round((0.5 * settings.longest_exposure - seconds) * NANOSECONDS_PER_SECOND)
            until_depth = self._nanoseconds_until_depth(settings, time.time_ns() - age)
            seconds += max(0, math.ceil(until_depth / settings.period_ns - 0.5)) / settings.camera_rate
            self._needed_from = max(self._needed_from, now + seconds)
        return seconds

    def advance_to_due_frame(self, settings: StreamSettings, now: float) -> int:
        """Advance to the newest frame that is due, and schedule the next one. Return the number of missed frames.

        However late the caller is, due times are a multiple of the period apart.
        """
        period = 1.0 / settings.camera_rate
        late_periods = int(max(0.0, now - self._next_frame_due) / period)
        unneeded = max(0, math.ceil((self._needed_from - self._next_frame_due) / period - ROUNDING_PERIODS))
        missed = 0 if self._stopped or self.simulated else max(0, late_periods - unneeded)
        # After a stop there are no earlier frames to keep in step with.
        starts_late = self._stopped and late_periods > 0
        self.frame_due = now if starts_late else self._next_frame_due + late_periods * period
        self._next_frame_due = self.frame_due + period
        self._stopped = False
        return missed

    def depth_due(self, settings: StreamSettings, now: float, trigger_time: float | None) -> bool:
        """Return True if the frame that is due includes depth.

        Args:
            settings: current parameters.
            now: seconds of the event loop's clock.
            trigger_time: time of a call of ``acquisition_trigger``, seconds of the event loop's clock; None: there was
                none since the last frame with depth.
        """
        if settings.single_frame:
            if trigger_time is None:
                return False
            return self.simulated or trigger_time <= self._exposure_end(now) - settings.longest_exposure
        if self._unlimited:
            return True
        timestamp = self.next_timestamp(settings, now)
        return self._nanoseconds_until_depth(settings, timestamp) <= settings.period_ns / 2

    def schedule_next_depth(self, settings: StreamSettings, timestamp: int) -> None:
        """Schedule the depth frame after the one with this timestamp."""
        due, interval = self._next_depth_timestamp, NANOSECONDS_PER_SECOND / settings.depth_rate
        if due is None or abs(timestamp - due) > interval:  # the first one, a late one, or the system clock was set
            due = timestamp
        self._next_depth_timestamp = due + interval

    def delay_for_alternate_exposure(self, settings: StreamSettings) -> None:
        """Delay the next camera frame until ``ALTERNATE_GAP_NS`` after the depth exposure, which is as much after the
        last camera frame."""
        delay = max(2 * ALTERNATE_GAP_NS - settings.period_ns, 0)
        self._next_frame_due += delay / NANOSECONDS_PER_SECOND
        if self.simulated and self.timestamp is not None:
            self.timestamp += delay

    def skip_frame(self, settings: StreamSettings) -> None:
        """Advance simulated time by a frame that is not captured."""
        if self.simulated:
            self.timestamp = self.next_timestamp(settings, 0.0)

    def stop_schedule(self) -> None:
        """Stop the schedule until the next frame, which includes depth."""
        self._next_depth_timestamp = None
        self._stopped = True

    def _exposure_end(self, now: float) -> float:
        """Return the end of the exposure of the frame that is due: its due time or, without a schedule, now."""
        return now if self._unlimited else min(now, self.frame_due)

    def _nanoseconds_until_depth(self, settings: StreamSettings, timestamp: int) -> float:
        """Return the nanoseconds from a frame's timestamp until depth is due, at most 0 if it is due."""
        if self._next_depth_timestamp is None:
            return 0.0
        remaining = self._next_depth_timestamp - timestamp
        was_set_back = remaining > 2 * NANOSECONDS_PER_SECOND / settings.depth_rate  # the system clock
        return 0.0 if was_set_back else remaining
