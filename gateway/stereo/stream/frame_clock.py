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

    Times named ``now`` are seconds of the event loop's clock; timestamps are nanoseconds since the epoch.
    """

    def __init__(self, rate: Rate, *, simulated: bool) -> None:
        """
        Args:
            rate: see ``StereoConfig.rate``.
            simulated: see ``StereoConfig.simulated_clock``.
        """
        self.simulated = simulated
        self.timestamp: int | None = None
        """Timestamp of the last frame; None before the first."""
        self._unlimited = rate == "max"
        """True if frames are captured without a schedule, whenever clients need one."""
        self.frame_due = 0.0
        """Due time of the newest frame, seconds of the event loop's clock."""
        self._next_frame_due = 0.0
        self._stopped = True
        """True while no client streams: no frames are missed."""
        self._next_depth_due: float | None = None
        """Timestamp from which depth is due; None: due now."""
        self._needed_from = 0.0
        """Time from which frames are needed, seconds of the event loop's clock. Those that are due before it are not
        missed."""

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
        is_used = last is not None and last - NANOSECONDS_PER_SECOND < timestamp <= last
        return last + 1 if is_used and last is not None else timestamp

    def seconds_until_frame(self, now: float, depth_only: StreamSettings | None = None) -> float:
        """Return the seconds until the next frame that is needed is due, at most 0 if it is due.

        Args:
            now: seconds of the event loop's clock.
            depth_only: current parameters, if frames without depth are not needed; None: every frame is needed.
        """
        seconds = self._next_frame_due - now
        self._needed_from = min(self._needed_from, now)  # the caller slept until now, and has to decide again
        if depth_only is None or depth_only.single_frame or self.simulated or self._next_depth_due is None:
            return seconds
        age = round((0.5 * depth_only.longest_exposure - seconds) * NANOSECONDS_PER_SECOND)
        remaining = self._next_depth_due - (time.time_ns() - age)
        if remaining <= 2e9 / depth_only.depth_rate:  # see ``depth_due``
            period = 1.0 / depth_only.camera_rate
            seconds += period * max(0, math.ceil(remaining / 1e9 / period - 0.5))
        self._needed_from = max(self._needed_from, now + seconds)
        return seconds

    def advance_to_due_frame(self, now: float, period: float) -> int:
        """Advance to the newest frame that is due, and schedule the next one. Return the number of missed frames.

        However late the caller is, due times are a multiple of the period apart.

        Args:
            now: seconds of the event loop's clock.
            period: seconds between frames.
        """
        late_periods = int(max(0.0, now - self._next_frame_due) / period)
        unneeded = max(0, math.ceil((self._needed_from - self._next_frame_due) / period - ROUNDING_PERIODS))
        missed = 0 if self._stopped or self.simulated else max(0, late_periods - unneeded)
        is_first = self._stopped and late_periods > 0
        self.frame_due = now if is_first else self._next_frame_due + late_periods * period
        self._next_frame_due = self.frame_due + period
        self._stopped = False
        return missed

    def depth_due(self, settings: StreamSettings, now: float, trigger_time: float | None) -> bool:
        """Return True if the frame that is due includes depth.

        Args:
            settings: current parameters.
            now: seconds of the event loop's clock.
            trigger_time: time of a call of ``acquisition_trigger``, seconds of the event loop's clock; None: none
                waits for its frame.
        """
        if settings.single_frame:
            if trigger_time is None:
                return False
            return self.simulated or trigger_time <= self._exposure_end(now) - settings.longest_exposure
        if self._unlimited or self._next_depth_due is None:
            return True
        remaining = self._next_depth_due - self.next_timestamp(settings, now)
        # A due time far in the future means that the system clock was set back.
        return remaining <= settings.period_ns / 2 or remaining > 2e9 / settings.depth_rate

    def schedule_next_depth(self, timestamp: int, depth_rate: float) -> None:
        """Schedule the depth frame after the one with this timestamp.

        Args:
            timestamp: timestamp of the depth frame.
            depth_rate: depth images per second.
        """
        due, interval = self._next_depth_due, 1e9 / depth_rate
        on_time = due is not None and timestamp - due <= interval
        self._next_depth_due = (due if on_time and due is not None else timestamp) + interval

    def delay_for_alternate_exposure(self, period_ns: int) -> None:
        """Delay the next camera frame until 40 ms after the depth exposure, which follows 40 ms after the last camera
        frame.

        Args:
            period_ns: nanoseconds between camera frames.
        """
        delay = max(2 * ALTERNATE_GAP_NS - period_ns, 0)
        self._next_frame_due += delay / 1e9
        if self.simulated and self.timestamp is not None:
            self.timestamp += delay

    def skip_frame(self, settings: StreamSettings) -> None:
        """Advance simulated time by a frame that is not captured."""
        if self.simulated:
            self.timestamp = self.next_timestamp(settings, 0.0)

    def stop_schedule(self) -> None:
        """Stop the schedule until the next frame, which includes depth."""
        self._next_depth_due = None
        self._stopped = True

    def _exposure_end(self, now: float) -> float:
        """Return the end of the exposure of the frame that is due: its due time or, without a schedule, now."""
        return now if self._unlimited else min(now, self.frame_due)
