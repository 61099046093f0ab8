"""Objects shared by all interfaces of one application, what they provide, and the supervision of their services."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Final

import structlog
from fastapi import FastAPI

from gateway.replay.history import TreeHistory
from gateway.runtime.http.interface_names import title_of
from gateway.runtime.http.security import Security
from gateway.runtime.kernels.loading import KernelLoader
from gateway.runtime.lcm.listener import ChannelListener
from gateway.runtime.logs.metrics_registry import Metrics
from gateway.runtime.service_registry import Service, ServiceRegistry, one_line
from gateway.runtime.settings import MIB, Settings
from gateway.runtime.workers import process_tuning
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.live_scene import LiveScene
from gateway.scene.draw.style import Style
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree, Snapshot
from renderers.camera import Camera
from renderers.interface import Renderer

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from gateway.adapters.stereo.service import StereoService
    from gateway.adapters.viewer.sources import StereoSource
    from gateway.files.assets.mesh_files import MeshFiles
    from gateway.replay.log_service import LogService
    from gateway.runtime.logs.render_record import RenderRecord
    from gateway.runtime.state.service import PersistentState
    from gateway.runtime.workers.worker_reports import WorkerReports
    from gateway.scene.tree.timeline import Timeline

_log = structlog.get_logger("gateway")

QUEUE_SHARE: Final = 0.9
"""Fraction of --shutdown-seconds after which calls that still wait for a thread get 503."""
IDLE_SECONDS: Final = 10.0
"""Time without work after which the memory of earlier frames and scenes is returned to the system."""


@dataclass(frozen=True)
class ProvidedCamera:
    """The first stereo camera."""

    service: StereoService
    sensor: StereoSource
    """Its images for the browser view."""
    camera: Callable[[Snapshot], Camera | None]
    """Returns its left camera in a snapshot of the live tree; None if it sees another scene."""


@dataclass(frozen=True)
class Provided:
    """Parts that started interfaces provide to later ones. A set-up returns it with its own part added."""

    recent_renders: Sequence[RenderRecord] = ()
    """Newest finished requests of the render endpoint, oldest first."""
    lcm_listeners: tuple[ChannelListener, ...] = ()
    """Receivers of channels besides those of the tree viewer."""
    stereo: ProvidedCamera | None = None


@dataclass(eq=False)
class Context:
    """Shared objects of one application. What interfaces provide to each other is in ``Provided``."""

    settings: Settings
    app: FastAPI
    registry: ServiceRegistry
    """State of every interface, for ``/healthz`` and ``/readyz``."""
    metrics: Metrics
    workers: WorkerPool
    """Threads for calls that would block the event loop."""
    camera_workers: WorkerPool
    """Threads for the cameras, which the other workers give way to."""
    security: Security
    """Tokens, TLS and trusted hosts of every interface."""
    tree: LiveTree
    page: LivePage = field(default_factory=LivePage)
    """View settings of the live tree's page, as set by clients: background, grid and so on."""
    labels: LabelTable = field(default_factory=LabelTable)
    """Labels of the live tree's paths."""
    state: PersistentState | None = None
    """Storage of the live tree and of parameters (``--state``)."""
    reports: WorkerReports | None = None
    """Reports of all processes, if there are several (``--workers``)."""
    log: LogService | None = None
    """Log that is shown in place of the live tree."""
    supervisor: Connection | None = None
    """Connection to their supervisor, for heartbeats."""

    page_url: str = ""
    """Address of the page to open first, for the log; empty where it is not known."""
    on_started: Callable[[], None] = lambda: None
    """Called once, when every interface is ready or has failed."""
    on_fatal: Callable[[], None] = lambda: None
    """Called when the process must end with an error."""
    exit_stack: ExitStack = field(default_factory=ExitStack)
    """Context managers that are closed by ``close``."""
    started: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when requests are accepted, or when the start has failed."""
    not_started_reason: str = ""
    """Reason why the gateway did not start, a clause for clients; empty before and after a start."""

    _startup: asyncio.Task[None] | None = None
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)
    _queue_closer: asyncio.Task[None] | None = None
    _deadline: float = 0.0
    """End of --shutdown-seconds, on the loop's clock."""

    @cached_property
    def kernels(self) -> KernelLoader:
        """Loader of compiled kernels."""
        return KernelLoader(self.registry, self.exit_stack)

    @cached_property
    def flattener(self) -> Flattener:
        """Draw lists of the live tree, shared so that an unchanged tree is flattened once."""
        return Flattener(self.labels)

    @cached_property
    def history(self) -> TreeHistory | None:
        """Earlier states of the live tree (``--history-seconds``), if an interface shows them."""
        settings = self.settings
        if not settings.history_seconds or not (settings.is_enabled("scene") or settings.is_enabled("view")):
            return None
        max_bytes = settings.history_mb * MIB
        return TreeHistory(self.tree, settings.history_seconds, max_bytes, asyncio.to_thread)

    @cached_property
    def style(self) -> Style:
        """Shading of the render endpoint. The first use reads the file of ``--rig``."""
        from gateway.files.assets.light_rig_file import rig_of

        settings = self.settings
        rig, alpha = rig_of(settings.rig), settings.alpha_threshold
        return Style(settings.look, settings.background, samples=settings.samples, rig=rig, alpha_threshold=alpha)

    @cached_property
    def renderer(self) -> Renderer:
        """The renderer of all interfaces. The first use imports compiled kernels, which must be in the cache."""
        from renderers.raster import CpuRenderer

        frame_threads = self.settings.frame_threads
        spare_threads = partial(self.workers.spare_threads, self.camera_workers, frame_threads)
        return CpuRenderer(frame_threads or self.workers.threads, spare_threads)

    @cached_property
    def mesh_files(self) -> MeshFiles:
        """Mesh files that all clients may name (``--mesh-root``). The first use imports compiled kernels."""
        from gateway.files.assets.mesh_files import MeshFiles

        return MeshFiles(self.settings.mesh_folders)

    @cached_property
    def local_mesh_files(self) -> MeshFiles:
        """Mesh files that programs on this machine may name; with ``--mesh-root auto``, those in all folders."""
        if not self.settings.local_clients_read_all_folders:
            return self.mesh_files
        from gateway.files.assets.mesh_files import MeshFiles

        return MeshFiles(self.settings.mesh_folders, any_folder=True)

    def live_scene(self, provided: Provided) -> LiveScene:
        """Return the live tree, for images and files of it, with the stereo camera in it."""
        camera = provided.stereo.camera if provided.stereo is not None else lambda snapshot: None
        return LiveScene(self.tree, self.flattener, self.timeline, camera)

    @property
    def timeline(self) -> Timeline | None:
        """States of the scene over time: the log that is shown, or the history of the live tree."""
        return self.log.timeline if self.log is not None else self.history

    async def return_memory_when_idle(self) -> None:
        """Return the memory of earlier frames and scenes to the system after a while without work; never ends."""
        work = at_last_return = (0, 0)  # calls in the worker threads, and revision of the live tree
        while True:
            await asyncio.sleep(IDLE_SECONDS)
            before = work
            work = self.workers.stats.done + self.camera_workers.stats.done, self.tree.snapshot.revision
            is_idle = self.workers.calls + self.camera_workers.calls == 0 and work == before
            if is_idle and work != at_last_return:
                at_last_return = work
                await asyncio.to_thread(process_tuning.return_memory)

    def begin_startup(self, start: Coroutine[Any, Any, None]) -> None:
        """Run ``start`` in a task; a shutdown cancels it."""
        self._startup = asyncio.create_task(start, name="start")

    def readiness(self) -> str:
        """Return the status for ``/readyz``: that of the registry, ``starting`` while requests wait, or ``busy``."""
        status = self.registry.verdict()
        if status in ("ready", "degraded") and not self.started.is_set():
            return "starting"
        # Only where renders are all that is served: a load balancer must not stop streams because of a full queue.
        render_only = self.settings.only == ("render",)
        return "busy" if status == "ready" and render_only and self.workers.busy else status

    def run_service(
        self, name: str, service: Service, *, where: str = "", figures: Callable[[], Mapping[str, Any]] | None = None
    ) -> None:
        """Run a service until shutdown. If it fails, log one line; the other services go on.

        For ``/healthz``: ``where`` is how clients reach it, ``figures`` returns JSON values, by default
        ``service.status``.
        """
        self.registry.ready(name, service=service, where=where, figures=figures)
        task = asyncio.get_running_loop().create_task(service.run(), name=name)
        self._tasks.add(task)
        task.add_done_callback(self._on_end)

    def _on_end(self, task: asyncio.Task[None]) -> None:
        """Mark the interface of a service that has ended as failed, unless it was cancelled."""
        if task.cancelled():
            return
        error = task.exception()
        if error is not None:
            self.fail(task.get_name(), error)
        else:
            self.registry.fail(task.get_name(), "it has ended by itself")

    def fail(self, name: str, error: BaseException) -> None:
        """Mark an interface as failed and log why."""
        problem = one_line(error)
        self.registry.fail(name, problem)
        expected = isinstance(error, (OSError, ImportError, ValueError, RuntimeError))
        _log.error(f"{title_of(name)} cannot be used: {problem}", exc_info=None if expected else error)

    def begin_shutdown(self) -> None:
        """End all streams and services now, and let accepted requests finish until ``--shutdown-seconds``.

        Requests that arrive before the start is complete get 503. A second call does nothing.
        """
        if self._queue_closer is not None:
            return
        loop = asyncio.get_running_loop()
        self.registry.stop()
        for task in self._tasks:
            task.cancel()
        self._deadline = loop.time() + self.settings.shutdown_seconds
        self._queue_closer = loop.create_task(self._close_queue(QUEUE_SHARE * self.settings.shutdown_seconds))
        if not self.started.is_set():
            if self._startup is not None:
                self._startup.cancel()
            self.reject_requests("it was told to stop")

    def reject_requests(self, reason: str) -> None:
        """Reject all requests with 503 and a reason, a clause without details of the server."""
        self.not_started_reason = reason
        self.started.set()

    async def _close_queue(self, seconds: float) -> None:
        """Reject the calls that still wait for a thread after ``seconds``."""
        await asyncio.sleep(seconds)
        await self._close_workers(0.0)

    async def _close_workers(self, seconds: float) -> None:
        await asyncio.gather(self.workers.close(seconds), self.camera_workers.close(seconds))

    async def close(self) -> None:
        """End the start, every service, the state and the worker threads."""
        if self._startup is not None:
            self._startup.cancel()
            await asyncio.gather(self._startup, return_exceptions=True)
        self.begin_shutdown()
        assert self._queue_closer is not None
        for task in self._tasks:  # including those started after begin_shutdown
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self.state is not None:
            await self.state.close()
        self._queue_closer.cancel()
        await self._close_workers(max(0.0, self._deadline - asyncio.get_running_loop().time()))
        self.exit_stack.close()
