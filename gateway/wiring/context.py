"""What the rooms are given when they are joined, and the care for those that run on their own."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import structlog
from fastapi import FastAPI
from fastapi.telemetry import TelemetryConfig

from gateway.runtime.metrics_registry import Metrics
from gateway.runtime.service_registry import Service, ServiceRegistry
from gateway.runtime.worker_pool import WorkerPool
from gateway.scene.flatten import Flattener
from gateway.scene.labels import LabelTable
from gateway.scene.live import LiveTree
from gateway.server.security import Security
from gateway.settings import Settings
from renderers.camera import Camera
from renderers.interface import Renderer

if TYPE_CHECKING:
    from gateway.render.events import RenderRecord
    from gateway.state.service import PersistentState
    from gateway.viewer.sources import StereoSource

_log = structlog.get_logger("gateway")

LAST_WORDS: Final = 0.9
"""Part of --shutdown-seconds after which calls that wait for a thread are refused: the rest is for telling."""
NO_TELEMETRY: TelemetryConfig = {"tracing": False, "metrics": False, "logs": False, "auto_configure": False}
"""FastAPI's own; it would configure exporters from the environment."""


@dataclass(slots=True, eq=False)
class House:
    """Shared by all rooms of one application."""

    settings: Settings
    app: FastAPI
    registry: ServiceRegistry
    metrics: Metrics
    tree: LiveTree
    workers: WorkerPool
    """Threads for work that must not hold the event loop."""
    security: Security
    """Tokens, TLS and hosts of every interface."""
    labels: LabelTable = field(default_factory=LabelTable)
    """Of the live tree: one number a path."""
    flattener: Flattener = field(init=False)
    """Of the live tree; what did not change is not made again, whoever asks."""
    stereo_camera: Callable[[], Camera | None] = lambda: None
    """The left camera of the stereo sensor as it is now, if there is one."""
    eyes: StereoSource | None = None
    """Pictures of the stereo sensor for people, if there is one."""
    on_render: Callable[[RenderRecord], None] = lambda record: None
    """Told about every answered request of the render endpoint."""
    state: PersistentState | None = None
    """What survives the process, if anything does."""
    _renderer: Renderer | None = None
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)
    _leaving: asyncio.Task[None] | None = None
    _deadline: float = 0.0
    """Of renders, seconds of the loop's clock; set when leaving."""

    def __post_init__(self) -> None:
        self.flattener = Flattener(self.labels)

    @property
    def renderer(self) -> Renderer:
        """The one renderer; its module is imported on first use, which must be after the kernels are cached."""
        if self._renderer is None:
            from renderers.raster import CpuRenderer

            threads = self.settings.frame_threads or self.workers.threads
            beside = max(0, threads - self.workers.threads)
            self._renderer = CpuRenderer(threads, lambda: beside + self.workers.spare)
        return self._renderer

    def serve(
        self,
        name: str,
        service: Service,
        *,
        where: str = "",
        figures: Callable[[], Mapping[str, Any]] | None = None,
    ) -> None:
        """Runs a service until the end; its failure is one line in the log and on the registry, the others run on."""
        self.registry.ready(name, service=service, where=where, figures=figures)
        task = asyncio.get_running_loop().create_task(self._care(name, service), name=name)
        self._tasks.add(task)

    async def _care(self, name: str, service: Service) -> None:
        try:
            await service.run()
        except Exception as error:  # noqa: BLE001 - whatever it is, the other interfaces do not suffer
            self.fail(name, error)
        else:
            self.registry.fail(name, "it has ended by itself")

    def fail(self, name: str, error: BaseException) -> None:
        """Notes why an interface does not work."""
        problem = sentence(error)
        self.registry.fail(name, problem)
        # Foreseen failures need no traceback; a defect of ours does.
        foreseen = isinstance(error, (OSError, ImportError, ValueError, RuntimeError))
        _log.error(f"{name} does not run: {problem}", exc_info=None if foreseen else error)

    def leave(self) -> None:
        """The end has begun: streams end now, accepted renders go on, and before their time is over those that still
        wait for a thread are told so instead of being cut off. Calling it again does nothing."""
        if self._leaving is not None:
            return
        loop = asyncio.get_running_loop()
        self.registry.stop()
        for task in self._tasks:
            task.cancel()
        self._deadline = loop.time() + self.settings.shutdown_seconds
        self._leaving = loop.create_task(self._give_up(LAST_WORDS * self.settings.shutdown_seconds), name="leave")

    async def _give_up(self, seconds: float) -> None:
        await asyncio.sleep(seconds)
        await self.workers.close(0.0)

    async def close(self) -> None:
        """Ends every service, then the threads."""
        self.leave()
        assert self._leaving is not None
        for task in self._tasks:  # some may have been started since
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self.state is not None:
            await self.state.close()
        self._leaving.cancel()
        await self.workers.close(max(0.0, self._deadline - asyncio.get_running_loop().time()))


def sentence(error: BaseException) -> str:
    """An exception as one line for people."""
    text = " ".join(str(error).split())
    return text if text and not isinstance(error, KeyError) else f"{type(error).__name__}: {text}"
