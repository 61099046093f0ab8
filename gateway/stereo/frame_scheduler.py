"""Frame scheduler: captures the scene while clients stream, when a frame is due and not too many are in flight."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gateway.runtime.worker_pool import QueueFull, WorkerPool
from gateway.stereo.clock import NANOSECONDS, Clock
from gateway.stereo.events import EventHub
from gateway.stereo.faults import FaultInjector
from gateway.stereo.frame import Frame, FrameRecord
from gateway.stereo.frame_clock import FrameClock
from gateway.stereo.frame_publisher import FrameCounts, FramePublisher, FramesInFlight
from gateway.stereo.hub import Hub, MailboxState
from gateway.stereo.images import Capture, Imaging, MeteredExposure
from gateway.stereo.parameters import Parameters
from gateway.stereo.request import SetKind
from gateway.stereo.settings import ALTERNATE_GAP, StreamSettings, read_settings
from gateway.stereo.trigger import Trigger
from renderers.drawlist import DrawList

SceneSource = Callable[[], tuple[DrawList, int]]
"""Returns the current scene and its revision. Called in a worker thread, one call at a time."""
PoseSource = Callable[[], NDArray[np.float64]]
"""Returns X_world_left, (4, 4) float64, the left optical frame. Called right after the scene, in the same thread."""


class FrameScheduler:
    """Captures frames while clients stream."""

    def __init__(
        self,
        imaging: Imaging,
        workers: WorkerPool,
        hub: Hub,
        events: EventHub,
        injector: FaultInjector,
        parameters: Parameters,
        scene: SceneSource,
        pose: PoseSource,
        clock: Clock,
        trigger: Trigger,
    ) -> None:
        config = imaging.config
        self.imaging = imaging
        """Image source of the next frames."""
        self.history: deque[FrameRecord] = deque(maxlen=config.history)
        """Newest frames, oldest first, for ground truth."""
        self._workers = workers
        self._hub = hub
        self._injector = injector
        self._parameters = parameters
        self._scene = scene
        self._pose = pose
        self._trigger = trigger
        self._clock = FrameClock(clock, config.rate)
        self._publisher = FramePublisher(hub, events, injector, config.rate, simulated=clock.simulated)
        self._camera = FramesInFlight()
        self._depth = FramesInFlight()
        self._sampling = asyncio.Lock()
        self._number = 0

    @property
    def settings(self) -> StreamSettings:
        """Current parameters."""
        return read_settings(self._parameters)

    @property
    def counts(self) -> FrameCounts:
        """Counters since start."""
        return self._publisher.counts

    @property
    def last_metered(self) -> MeteredExposure | None:
        """Exposure of the newest left image."""
        return self._publisher.last_metered

    async def run(self) -> None:
        """Capture frames until cancelled."""
        try:
            while True:
                await self._step()
        finally:
            tasks = self._camera.tasks | self._depth.tasks
            self._cancel_frames()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _step(self) -> None:
        """Wait for the next event, and capture a frame if one is due."""
        hub, clock, fast = self._hub, self._clock, self.imaging.config.rate == "max"
        hub.changed.clear()
        if len(hub) == 0:
            self._cancel_frames()
            self._camera.last = self._depth.last = None
            clock.reset_depth()
        self._repeat_last_frames()
        kinds = self._urgent_kinds() if fast else hub.kinds()
        if not kinds:
            await hub.changed.wait()
            return
        settings, now = self.settings, asyncio.get_running_loop().time()
        period = 1.0 / settings.camera_rate
        if not fast or all(kind.empty for kind in kinds):
            if (wait := clock.seconds_until_frame(now)) > 0:
                await _wait(hub.changed, wait)
                return
            clock.start_frame(now, period)
        nanoseconds = round(period * NANOSECONDS)
        depth_due = clock.depth_due(settings, nanoseconds, triggered=self._trigger.pending)
        depth = await self._admit(self._depth, {kind for kind in kinds if kind.has_depth and depth_due})
        camera = await self._admit(self._camera, {kind for kind in kinds if not kind.has_depth})
        if depth or camera:
            # Read again: parameters may have changed while frames in flight ended, and act on every later timestamp.
            await self._capture(self.settings, camera, depth, nanoseconds)
        elif fast:  # depth waits for its trigger
            await _wait(hub.changed, period)
        else:
            clock.skip_frame(nanoseconds)

    def _urgent_kinds(self) -> set[SetKind]:
        """Return the kinds to make at rate ``max``.

        While a frame is in flight, another one would only help clients that have sent everything.
        """
        if self._camera or self._depth:
            return self._hub.kinds_with_mailbox(MailboxState.WAITING)
        return self._hub.kinds_with_mailbox(MailboxState.WAITING, MailboxState.EMPTY)

    async def _admit(self, group: FramesInFlight, kinds: set[SetKind]) -> set[SetKind]:
        """Return the kinds, or none if too many frames are in flight. Waits where frames must not be skipped."""
        config = self.imaging.config
        matching = config.depth_mode == "matched" and group is self._depth
        limit = 1 if matching or self._clock.simulated else config.frames_in_flight
        while kinds and len(group) >= limit:
            if config.rate == "device" and not self._clock.simulated:
                self.counts.skipped += 1
                return set()
            self._hub.changed.clear()
            changed = asyncio.ensure_future(self._hub.changed.wait())
            await asyncio.wait((*group.tasks, changed), return_when=asyncio.FIRST_COMPLETED)
            changed.cancel()
            if len(self._hub) == 0:
                self._cancel_frames()
                return set()
        return kinds

    def _cancel_frames(self) -> None:
        self._camera.cancel()
        self._depth.cancel()

    async def _capture(self, settings: StreamSettings, camera: set[SetKind], depth: set[SetKind], period: int) -> None:
        """Capture the scene and start to make the sets.

        Args:
            settings: parameters of the frame.
            camera: kinds without depth.
            depth: kinds with depth.
            period: nanoseconds between camera frames.
        """
        clock, publisher, generation = self._clock, self._publisher, self._hub.generation()
        timestamp = clock.next_timestamp(period)
        sent_timestamp = self._injector.timestamp(timestamp)
        capture = await self._sample(self._number + 1, sent_timestamp, settings.gpio(depth=False), camera | depth)
        if capture is None:
            return
        self._number += 1
        clock.timestamp = timestamp
        frame = None
        if camera:
            kinds = camera if settings.separate_depth else camera | depth
            self._camera.last = frame = self._frame(settings, capture, capture, kinds, generation)
            publisher.spawn(self._camera, publisher.make(frame, camera))
        if not depth:
            return
        clock.captured_depth(timestamp, settings.depth_rate)
        self._trigger.done()
        if settings.separate_depth:
            clock.delay_for_alternate_exposure(period)
            publisher.spawn(self._depth, self._expose_depth(settings, capture, depth, generation))
            return
        self._depth.last = frame = frame or self._frame(settings, capture, capture, depth, generation)
        publisher.spawn(self._depth, publisher.make_depth(frame, depth))

    async def _expose_depth(
        self, settings: StreamSettings, camera: Capture, kinds: set[SetKind], generation: int
    ) -> None:
        """Capture the depth images 40 ms after the camera images, with the outputs of depth exposures."""
        if self.imaging.config.rate == "device":
            await asyncio.sleep(ALTERNATE_GAP / NANOSECONDS)
        timestamp = camera.timestamp + ALTERNATE_GAP
        depth = await self._sample(camera.frame_number, timestamp, settings.gpio(depth=True), kinds)
        if depth is not None:
            self._depth.last = frame = self._frame(settings, camera, depth, kinds, generation)
            await self._publisher.make_depth(frame, kinds)

    def _frame(
        self, settings: StreamSettings, camera: Capture, depth: Capture, kinds: set[SetKind], generation: int
    ) -> Frame:
        self.history.append(FrameRecord(camera.frame_number, settings, camera, depth, self.imaging))
        return Frame(self.imaging, self._workers, settings, camera, depth, kinds, generation)

    async def _sample(self, number: int, timestamp: int, gpio: int, kinds: set[SetKind]) -> Capture | None:
        """Return the scene and pose as they are now.

        If they cannot be read, end the streams of ``kinds`` and return None.
        """
        try:
            async with self._sampling:
                scene, revision, pose = await self._workers.run(self._scene_and_pose)
        except QueueFull:
            self.counts.busy += 1
        except Exception as error:  # noqa: BLE001 - the camera outlives a broken scene
            for kind in kinds:
                self._publisher.fail(kind, "the scene could not be read", error)
        else:
            return Capture(timestamp, scene, revision, pose, gpio, number)
        return None

    def _scene_and_pose(self) -> tuple[DrawList, int, NDArray[np.float64]]:
        scene, revision = self._scene()
        return scene, revision, self._pose()

    def _repeat_last_frames(self) -> None:
        """Send the last frame to new clients if it is still current, so that they need not wait for the next one."""
        settings, publisher = self.settings, self._publisher
        for kind in self._hub.take_new_kinds():
            frame = self._depth.last if kind.has_depth else self._camera.last
            if frame is None or frame.generation != self._hub.generation() or settings.single_frame:
                continue
            rate = settings.depth_rate if kind.has_depth else settings.camera_rate
            now = self._injector.timestamp(self._clock.next_timestamp(0))
            if now - frame.depth.timestamp < NANOSECONDS / rate:
                publisher.spawn(self._camera, publisher.make(frame, {kind}))


async def _wait(event: asyncio.Event, seconds: float) -> None:
    try:
        async with asyncio.timeout(seconds):
            await event.wait()
    except TimeoutError:
        pass
