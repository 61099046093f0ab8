"""A stereo camera as a long-running service: parameters, frames and the stream of image sets."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import replace
from typing import Any, Final

import structlog

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import NEUTRAL_BLUE, NEUTRAL_RED, StreamSettings, read_settings
from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from gateway.adapters.stereo.imaging.depth_measurement import MeasureArguments, MeasuredImages, measurement
from gateway.adapters.stereo.imaging.recorded_pairs import PairImaging, RecordedPairs, pair_imaging
from gateway.adapters.stereo.imaging.rendered_images import Imaging, MeteredExposure
from gateway.adapters.stereo.imaging.scene_view import Capture, SceneReader, SceneSource, SceneState
from gateway.adapters.stereo.stream.faults import FaultInjector
from gateway.adapters.stereo.stream.frame import FrameImages, FrameRecord
from gateway.adapters.stereo.stream.frame_publisher import FramePublisher
from gateway.adapters.stereo.stream.frame_scheduler import FrameScheduler
from gateway.adapters.stereo.stream.grpc_server import serving
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.adapters.stereo.stream.subscriptions import EventHub, ImageSetHub
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.tree.timeline import TimeError
from renderers.interface import Renderer

_log = structlog.get_logger("stereo")
REBOOT_REASON: Final = "the stereo camera reboots"


class StereoService:
    """One stereo camera."""

    def __init__(
        self,
        config: StereoConfig,
        scene: SceneSource,
        renderer: Renderer,
        workers: WorkerPool,
        on_streaming: Callable[[bool], None] = lambda streaming: None,
        has_unapplied_before: Callable[[int], bool] = lambda timestamp: False,
        pairs: RecordedPairs | None = None,
    ) -> None:
        """Serve the scene that ``scene`` returns at a time, called in worker threads; with ``pairs``, recorded images
        instead.

        ``on_streaming`` is called with True when clients begin to stream images, and with False when there are none.
        ``has_unapplied_before`` is that of ``LiveTree``.
        """
        self.hub = ImageSetHub(config.max_clients, config.max_kinds, follows_demand=config.rate == "max")
        self.parameters = Parameters(config.limits, self._parameters_changed)
        self.wait_until_stored: Callable[[], Awaitable[str]] | None = None
        """Waits until the parameters are stored (--state); returns an error message, empty on success. Set before
        ``run``. None: no state file."""
        self.earlier_state: Callable[[float], Awaitable[SceneState]] | None = None
        """Returns the scene at an earlier time, as ``timeline.state_at``. Set before ``run``. None: it is a file."""
        self.imaging: Final = Imaging(config, renderer) if pairs is None else pair_imaging(config, renderer, pairs)
        """Source of images: the scene, or recorded pairs."""
        self.config: Final = self.imaging.config
        """Fixed configuration. With recorded pairs, it has their camera model and depth mode."""
        self.workers = workers
        self.events = EventHub(config.max_clients, config.max_events)
        self.injector: FaultInjector | None = None
        """Injects faults; None: they are not permitted."""
        if config.faults:
            self.injector = FaultInjector(config.seed, config.max_late_bytes, self.hub.start_generation)
        self.started = time.time()
        """Time of the start, seconds since the epoch."""
        self._publisher = FramePublisher(self.hub, self.events, self.injector, config)
        self.counts = self._publisher.counts
        """Counters since start."""
        self._reader = SceneReader(scene, workers, config, has_unapplied_before)
        self._scheduler = FrameScheduler(
            self.imaging, self._reader, workers, self._publisher, read_settings(self.parameters), on_streaming
        )
        self.measured: MeasuredImages | None = None
        """Depth images of the last ``measure_depth``; None: there was none."""
        self._captures = 0
        """Number of captures apart from the stream."""
        self._port: int | None = None
        """Port of the image stream; None while it is closed."""

    def _parameters_changed(self) -> None:
        self._scheduler.settings = read_settings(self.parameters)
        self.hub.start_generation()

    @property
    def ready(self) -> bool:
        """True if clients can connect."""
        return self._port is not None

    @property
    def port(self) -> int:
        """Port of the image stream; 0 before it is open."""
        return self._port or 0

    @property
    def settings(self) -> StreamSettings:
        """Current values of the parameters that affect the stream."""
        return self._scheduler.settings

    @property
    def last_metered(self) -> MeteredExposure:
        """Exposure of the newest left image; before the first, the manual one."""
        return self._publisher.last_metered or MeteredExposure(self.settings.manual_exposure, 0.0)

    @property
    def history(self) -> list[FrameRecord]:
        """The last frames, oldest first."""
        return list(self._scheduler.history)

    async def run(self) -> None:
        """Serve until cancelled. Raises OSError, one sentence: the port is taken, or a certificate cannot be read."""
        async with serving(self.hub, self.events, self.injector, self.config) as self._port:
            model = self.config.model
            _log.info(f"{model.name} on port {self._port}", baseline=model.baseline, depth=self.config.depth_mode)
            try:
                await self._scheduler.run()
            finally:
                self._port = None
                for streams in (self.hub, self.events):
                    streams.close("the stereo camera is shutting down")

    async def capture(self, kind: SetKind, scene_time: float | None = None) -> FrameImages:
        """Capture the scene apart from the stream, with the current parameters, and return a frame for sets of a kind.

        Nothing in the frame is blurred by motion. ``scene_time``: seconds, as for
        ``gateway.scene.tree.timeline.state_at``; None: now. Raises QueueFull, or TimeError without a state of this
        time, or if the camera does not see the live scene.
        """
        imaging, settings, timestamp = self.imaging, self.settings, time.time_ns()
        if scene_time is None:
            state, _ = await self._reader.read(timestamp)
        elif self.earlier_state is None or isinstance(imaging, PairImaging):
            raise TimeError(f"time={scene_time:g}: the camera {self.config.name!r} does not see the live scene")
        else:
            state = await self.earlier_state(scene_time)
            timestamp = state.timestamp
        self._captures += 1
        camera_capture = Capture.of_state(state, settings, timestamp, self._captures, depth=False)
        depth_capture = camera_capture
        if settings.separate_depth:
            depth_capture = Capture.of_state(state, settings, timestamp, self._captures, depth=True)
        return FrameImages(FrameRecord(imaging, settings, camera_capture, depth_capture), self.workers, (kind,))

    def set_parameters(self, node: str, values: Iterable[tuple[str, object]]) -> list[str]:
        """Set parameters, all or none; see ``Parameters.set``.

        When an automatic mode is switched off, its last result becomes the manual value, as on the device.
        """
        had_auto_exposure, exposure = self.settings.auto_exposure is not None, self.last_metered.exposure
        had_auto_white_balance = self.parameters.values("rc_camera")["wb_auto"]
        changed_names = self.parameters.set(node, values)
        manual: dict[str, float] = {}
        if had_auto_exposure and self.settings.auto_exposure is None:
            manual |= {"exp_value": exposure.time, "gain_value": exposure.gain}
        if had_auto_white_balance and not self.parameters.values("rc_camera")["wb_auto"]:
            # Automatic white balance shows colours as rendered, always.
            manual |= {"wb_ratio_red": NEUTRAL_RED, "wb_ratio_blue": NEUTRAL_BLUE}
        # Values that the client has set in the same call stay.
        self.parameters.set("rc_camera", [item for item in manual.items() if item[0] not in changed_names])
        return changed_names

    async def measure_depth(self, arguments: MeasureArguments) -> dict[str, Any]:
        """Measure depth in a region, as the device's ``rc_measure`` does, and return its response.

        Raises ValueError, one sentence, for an invalid argument or without a last image; QueueFull.
        """
        region = arguments.check(self.config.model)
        start = time.monotonic()
        if arguments.data_acquisition_mode == "CAPTURE_NEW":
            frame = await self.capture(SetKind(disparity=True))
            timestamp = self._publisher.sent_timestamp(frame.record.depth_capture.timestamp)
            divisor = frame.record.settings.quality.divisor
            images = await frame.depth_images()
            self.measured = MeasuredImages(images, divisor, timestamp, time.monotonic() - start)
        if self.measured is None:
            raise ValueError("data_acquisition_mode: nothing was captured yet that USE_LAST could measure")
        start = time.monotonic()
        model, cells = self.config.model, arguments.cell_count
        response = await self.workers.run(measurement, self.measured, model, region, cells)
        self.measured = replace(self.measured, processing_seconds=time.monotonic() - start)
        return response

    def reboot(self) -> None:
        """End all streams and begin anew, with the parameters as they are."""
        for kind in self.hub.kinds:
            self.hub.end_streams(kind, REBOOT_REASON)
        self.events.end_streams(REBOOT_REASON)
        self.measured, self.imaging.exposure_memory.out1_high = None, None
        self.started = time.time()

    @property
    def time(self) -> float:
        """The device's time, seconds since the epoch. Timestamps are in it."""
        return time.time() + self._publisher.clock_offset / NANOSECONDS_PER_SECOND

    @time.setter
    def time(self, seconds: float) -> None:
        self._publisher.clock_offset = round((seconds - time.time()) * NANOSECONDS_PER_SECOND)

    def fire_trigger(self) -> tuple[int, str]:
        """Request one depth image in a single-frame mode. Return the device's return code and a message."""
        if not self.settings.single_frame:
            return -8, "Triggering is only possible in SingleFrame acquisition mode"
        if not any(kind.has_depth for kind in self.hub.kinds):
            return 102, "Trigger is ignored, because there are no subscribers"
        if self._scheduler.trigger_time is not None:
            return 101, "Trigger is ignored, because there is a trigger call pending"
        self._scheduler.trigger_time = asyncio.get_running_loop().time()
        self.hub.scheduler_wakeup.set()
        return 0, ""

    def status(self) -> dict[str, Any]:
        """Return plain values for the health endpoint."""
        counts = self.counts
        return {
            "model": self.config.model.name,
            "port": self.port,
            "clients": len(self.hub),
            "event_clients": len(self.events),
            "kinds": sorted(map(str, self.hub.kinds)),
            "depth_mode": self.config.depth_mode,
            "quality": self.settings.quality.value,
            "frames": counts.frames,
            "depth_frames": counts.depth_frames,
            "skipped": counts.skipped,
            "busy": counts.dropped,
            "sets_skipped": self.hub.skipped,
            "depth_seconds": round(counts.depth_seconds, 4),
            **({"warnings": [counts.problem]} if counts.problem else {}),
        }
