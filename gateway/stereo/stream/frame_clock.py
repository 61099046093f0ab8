"""Due times and timestamps of camera and depth frames: computation only, no waiting."""

from __future__ import annotations

import math
from typing import Final

from gateway.stereo.device.camera_config import Rate
from gateway.stereo.device.clock import NANOSECONDS_PER_SECOND, Clock
from gateway.stereo.device.stream_settings import ALTERNATE_GAP_NS, StreamSettings

ROUNDING_PERIODS: Final = 1e-6
"""Maximum rounding error of a due time, in periods."""


class FrameClock:
    """Schedule of the next frame: when it is due, its timestamp, and whether it includes depth."""

    def __init__(self, clock: Clock, rate: Rate) -> None:
        """
        Args:
            clock: source of timestamps.
            rate: see ``StereoConfig.rate``.
        """
        self.simulated = clock.simulated
        """True if timestamps count frames instead of time."""
        self.timestamp: int | None = None
        """Timestamp of the last frame, nanoseconds; None before the first."""
        self._clock = clock
        self._rate = rate
        self.frame_due = 0.0
        """Due time of the newest frame, seconds of the event loop's clock."""
        self._next_frame_due = 0.0
        self._stopped = True
        """True while no client streams: no frames are missed."""
        self._next_depth_due: float | None = None
        """Timestamp from which depth is due, nanoseconds; None: due now."""
        self._needed_from = 0.0
        """Time from which frames are needed, seconds of the event loop's clock. Those that are due before it are not
        missed."""

    def next_timestamp(self, period: int, now: float | None = None, exposure: float = 0.0) -> int:
        """Return the timestamp of a frame: the middle of an exposure that ended when the frame was due.

        Args:
            period: nanoseconds between frames.
            now: seconds of the event loop's clock; None: the frame is due now.
            exposure: longest exposure time, seconds.
        """
        lateness = 0.0 if now is None else max(0.0, now - self.frame_due)
        age = round((lateness + 0.5 * exposure) * NANOSECONDS_PER_SECOND)
        return self._clock.next_timestamp(self.timestamp, period, age)

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
        remaining = self._next_depth_due - self._clock.next_timestamp(None, 0, age)
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

    def depth_due(self, settings: StreamSettings, timestamp: int, period: int, *, triggered: bool) -> bool:
        """Return True if a frame includes depth.

        Args:
            settings: current parameters.
            timestamp: timestamp of the frame, nanoseconds.
            period: nanoseconds between camera frames.
            triggered: True if ``acquisition_trigger`` was called.
        """
        if settings.single_frame:
            return triggered
        if self._rate == "max" or self._next_depth_due is None:
            return True
        remaining = self._next_depth_due - timestamp
        # A due time far in the future means that the system clock was set back.
        return remaining <= period / 2 or remaining > 2e9 / settings.depth_rate

    def schedule_next_depth(self, timestamp: int, depth_rate: float) -> None:
        """Schedule the depth frame after the one with this timestamp.

        Args:
            timestamp: timestamp of the depth frame, nanoseconds.
            depth_rate: depth images per second.
        """
        due, interval = self._next_depth_due, 1e9 / depth_rate
        on_time = due is not None and timestamp - due <= interval
        self._next_depth_due = (due if on_time and due is not None else timestamp) + interval

    def delay_for_alternate_exposure(self, period: int) -> None:
        """Delay the next camera frame until 40 ms after the depth exposure, which follows 40 ms after the last camera
        frame.

        Args:
            period: nanoseconds between camera frames.
        """
        delay = max(2 * ALTERNATE_GAP_NS - period, 0)
        self._next_frame_due += delay / 1e9
        if self.simulated and self.timestamp is not None:
            self.timestamp += delay

    def skip_frame(self, period: int) -> None:
        """Advance simulated time by a frame that is not captured."""
        if self.simulated:
            self.timestamp = self.next_timestamp(period)

    def stop_schedule(self) -> None:
        """Stop the schedule until the next frame, which includes depth."""
        self._next_depth_due = None
        self._stopped = True
