"""Makes the image sets of captured frames in tasks and publishes them."""

import asyncio
import time
from collections.abc import Collection, Coroutine
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import structlog

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from gateway.adapters.stereo.imaging.rendered_images import MeteredExposure
from gateway.adapters.stereo.stream.faults import FaultInjector
from gateway.adapters.stereo.stream.frame import FrameImages
from gateway.adapters.stereo.stream.image_messages import depth_acquisition_done
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.adapters.stereo.stream.subscriptions import EventHub, ImageSetHub
from gateway.runtime.logs import tracing
from gateway.runtime.workers.pool_errors import DeadlineExceeded, PoolClosed, QueueFull

_log = structlog.get_logger("stereo")
_EXPECTED_ERRORS: Final = (ValueError, OSError, DeadlineExceeded, PoolClosed)
"""Errors that are logged without a traceback."""


@dataclass(slots=True)
class FrameCounts:
    """Counters since start."""

    frames: int = 0
    """Number of frames made."""
    depth_frames: int = 0
    """Number of frames made with depth."""
    skipped: int = 0
    """Number of frames that were due, but missed, or not made because too many were in flight."""
    dropped: int = 0
    """Number of sets and captures dropped because the worker queue was full."""
    problem: str = ""
    """Last error; empty after a frame of which all sets were made."""
    camera_seconds: float = 0.0
    """Seconds from capture to publication of the last frame without depth."""
    depth_seconds: float = 0.0
    """Seconds from capture to publication of the last depth frame."""


@dataclass(slots=True, eq=False)
class FramesInFlight:
    """Camera or depth frames that are being made."""

    tasks: set[asyncio.Task[Any]] = field(default_factory=set)
    """One task per frame."""
    last: FrameImages | None = None
    """Newest depth frame, finished or not."""

    def __len__(self) -> int:
        return len(self.tasks)

    @property
    def is_measured(self) -> bool:
        """True if the newest frame in flight needs no more images for depth."""
        return not self.tasks or self.last is None or self.last.measuring.is_set()

    def cancel(self) -> None:
        """Cancel the frames in flight."""
        for task in self.tasks:
            task.cancel()


class FramePublisher:
    """Makes each kind of image set of a frame once, and publishes it to all clients."""

    def __init__(
        self, hub: ImageSetHub, events: EventHub, injector: FaultInjector | None, config: StereoConfig
    ) -> None:
        """Publish sets to ``hub``, image events to ``events``. ``injector`` None: faults are not permitted."""
        self.counts = FrameCounts()
        self.last_metered: MeteredExposure | None = None
        """Exposure of the newest left image."""
        self.clock_offset = 0
        """Nanoseconds by which timestamps are ahead of the computer's clock: the device's time can be set."""
        self.hub = hub
        self._injector = injector
        self._event_clients = events
        self._config = config

    def spawn(self, frames: FramesInFlight, make_frame: Coroutine[Any, Any, object]) -> None:
        """Run ``make_frame`` in a task that is one of ``frames``."""
        task = asyncio.get_running_loop().create_task(make_frame)
        frames.tasks.add(task)
        task.add_done_callback(frames.tasks.discard)
        task.add_done_callback(self._on_task_done)

    def sent_timestamp(self, timestamp: int) -> int:
        """Return the timestamp that clients get for a true one, nanoseconds; an injected fault may falsify it."""
        timestamp += self.clock_offset
        return timestamp if self._injector is None else self._injector.timestamp(timestamp)

    async def publish_sets(self, frame: FrameImages, kinds: Collection[SetKind]) -> None:
        """Make and publish the sets of a frame."""
        start = asyncio.get_running_loop().time()
        with tracing.span("stereo frame", attributes={"stereo.frame": frame.record.number}):
            published = await asyncio.gather(*[self._publish_set(frame, kind) for kind in kinds])
        if all(published):
            self.counts.problem = ""
        seconds = asyncio.get_running_loop().time() - start
        if any(kind.has_depth for kind in kinds):
            self.counts.depth_frames += 1
            self.counts.depth_seconds = seconds
        else:
            self.counts.camera_seconds = seconds
        self.counts.frames += 1
        if frame.left_metered is not None:
            self.last_metered = frame.left_metered

    async def publish_depth_sets(self, frame: FrameImages, kinds: Collection[SetKind]) -> None:
        """Wait for the last exposure of a depth frame, send the image event, then make and publish the sets."""
        # The timestamp of a depth frame is that of the first image in the average.
        settings, timestamp = frame.record.settings, frame.record.depth_capture.timestamp
        duration = round((settings.averaged_images - 1) / settings.camera_rate * NANOSECONDS_PER_SECOND)
        if self._config.rate == "device":
            await asyncio.sleep(duration / NANOSECONDS_PER_SECOND)
        if len(self._event_clients):
            done = timestamp + duration if self._config.simulated_clock else time.time_ns() + self.clock_offset
            self._event_clients.put(depth_acquisition_done(timestamp, done))
        await self.publish_sets(frame, kinds)

    def end_streams(self, kind: SetKind, problem: str, error: Exception) -> None:
        """End the streams of a kind and log the reason, with a traceback for unexpected errors."""
        message = f"{problem}: {error}"
        _log.warning(message, exc_info=None if isinstance(error, _EXPECTED_ERRORS) else error)
        self.counts.problem = message
        self.hub.end_streams(kind, message)

    async def _publish_set(self, frame: FrameImages, kind: SetKind) -> bool:
        """Make and publish one set of a frame; return True if it was made."""
        number = frame.record.number
        try:
            with tracing.span("stereo set", attributes={"stereo.set": kind.title}):
                data = await frame.serialised(kind)
        except QueueFull:
            self.counts.dropped += 1
        except Exception as error:  # noqa: BLE001 - otherwise the clients would wait forever
            self.end_streams(kind, f"frame {number} ({kind}) could not be made", error)
        else:
            publish = partial(self.hub.publish, kind, number, data, frame.record.generation)
            if self._injector is None:
                publish()
            else:
                self._injector.deliver(number, data, publish)
            return True
        return False

    def _on_task_done(self, task: asyncio.Task[Any]) -> None:
        """Report an unexpected error, and let the scheduler look for frames that may start now."""
        if not task.cancelled() and (error := task.exception()) is not None:
            self.counts.problem = str(error)
            _log.error(f"a frame could not be made: {error}", exc_info=error)
        self.hub.notify_demand()
