"""When frames are taken, what they are made for, and how many are in work: the camera's metronome."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import structlog
from numpy.typing import NDArray

from gateway.runtime.worker_pool import DeadlineExceeded, PoolClosed, QueueFull, WorkerPool
from gateway.stereo import settings as stream_settings
from gateway.stereo.clock import Clock
from gateway.stereo.events import EventHub
from gateway.stereo.faults import FaultInjector
from gateway.stereo.frame import Frame
from gateway.stereo.hub import Hub
from gateway.stereo.images import Metered, Shot, Studio
from gateway.stereo.parameters import Parameters
from gateway.stereo.request import Kind
from gateway.stereo.settings import ALTERNATE_GAP, StreamSettings
from gateway.stereo.trigger import Trigger
from renderers.drawlist import DrawList

SceneSource = Callable[[], tuple[DrawList, int]]
"""The scene as it is now, and its revision. Called in a worker thread, never twice at a time."""
PoseSource = Callable[[], NDArray[np.float64]]
"""(4, 4) float64 X_world_left in the optical frame, as it is now. Called right after the scene, in the same thread."""

_log = structlog.get_logger("stereo")
_FORESEEN: Final = (ValueError, OSError, DeadlineExceeded, PoolClosed)
"""Errors that need no traceback in the log."""


@dataclass(slots=True)
class Counts:
    """What happened since start."""

    frames: int = 0
    depth_frames: int = 0
    skipped: int = 0
    """Frames that were due while too many were in work."""
    busy: int = 0
    """Frames dropped because the worker threads had too much to do."""
    problem: str = ""
    """Why the last frame could not be made; empty: it could."""
    depth_seconds: float = 0.0
    """From taking to publishing, of the last depth frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """What is remembered of a frame: enough to render it again."""

    number: int
    settings: StreamSettings
    camera: Shot
    depth: Shot
    studio: Studio


class Metronome:
    """Takes frames while somebody wants them."""

    def __init__(
        self,
        studio: Studio,
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
        self.studio = studio
        """What frames are made by from now on."""
        self._workers = workers
        self._hub = hub
        self._events = events
        self._injector = injector
        self._parameters = parameters
        self._scene = scene
        self._pose = pose
        self._clock = clock
        self._trigger = trigger
        self._tasks: set[asyncio.Task[None]] = set()
        self._depth_tasks: set[asyncio.Task[None]] = set()
        self._sampling = asyncio.Lock()
        self._number = 0
        self._stamp: int | None = None
        self._depth_next: float | None = None
        """Timestamp of the depth frame that is due next; None: any."""
        self._last: Frame | None = None
        self._last_depth: Frame | None = None
        self._next = 0.0
        self._settings = stream_settings.read(parameters)
        self._version = parameters.version
        self.counts = Counts()
        self.last_taken: Metered | None = None
        """How the newest left image was taken."""
        self.history: deque[Record] = deque(maxlen=studio.config.history)
        """The newest frames, for the truth."""

    @property
    def settings(self) -> StreamSettings:
        """The parameters as they are now."""
        if self._version != self._parameters.version:
            self._version = self._parameters.version
            self._settings = stream_settings.read(self._parameters)
        return self._settings

    async def run(self) -> None:
        """Works until cancelled."""
        try:
            while True:
                await self._turn()
        finally:
            tasks = self._tasks | self._depth_tasks
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _turn(self) -> None:
        """Waits for what comes next, and takes a frame if it is due."""
        hub, fast = self._hub, self.studio.config.rate == "max"
        hub.changed.clear()
        if len(hub) == 0:
            self._end_frames()
            self._last = self._last_depth = self._depth_next = None
        self._serve_newcomers()
        # A second frame beside one in work helps only those who have nothing left to send.
        kinds = hub.urgent_kinds(starving=bool(self._tasks or self._depth_tasks)) if fast else hub.kinds()
        if not kinds:
            await hub.changed.wait()
            return
        settings, loop = self.settings, asyncio.get_running_loop()
        period = 1.0 / settings.camera_rate
        if not fast or all(k.empty for k in kinds):
            wait = self._next - loop.time()
            if wait > 0:
                await _wait(hub.changed, wait)
                return
            # On the beat; but who is late does not hurry to catch up.
            self._next = self._next + period if wait > -period else loop.time() + period
        nanoseconds = round(period * 1e9)
        depth = await self._room(self._depth_tasks, {k for k in kinds if k.depth and self._due(settings, nanoseconds)})
        plain = await self._room(self._tasks, {k for k in kinds if not k.depth})
        if depth or plain:
            # Read again: a parameter that was set while we waited for room acts on every later timestamp.
            await self._take(self.settings, plain, depth, nanoseconds)
        elif fast:  # nothing is due: depth waits for its trigger
            await _wait(hub.changed, period)
        elif self._clock.simulated:  # the camera's time goes on with every beat
            self._stamp = self._clock.stamp(self._stamp, nanoseconds)

    def _due(self, settings: StreamSettings, period: int) -> bool:
        """Whether the frame that would be taken now is one with depth."""
        if settings.single:
            return self._trigger.pending
        if self.studio.config.rate == "max" or self._depth_next is None:
            return True
        ahead = self._depth_next - self._clock.stamp(self._stamp, period)
        # Far ahead: the computer's clock was set back.
        return ahead <= period / 2 or ahead > 2e9 / settings.depth_rate

    async def _room(self, group: set[asyncio.Task[None]], kinds: set[Kind]) -> set[Kind]:
        """The kinds, or none when too much is in work; waits for it where frames must not be skipped."""
        config = self.studio.config
        matching = config.depth_mode == "matched" and group is self._depth_tasks
        limit = 1 if matching or self._clock.simulated else config.frames_in_flight
        while kinds and len(group) >= limit:
            if config.rate == "device" and not self._clock.simulated:
                self.counts.skipped += 1
                return set()
            self._hub.changed.clear()
            changed = asyncio.ensure_future(self._hub.changed.wait())
            await asyncio.wait((*group, changed), return_when=asyncio.FIRST_COMPLETED)
            changed.cancel()
            if len(self._hub) == 0:
                self._end_frames()
                return set()
        return kinds

    def _end_frames(self) -> None:
        """End the frames in work, which no client waits for any more."""
        for task in self._tasks | self._depth_tasks:
            task.cancel()

    async def _take(self, settings: StreamSettings, plain: set[Kind], depth: set[Kind], period: int) -> None:
        """Notes the scene as it is now and lets the sets be made."""
        epoch = self._hub.epoch()
        stamp = self._clock.stamp(self._stamp, period)
        camera = await self._shot(
            self._number + 1, self._injector.stamp(stamp), settings.lines(depth=False), plain | depth
        )
        if camera is None:
            return
        self._number += 1
        self._stamp = stamp
        frame = None
        if plain:
            kinds = plain if settings.separate_depth else plain | depth
            self._last = frame = self._frame(settings, camera, camera, kinds, epoch)
            self._spawn(self._tasks, self._make(frame, plain))
        if not depth:
            return
        due, every = self._depth_next, 1e9 / settings.depth_rate
        self._depth_next = stamp + every if due is None or stamp - due > every else due + every
        self._trigger.taken()
        if settings.separate_depth:
            # Exposures alternate every 40 ms: the next camera images come after the depth exposure, never with it.
            pause = max(2 * ALTERNATE_GAP - period, 0)
            self._next += pause / 1e9
            if self._clock.simulated:
                self._stamp += pause
            self._spawn(self._depth_tasks, self._expose_again(settings, camera, depth, epoch))
            return
        if frame is None:
            frame = self._frame(settings, camera, camera, depth, epoch)
        self._last_depth = frame
        self._spawn(self._depth_tasks, self._acquire(frame, depth))

    async def _expose_again(self, settings: StreamSettings, camera: Shot, kinds: set[Kind], epoch: int) -> None:
        """Takes the depth images 40 ms after the camera images, with the outputs that depth wants."""
        if self.studio.config.rate == "device":
            await asyncio.sleep(ALTERNATE_GAP / 1e9)
        shot = await self._shot(camera.index, camera.timestamp + ALTERNATE_GAP, settings.lines(depth=True), kinds)
        if shot is None:
            return
        self._last_depth = self._frame(settings, camera, shot, kinds, epoch)
        await self._acquire(self._last_depth, kinds)

    def _frame(self, settings: StreamSettings, camera: Shot, depth: Shot, kinds: set[Kind], epoch: int) -> Frame:
        frame = Frame(self.studio, self._workers, camera.index, settings, camera, depth, kinds, epoch)
        self.history.append(Record(camera.index, settings, camera, depth, self.studio))
        return frame

    async def _shot(self, index: int, stamp: int, lines: int, kinds: set[Kind]) -> Shot | None:
        """The scene and the pose as they are now; None when there is none, which the clients are told."""
        try:
            async with self._sampling:
                scene, revision, pose = await self._workers.run(self._sample)
        except QueueFull:
            self.counts.busy += 1
        except Exception as error:  # noqa: BLE001 - the camera outlives a scene that cannot be had
            for kind in kinds:
                self._fail(kind, "the scene could not be read", error)
        else:
            return Shot(stamp, scene, revision, pose, lines, index)
        return None

    def _sample(self) -> tuple[DrawList, int, NDArray[np.float64]]:
        scene, revision = self._scene()
        return scene, revision, self._pose()

    async def _acquire(self, frame: Frame, kinds: set[Kind]) -> None:
        """Takes the images of a depth frame, tells who listens, and makes the sets."""
        # Averaged images are there when the last of them is taken; the timestamp is the first one's.
        gap = round((frame.settings.averaged - 1) / frame.settings.camera_rate * 1e9)
        if self.studio.config.rate == "device":
            await asyncio.sleep(gap / 1e9)
        stamp = frame.depth.timestamp
        self._events.depth_acquisition_done(stamp, stamp + gap if self._clock.simulated else time.time_ns())
        await self._make(frame, kinds)

    async def _make(self, frame: Frame, kinds: set[Kind]) -> None:
        begin = asyncio.get_running_loop().time()
        try:
            await asyncio.gather(*(self._publish(frame, kind) for kind in kinds))
        except asyncio.CancelledError:
            frame.discard()
            raise
        if any(k.depth for k in kinds):
            self.counts.depth_frames += 1
            self.counts.depth_seconds = asyncio.get_running_loop().time() - begin
        self.counts.frames += 1
        if frame.taken is not None:
            self.last_taken = frame.taken

    async def _publish(self, frame: Frame, kind: Kind) -> None:
        try:
            data = await frame.serialised(kind)
        except QueueFull:
            self.counts.busy += 1
        except Exception as error:  # noqa: BLE001 - told to the clients, who would wait for ever otherwise
            self._fail(kind, f"frame {frame.number} ({kind}) could not be made", error)
        else:
            self.counts.problem = ""
            put = partial(self._hub.publish, kind, frame.number, data, frame.epoch)
            self._injector.deliver(frame.number, data, put)

    def _fail(self, kind: Kind, what: str, error: Exception) -> None:
        """Ends the streams of a kind with the reason; a defect of ours gets a traceback in the log."""
        message = f"{what}: {error}"
        _log.warning(message, exc_info=None if isinstance(error, _FORESEEN) else error)
        self.counts.problem = message
        self._hub.fail(kind, message)

    def _serve_newcomers(self) -> None:
        """Who joins while others stream gets their last frame at once instead of waiting for the next."""
        for kind in self._hub.take_newcomers():
            frame = self._last_depth if kind.depth else self._last
            settings = self.settings
            if frame is None or self._stamp is None or frame.epoch != self._hub.epoch() or settings.single:
                continue
            rate = settings.depth_rate if kind.depth else settings.camera_rate
            now = self._injector.stamp(self._clock.stamp(self._stamp, 0))
            if now - frame.depth.timestamp < 1e9 / rate:
                self._spawn(self._tasks, self._make(frame, {kind}))

    def _spawn(self, group: set[asyncio.Task[None]], work: Any) -> None:
        task: asyncio.Task[None] = asyncio.get_running_loop().create_task(work)
        group.add(task)
        task.add_done_callback(group.discard)
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            self.counts.problem = str(error)
            _log.error(f"a frame could not be made: {error}", exc_info=error)
        self._hub.changed.set()


async def _wait(event: asyncio.Event, seconds: float) -> None:
    try:
        async with asyncio.timeout(seconds):
            await event.wait()
    except TimeoutError:
        pass
