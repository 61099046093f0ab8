"""The stereo camera as a long-running service: parameters, frames and their stream."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Iterable
from typing import Any

import structlog

from gateway.runtime.worker_pool import WorkerPool
from gateway.stereo import server
from gateway.stereo.clock import Clock, SystemClock
from gateway.stereo.config import StereoConfig
from gateway.stereo.events import EventHub
from gateway.stereo.faults import FaultInjector
from gateway.stereo.frame_clock import Counts, Metronome, PoseSource, Record, SceneSource
from gateway.stereo.hub import Hub
from gateway.stereo.images import Metered, Studio
from gateway.stereo.pairs import PairStudio
from gateway.stereo.parameters import Parameters
from gateway.stereo.settings import NEUTRAL_BLUE, NEUTRAL_RED, StreamSettings
from gateway.stereo.trigger import Trigger
from renderers.interface import Renderer

_log = structlog.get_logger("stereo")


class StereoService:
    """Serves image sets of whatever scene it is given."""

    def __init__(
        self,
        config: StereoConfig,
        scene: SceneSource,
        pose: PoseSource,
        renderer: Renderer,
        workers: WorkerPool,
        clock: Clock | None = None,
    ) -> None:
        """
        Args:
            config: what is fixed from start to end.
            scene: the scene as it is now and its revision; called in a worker thread.
            pose: (4, 4) float64 X_world_left, the left optical frame; called right after ``scene`` in the same thread.
            renderer: draws; must be thread-safe.
            workers: threads for everything that takes longer than a moment.
            clock: of the timestamps; None: the computer's.
        """
        self.parameters = Parameters()
        self.stored: Callable[[], Awaitable[str]] | None = None
        """Waits until the parameters are stored, where they are: empty, or why they could not be."""
        self.trigger = Trigger()
        self._scene_studio = Studio(config, renderer)
        self.workers = workers
        self._shows = 0
        self.hub = Hub(config.max_clients, config.max_kinds, self._epoch)
        self.events = EventHub(config.max_clients, config.max_events)
        self.injector = FaultInjector(config.seed, config.max_late_bytes)
        self.started = time.time()
        self._metronome = Metronome(
            self._scene_studio,
            workers,
            self.hub,
            self.events,
            self.injector,
            self.parameters,
            scene,
            pose,
            clock or SystemClock(),
            self.trigger,
        )
        self._port: int | None = None

    def _epoch(self) -> int:
        """Grows with everything that changes what sets are like."""
        return self.parameters.version + self.injector.changes + self._shows

    @property
    def studio(self) -> Studio:
        """What makes the pictures of new frames: of the scene, or of pairs that were given."""
        return self._metronome.studio

    @property
    def config(self) -> StereoConfig:
        """What is fixed from start to end; model and depth mode are those of the pairs while such are shown."""
        return self.studio.config

    def show_pairs(self, studio: PairStudio | None) -> None:
        """Shows pairs from the next frame on; None: the scene again."""
        self._metronome.studio = studio or self._scene_studio
        self._shows += 1
        self.hub.changed.set()

    @property
    def scene_studio(self) -> Studio:
        """The one of the scene, whatever is shown."""
        return self._scene_studio

    @property
    def ready(self) -> bool:
        """Whether clients can connect."""
        return self._port is not None

    @property
    def port(self) -> int:
        """The port that is served; 0 before that."""
        return self._port or 0

    @property
    def settings(self) -> StreamSettings:
        """The parameters that act on the stream, as they are now."""
        return self._metronome.settings

    @property
    def last_taken(self) -> Metered:
        """How the newest left image was taken; before the first, the manual settings."""
        return self._metronome.last_taken or Metered(self.settings.manual, 0.0)

    @property
    def counts(self) -> Counts:
        """What happened since start."""
        return self._metronome.counts

    @property
    def history(self) -> list[Record]:
        """The newest frames, oldest first."""
        return list(self._metronome.history)

    async def run(self) -> None:
        """Serves until cancelled.

        Raises:
            OSError: the port is taken, or a certificate cannot be read; one sentence.
        """
        running, self._port, leave = await server.start(self.hub, self.events, self.injector, self.config)
        model = self.config.model
        _log.info(f"{model.name} on port {self._port}", baseline=model.baseline, depth=self.config.depth_mode)
        try:
            await self._metronome.run()
        finally:
            self._port = None
            self.hub.close("the stereo camera is shutting down")
            await server.stop(running, leave)

    def set_parameters(self, node: str, values: Iterable[tuple[str, object]]) -> list[str]:
        """Sets parameters, all or none; see ``Parameters.set``. When an automatic is switched off, what it has found
        last becomes the manual value, as on the device."""
        before, automatic = self.settings, self.last_taken.exposure
        balanced = self.parameters.values("rc_camera")["wb_auto"]
        names = self.parameters.set(node, values)
        found: dict[str, float] = {}
        if before.auto is not None and self.settings.auto is None:
            found |= {"exp_value": automatic.time, "gain_value": automatic.gain}
        if balanced and not self.parameters.values("rc_camera")["wb_auto"]:
            found |= {"wb_ratio_red": NEUTRAL_RED, "wb_ratio_blue": NEUTRAL_BLUE}
        self.parameters.set("rc_camera", [(name, value) for name, value in found.items() if name not in names])
        return names

    def fire_trigger(self) -> tuple[int, str]:
        """Asks for one depth image in a single-frame mode; the device's return code and a message."""
        code = self.trigger.fire(single=self.settings.single, wanted=any(k.depth for k in self.hub.kinds()))
        self.hub.changed.set()
        return code

    def status(self) -> dict[str, Any]:
        """Figures for health pages: plain values."""
        c = self.counts
        return {
            "model": self.config.model.name,
            "port": self.port,
            "clients": len(self.hub),
            "event_clients": len(self.events),
            "kinds": sorted(map(str, self.hub.kinds())),
            "depth_mode": self.config.depth_mode,
            "quality": self.settings.quality.value,
            "frames": c.frames,
            "depth_frames": c.depth_frames,
            "skipped": c.skipped,
            "busy": c.busy,
            "depth_seconds": round(c.depth_seconds, 4),
            **({"warning": c.problem} if c.problem else {}),
        }
