"""Schedule and capture of frames: ``FrameClock`` computes due times, ``FrameScheduler`` captures the scene."""

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Final

from gateway.adapters.stereo.device.camera_config import Rate
from gateway.adapters.stereo.device.stream_settings import ALTERNATE_GAP_NS, StreamSettings
from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture, SceneReader
from gateway.adapters.stereo.stream.frame import FrameImages, FrameRecord
from gateway.adapters.stereo.stream.frame_publisher import FramePublisher, FramesInFlight
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.adapters.stereo.stream.subscriptions import MailboxState
from gateway.runtime.workers.pool_errors import QueueFull
from gateway.runtime.workers.worker_pool import WorkerPool, until_compiled

ROUNDING_PERIODS: Final = 1e-6
"""Maximum rounding error of a due time, in periods."""
FIRST_SIMULATED_TIMESTAMP: Final = NANOSECONDS_PER_SECOND
"""Simulated timestamp of the first frame, nanoseconds since the epoch."""
_Kinds = tuple[SetKind, ...]
_KERNEL_PARTS: Final = ("stereo", "normals")
"""Parts of the kernels (``gateway.runtime.kernels.parts``) that images and depth need."""


class FrameClock:
    """Schedule of the next frame: when it is due, its timestamp, and whether it includes depth.

    Due times of frames are seconds of the event loop's clock, as ``now`` of all methods. Timestamps are nanoseconds
    since the epoch.
    """

    def __init__(self, rate: Rate, *, simulated: bool) -> None:
        """``rate`` and ``simulated`` are as in ``StereoConfig``."""
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
        return (self.timestamp or FIRST_SIMULATED_TIMESTAMP) if self.simulated else time.time_ns()

    def next_timestamp(self, settings: StreamSettings, now: float) -> int:
        """Return the timestamp of the frame that is due: the middle of an exposure that ended when it was due."""
        if self.simulated:
            return FIRST_SIMULATED_TIMESTAMP if self.timestamp is None else self.timestamp + settings.period_ns
        seconds_since_middle = now - self._exposure_end(now) + 0.5 * settings.longest_exposure
        timestamp, last = time.time_ns() - round(seconds_since_middle * NANOSECONDS_PER_SECOND), self.timestamp
        # Timestamps identify frames: they stay unique when the system clock is set back by up to a second.
        if last is not None and last - NANOSECONDS_PER_SECOND < timestamp <= last:
            return last + 1
        return timestamp

    def seconds_until_frame(self, settings: StreamSettings, now: float, *, depth_only: bool = False) -> float:
        """Return the seconds until a needed frame is due, at most 0. ``depth_only``: only those with depth are."""
        seconds = self._next_frame_due - now
        self._needed_from = min(self._needed_from, now)  # earlier than planned if the wait was ended
        if depth_only and not settings.single_frame and not self.simulated:
            seconds_until_middle = seconds - 0.5 * settings.longest_exposure
            next_timestamp = time.time_ns() + round(seconds_until_middle * NANOSECONDS_PER_SECOND)
            periods_until_depth = self._nanoseconds_until_depth(settings, next_timestamp) / settings.period_ns
            frames_without_depth = max(0, math.ceil(periods_until_depth - 0.5))
            seconds += frames_without_depth / settings.camera_rate
            self._needed_from = max(self._needed_from, now + seconds)
        return seconds

    def advance_to_due_frame(self, settings: StreamSettings, now: float) -> int:
        """Advance to the newest frame that is due, and schedule the next one. Return the number of missed frames.

        However late the caller is, due times are a multiple of the period apart.
        """
        period = 1.0 / settings.camera_rate
        late_periods = int(max(0.0, now - self._next_frame_due) / period)
        unneeded_periods = max(0, math.ceil((self._needed_from - self._next_frame_due) / period - ROUNDING_PERIODS))
        missed = 0 if self._stopped or self.simulated else max(0, late_periods - unneeded_periods)
        # After a stop there are no earlier frames to keep in step with.
        starts_late = self._stopped and late_periods > 0
        self.frame_due = now if starts_late else self._next_frame_due + late_periods * period
        self._next_frame_due = self.frame_due + period
        self._stopped = False
        return missed

    def depth_due(self, settings: StreamSettings, now: float, trigger_time: float | None) -> bool:
        """Return True if the frame that is due includes depth.

        ``trigger_time``: that of a call of ``acquisition_trigger``, seconds of the event loop's clock; None: there was
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
        """Keep ``ALTERNATE_GAP_NS`` from the last camera frame to the depth exposure, and from there to the next camera
        frame, even if that delays it."""
        delay_ns = max(2 * ALTERNATE_GAP_NS - settings.period_ns, 0)
        self._next_frame_due += delay_ns / NANOSECONDS_PER_SECOND
        if self.simulated and self.timestamp is not None:
            self.timestamp += delay_ns

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


class FrameScheduler:
    """Captures frames while clients stream."""

    def __init__(
        self,
        imaging: Imaging,
        reader: SceneReader,
        workers: WorkerPool,
        publisher: FramePublisher,
        settings: StreamSettings,
        on_streaming: Callable[[bool], None] = lambda streaming: None,
    ) -> None:
        """``on_streaming`` is called with True before the first frame for clients, with False when there are none."""
        self._imaging = imaging
        self.settings = settings
        """Parameters of the next frames."""
        self.history: deque[FrameRecord] = deque(maxlen=imaging.config.history)
        """The last frames, oldest first, for ground truth."""
        self.trigger_time: float | None = None
        """Time of a call of ``acquisition_trigger``, seconds of the event loop's clock; None after its capture."""
        self._reader = reader
        self._workers = workers
        self._publisher = publisher
        self._hub = publisher.hub
        self._counts = publisher.counts
        self._on_streaming = on_streaming
        self._unlimited = imaging.config.rate == "max"
        self._clock = FrameClock(imaging.config.rate, simulated=imaging.config.simulated_clock)
        self._camera_frames = FramesInFlight()
        self._depth_frames = FramesInFlight()
        self._frame_number = 0
        self._streaming = False

    async def run(self) -> None:
        """Capture frames until cancelled. The first waits for the kernels, which are not part of its time limit."""
        try:
            await until_compiled(*_KERNEL_PARTS)
            while True:
                seconds = await self._step()
                if seconds > 0.0:
                    await _wait(self._hub.scheduler_wakeup, seconds)
        finally:
            if self._streaming:
                self._set_streaming(False)
            tasks = self._camera_frames.tasks | self._depth_frames.tasks
            self._cancel_frames()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _step(self) -> float:
        """Capture a frame if one is due. Return the seconds until the next step; it comes earlier if the hub changes.

        At rate ``max`` a frame is always due, except for sets of timestamps alone.
        """
        hub, clock = self._hub, self._clock
        hub.scheduler_wakeup.clear()
        if bool(hub.kinds) != self._streaming:
            self._set_streaming(bool(hub.kinds))
        camera_kinds, depth_kinds = self._urgent_kinds() if self._unlimited else (hub.camera_kinds, hub.depth_kinds)
        if not camera_kinds and not depth_kinds:
            return math.inf
        settings, now = self.settings, asyncio.get_running_loop().time()
        only_timestamps = not depth_kinds and all(kind.empty for kind in camera_kinds)
        if not self._unlimited or only_timestamps:
            seconds = clock.seconds_until_frame(settings, now, depth_only=not camera_kinds)
            if seconds > 0.0:
                return seconds
            missed = clock.advance_to_due_frame(settings, now)
            if not self._unlimited:
                self._counts.skipped += missed
        if depth_kinds:
            is_due = clock.depth_due(settings, now, self.trigger_time)
            if not is_due or not await self._has_room(self._depth_frames):
                depth_kinds = ()
        if camera_kinds and not await self._has_room(self._camera_frames):
            camera_kinds = ()
        if depth_kinds or camera_kinds:
            # Read the settings again: they may have changed while ``_has_room`` waited.
            await self._capture(self.settings, camera_kinds, depth_kinds)
        elif self._unlimited:  # only depth is requested, and it waits for its trigger
            return 1.0 / settings.camera_rate
        else:
            clock.skip_frame(settings)
        return 0.0

    def _set_streaming(self, streaming: bool) -> None:
        """Report that clients begin to stream, or that none streams; then the schedule stops."""
        self._streaming = streaming
        self._on_streaming(streaming)
        if not streaming:
            self._cancel_frames()
            self._depth_frames.last = None
            self._clock.stop_schedule()

    def _urgent_kinds(self) -> tuple[_Kinds, _Kinds]:
        """Return the kinds to make at rate ``max``, without and with depth.

        While a frame is in flight, a further frame is useful only to clients that wait for a set.
        """
        hub, states = self._hub, [MailboxState.WAITING]
        if not self._camera_frames and not self._depth_frames:
            states.append(MailboxState.EMPTY)
        urgent = hub.kinds_with_mailbox(*states)
        camera_kinds = tuple(kind for kind in hub.camera_kinds if kind in urgent)
        depth_kinds = tuple(kind for kind in hub.depth_kinds if kind in urgent)
        return camera_kinds, depth_kinds

    async def _has_room(self, frames: FramesInFlight) -> bool:
        """Return False if too many frames are in flight. If frames must not be skipped, wait instead.

        At rate ``max``, the images of one frame are made while the one before is matched; otherwise, matching takes no
        time from images.
        """
        config = self._imaging.config
        is_matching = config.depth_mode == "matched" and frames is self._depth_frames
        limit = 1 if (is_matching and not self._unlimited) or self._clock.simulated else config.frames_in_flight
        while len(frames) >= limit or (is_matching and not frames.is_measured):
            if not self._unlimited and not self._clock.simulated:
                self._counts.skipped += 1
                return False
            self._hub.scheduler_wakeup.clear()
            waits = [asyncio.ensure_future(self._hub.scheduler_wakeup.wait())]
            if frames.last is not None and not frames.is_measured:
                waits.append(asyncio.ensure_future(frames.last.measuring.wait()))
            await asyncio.wait((*frames.tasks, *waits), return_when=asyncio.FIRST_COMPLETED)
            for each in waits:
                each.cancel()
            if len(self._hub) == 0:
                self._cancel_frames()
                return False
        return True

    def _cancel_frames(self) -> None:
        self._camera_frames.cancel()
        self._depth_frames.cancel()

    async def _capture(self, settings: StreamSettings, camera_kinds: _Kinds, depth_kinds: _Kinds) -> None:
        """Capture the scene and start the tasks that make the sets of kinds without and with depth."""
        clock, publisher, generation = self._clock, self._publisher, self._hub.generation
        number, kinds = self._frame_number + 1, camera_kinds + depth_kinds
        # uvloop's time has whole milliseconds and stands still in an iteration; it counts as ``monotonic`` does.
        timestamp = clock.next_timestamp(settings, time.monotonic())
        sent_timestamp = publisher.sent_timestamp(timestamp)
        capture = await self._capture_scene(timestamp, sent_timestamp, settings, number, kinds, depth=False)
        if capture is None:
            return
        self._frame_number = number
        clock.timestamp = timestamp
        record = FrameRecord(self._imaging, settings, capture, capture, generation)
        if depth_kinds:
            clock.schedule_next_depth(settings, timestamp)
            self.trigger_time = None
        if not settings.separate_depth:
            frame = self._new_frame(record, kinds)
            if camera_kinds:
                publisher.spawn(self._camera_frames, publisher.publish_sets(frame, camera_kinds))
            if depth_kinds:
                self._depth_frames.last = frame
                publisher.spawn(self._depth_frames, publisher.publish_depth_sets(frame, depth_kinds))
            return
        if camera_kinds:
            frame = self._new_frame(record, camera_kinds)
            publisher.spawn(self._camera_frames, publisher.publish_sets(frame, camera_kinds))
        if depth_kinds:
            clock.delay_for_alternate_exposure(settings)
            publisher.spawn(self._depth_frames, self._expose_depth(record, timestamp, depth_kinds))

    async def _expose_depth(self, camera_record: FrameRecord, timestamp: int, kinds: _Kinds) -> None:
        """Capture the scene for depth 40 ms after the camera images, with the outputs of depth exposures.

        ``timestamp`` is the true one of ``camera_record``, the frame of the camera images, in nanoseconds since the
        epoch.
        """
        await asyncio.sleep(0 if self._unlimited else ALTERNATE_GAP_NS / NANOSECONDS_PER_SECOND)
        sent_timestamp = camera_record.camera_capture.timestamp + ALTERNATE_GAP_NS
        settings, number = camera_record.settings, camera_record.number
        timestamp += ALTERNATE_GAP_NS
        capture = await self._capture_scene(timestamp, sent_timestamp, settings, number, kinds, depth=True)
        if capture is not None:
            self._depth_frames.last = frame = self._new_frame(replace(camera_record, depth_capture=capture), kinds)
            await self._publisher.publish_depth_sets(frame, kinds)

    def _new_frame(self, record: FrameRecord, kinds: _Kinds) -> FrameImages:
        self.history.append(record)
        return FrameImages(record, self._workers, kinds)

    async def _capture_scene(
        self, timestamp: int, sent_timestamp: int, settings: StreamSettings, number: int, kinds: _Kinds, *, depth: bool
    ) -> Capture | None:
        """Return ``SceneReader.capture``, or None if the scene cannot be read.

        An error ends the streams of ``kinds``; a full worker queue does not.
        """
        try:
            return await self._reader.capture(timestamp, sent_timestamp, settings, number, depth=depth)
        except QueueFull:
            self._counts.dropped += 1
        except Exception as error:  # noqa: BLE001 - a broken scene must not stop the camera
            for kind in kinds:
                self._publisher.end_streams(kind, "the scene could not be read", error)
        return None


async def _wait(event: asyncio.Event, seconds: float) -> None:
    """Wait for an event, at most ``seconds``, rounded up to milliseconds: uvloop's clock and timers count them."""
    limit = math.ceil(seconds * 1000.0) / 1000.0 if seconds < math.inf else None
    with suppress(TimeoutError):
        async with asyncio.timeout(limit):
            await event.wait()
