"""Frame scheduler: captures the scene while clients stream, whenever a frame is due and not too many are in flight."""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.runtime.pool_errors import QueueFull
from gateway.runtime.worker_pool import WorkerPool, until_compiled
from gateway.stereo.device.stream_settings import ALTERNATE_GAP_NS, StreamSettings
from gateway.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from gateway.stereo.imaging.rendered_images import Capture, Imaging
from gateway.stereo.imaging.scene_motion import SceneState, state_before
from gateway.stereo.stream.frame import FrameImages, FrameRecord
from gateway.stereo.stream.frame_clock import FrameClock
from gateway.stereo.stream.frame_publisher import FramePublisher, FramesInFlight
from gateway.stereo.stream.set_kind import SetKind
from gateway.stereo.stream.subscriptions import MailboxState

SceneSource = Callable[[int | None], SceneState]
"""Returns scene and pose that were valid at a time, nanoseconds since the epoch; None: the current ones. Called in
worker threads."""

MAX_SETTLING: Final = 30_000_000
"""Maximum age of a frame that waits for messages that arrived before it and are still being read, nanoseconds."""
_Kinds = tuple[SetKind, ...]
_POLL_SECONDS: Final = 0.002
_KERNEL_PARTS: Final = ("stereo", "normals")
"""Parts of the kernels (``gateway.runtime.kernels.parts``) that images and depth need."""


class FrameScheduler:
    """Captures frames while clients stream."""

    def __init__(
        self,
        imaging: Imaging,
        workers: WorkerPool,
        publisher: FramePublisher,
        settings: StreamSettings,
        scene: SceneSource,
        on_capture: Callable[[int, NDArray[np.float64]], None] | None = None,
        on_streaming: Callable[[bool], None] = lambda streaming: None,
        has_unapplied_before: Callable[[int], bool] = lambda timestamp: False,
    ) -> None:
        """
        Args:
            on_capture: called after each capture of camera images with its true timestamp, nanoseconds since the epoch,
                and X_world_left, (4, 4) float64.
            on_streaming: called with True before the first frame for clients, and with False when there are none.
            has_unapplied_before: see ``LiveTree.has_unapplied_before``.
        """
        self.imaging = imaging
        """Image source of the next frames."""
        self.settings = settings
        """Parameters of the next frames."""
        self.history: deque[FrameRecord] = deque(maxlen=imaging.config.history)
        """The last frames, oldest first, for ground truth."""
        self.trigger_time: float | None = None
        """Time of a call of ``acquisition_trigger``, seconds of the event loop's clock; None after its capture."""
        self._workers = workers
        self._publisher = publisher
        self._hub = publisher.hub
        self._counts = publisher.counts
        self._scene = scene
        self._on_capture = on_capture
        self._on_streaming = on_streaming
        self._has_unapplied_before = has_unapplied_before
        self._unlimited = imaging.config.rate == "max"
        self._clock = FrameClock(imaging.config.rate, simulated=imaging.config.simulated_clock)
        self._camera_frames = FramesInFlight()
        self._depth_frames = FramesInFlight()
        self._frame_number = 0
        self._streaming = False
        self._last: SceneState | None = None
        """Scene of the newest capture, for motion blur and rolling shutters."""

    async def run(self) -> None:
        """Capture frames until cancelled.

        The first one waits for the kernels: compiling them is not part of a frame's time limit.
        """
        try:
            await until_compiled(*_KERNEL_PARTS)
            while True:
                seconds = await self._step()
                if seconds > 0.0:
                    await _wait(self._hub.changed, seconds)
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
        hub.changed.clear()
        if bool(hub.kinds) != self._streaming:
            self._set_streaming(bool(hub.kinds))
        while hub.new_kinds:
            self._repeat_last_frame(hub.new_kinds.pop())
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
            self._camera_frames.last = self._depth_frames.last = None
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
        """Return False if too many frames are in flight. If frames must not be skipped, wait instead."""
        config = self.imaging.config
        matching = config.depth_mode == "matched" and frames is self._depth_frames
        limit = 1 if matching or self._clock.simulated else config.frames_in_flight
        while len(frames) >= limit:
            if not self._unlimited and not self._clock.simulated:
                self._counts.skipped += 1
                return False
            self._hub.changed.clear()
            changed = asyncio.ensure_future(self._hub.changed.wait())
            await asyncio.wait((*frames.tasks, changed), return_when=asyncio.FIRST_COMPLETED)
            changed.cancel()
            if len(self._hub) == 0:
                self._cancel_frames()
                return False
        return True

    def _cancel_frames(self) -> None:
        self._camera_frames.cancel()
        self._depth_frames.cancel()

    async def _capture(self, settings: StreamSettings, camera_kinds: _Kinds, depth_kinds: _Kinds) -> None:
        """Capture the scene and start the tasks that make the sets.

        Args:
            settings: parameters of the frame.
            camera_kinds: kinds without depth.
            depth_kinds: kinds with depth.
        """
        clock, publisher, generation = self._clock, self._publisher, self._hub.generation
        timestamp = clock.next_timestamp(settings, asyncio.get_running_loop().time())
        sent_timestamp = publisher.sent_timestamp(timestamp)
        kinds = camera_kinds + depth_kinds
        capture = await self._capture_scene(self._frame_number + 1, timestamp, sent_timestamp, settings, kinds)
        if capture is None:
            return
        self._frame_number += 1
        clock.timestamp = timestamp
        if self._on_capture is not None:
            self._on_capture(timestamp, capture.X_world_left)
        record = FrameRecord(self.imaging, settings, capture, capture, generation)
        if depth_kinds:
            clock.schedule_next_depth(settings, timestamp)
            self.trigger_time = None
        if not settings.separate_depth:
            frame = self._new_frame(record, kinds)
            self._publish_camera_sets(frame, camera_kinds)
            if depth_kinds:
                self._depth_frames.last = frame
                publisher.spawn(self._depth_frames, publisher.publish_depth_sets(frame, depth_kinds))
            return
        if camera_kinds:
            self._publish_camera_sets(self._new_frame(record, camera_kinds), camera_kinds)
        if depth_kinds:
            clock.delay_for_alternate_exposure(settings)
            publisher.spawn(self._depth_frames, self._expose_depth(record, timestamp, depth_kinds))

    def _publish_camera_sets(self, frame: FrameImages, kinds: _Kinds) -> None:
        if kinds:
            self._camera_frames.last = frame
            self._publisher.spawn(self._camera_frames, self._publisher.publish_sets(frame, kinds))

    async def _expose_depth(self, camera_record: FrameRecord, timestamp: int, kinds: _Kinds) -> None:
        """Capture the scene for depth 40 ms after the camera images, with the outputs of depth exposures.

        Args:
            camera_record: frame of the camera images.
            timestamp: its true timestamp, nanoseconds since the epoch.
        """
        await asyncio.sleep(0 if self._unlimited else ALTERNATE_GAP_NS / NANOSECONDS_PER_SECOND)
        timestamp += ALTERNATE_GAP_NS
        sent_timestamp = camera_record.camera_capture.timestamp + ALTERNATE_GAP_NS
        settings, number = camera_record.settings, camera_record.number
        capture = await self._capture_scene(number, timestamp, sent_timestamp, settings, kinds, for_depth=True)
        if capture is not None:
            self._depth_frames.last = frame = self._new_frame(replace(camera_record, depth_capture=capture), kinds)
            await self._publisher.publish_depth_sets(frame, kinds)

    def _new_frame(self, record: FrameRecord, kinds: _Kinds) -> FrameImages:
        self.history.append(record)
        return FrameImages(record, self._workers, kinds)

    async def read_scene(self, timestamp: int) -> tuple[SceneState, SceneState | None]:
        """Return the scene at a time, and an earlier one if images depend on motion.

        Args:
            timestamp: nanoseconds since the epoch. With simulated time, the scene is the current one.

        Raises:
            QueueFull: the worker queue is full.
        """
        while (  # noqa: ASYNC110 - at most 30 ms
            self._has_unapplied_before(timestamp) and time.time_ns() - timestamp < MAX_SETTLING
        ):
            await asyncio.sleep(_POLL_SECONDS)
        return await self._workers.run(self._read_scene, timestamp)

    def _read_scene(self, timestamp: int) -> tuple[SceneState, SceneState | None]:
        if not self.imaging.config.uses_motion:
            return self._scene(None if self._clock.simulated else timestamp), None
        if self._clock.simulated:
            return replace(self._scene(None), timestamp=timestamp), self._last
        state = self._scene(timestamp)
        return state, state_before(state, self._last, self._scene)

    async def _capture_scene(
        self,
        frame_number: int,
        timestamp: int,
        sent_timestamp: int,
        settings: StreamSettings,
        kinds: _Kinds,
        *,
        for_depth: bool = False,
    ) -> Capture | None:
        """Return scene and pose at a time, or None if they cannot be read.

        An error ends the streams of ``kinds``; a full worker queue does not.

        Args:
            timestamp: true time, nanoseconds since the epoch.
            sent_timestamp: time that clients get; a fault may falsify it.
            for_depth: the exposure is for depth alone.
        """
        try:
            state, earlier = await self.read_scene(timestamp)
        except QueueFull:
            self._counts.dropped += 1
        except Exception as error:  # noqa: BLE001 - a broken scene must not stop the camera
            for kind in kinds:
                self._publisher.end_streams(kind, "the scene could not be read", error)
        else:
            self._last = state
            if earlier is not None:
                earlier = replace(earlier, timestamp=earlier.timestamp + sent_timestamp - timestamp)
            return Capture.of_state(state, settings, sent_timestamp, frame_number, earlier, depth=for_depth)
        return None

    def _repeat_last_frame(self, kind: SetKind) -> None:
        """Send the last frame to new clients if it is still current, so that they do not wait for the next frame."""
        publisher, settings = self._publisher, self.settings
        frame = self._depth_frames.last if kind.has_depth else self._camera_frames.last
        if frame is None or frame.record.generation != self._hub.generation or settings.single_frame:
            return
        rate = settings.depth_rate if kind.has_depth else settings.camera_rate
        now = publisher.sent_timestamp(self._clock.current_timestamp())
        if now - frame.record.depth_capture.timestamp < NANOSECONDS_PER_SECOND / rate:
            publisher.spawn(self._camera_frames, publisher.publish_sets(frame, (kind,)))


async def _wait(event: asyncio.Event, seconds: float) -> None:
    """Wait for an event, at most ``seconds``, rounded up to milliseconds: uvloop's clock and timers count them."""
    limit = math.ceil(seconds * 1000.0) / 1000.0 if seconds < math.inf else None
    with suppress(TimeoutError):
        async with asyncio.timeout(limit):
            await event.wait()
