"""The gateway as one FastAPI application: ``uvicorn gateway.app:app``, configured by the environment.

Its lifespan starts and stops every interface, including those that do not speak HTTP.
"""

from __future__ import annotations

import asyncio
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse
from fastapi_offline import FastAPIOffline

from gateway import __version__
from gateway.adapters.viewer.messages import IMAGE_NAMES
from gateway.runtime import settings as settings_module
from gateway.runtime.http import error_handlers, health, openapi
from gateway.runtime.http.interface_names import NAMES, documentation_of, documentation_url
from gateway.runtime.http.pages import docs_page, index_page
from gateway.runtime.http.path_prefix import PathPrefix
from gateway.runtime.http.security import Security
from gateway.runtime.http.start_gate import StartGate
from gateway.runtime.kernels.loading import FURTHER_KERNELS, KERNELS
from gateway.runtime.logs import log_setup
from gateway.runtime.logs.metrics_registry import Metrics
from gateway.runtime.service_registry import ServiceRegistry
from gateway.runtime.settings import MIB, Settings
from gateway.runtime.workers import process_tuning
from gateway.runtime.workers.scheduling import usable_cpus
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.tree.live import LiveTree
from gateway.wiring import metrics, telemetry
from gateway.wiring.context import Context
from gateway.wiring.startup import enabled_interfaces, start
from gateway.wiring.state import STATE, open_state
from gateway.wiring.worker_processes import write_worker_reports
from renderers.cache import SHARED

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from gateway.replay.log_service import LogService
    from gateway.runtime.state.service import PersistentState
    from gateway.runtime.workers.worker_reports import WorkerReports

DESCRIPTION = "Drake's glTF render server, an rc_visard stereo camera and Director's tree viewer, on one scene."
POLLED_PATHS = frozenset({"/view/sensor", "/view/renders", *(f"/view/sensor/{name}.jpg" for name in IMAGE_NAMES)})
"""Paths that the browser view requests repeatedly; logged at debug level."""


def create_app(
    settings: Settings,
    state: PersistentState | None = None,
    reports: WorkerReports | None = None,
    log: LogService | None = None,
    supervisor: Connection | None = None,
    page_url: str = "",
    on_started: Callable[[], None] = lambda: None,
    on_fatal: Callable[[], None] = lambda: None,
) -> FastAPI:
    """Create a gateway as an ASGI application. Nothing runs before its lifespan starts.

    Args:
        state: opened state; None: nothing is stored, whatever the settings name.
        reports: reports of all processes, if there are several (``--workers``).
        log: log to show in place of the live tree.
        supervisor: connection to the supervisor of several processes, for heartbeats.
        page_url: address of the page to open first, for the log.
        on_started: called once, when every interface is ready or has failed.
        on_fatal: called when the process must end with an error.

    Raises:
        SettingsError: a token or certificate file cannot be used.
    """
    spans = telemetry.start()
    app: FastAPI = FastAPIOffline(
        docs_url=None,  # its page has absolute addresses
        redoc_url=None,
        redirect_slashes=False,  # Starlette's redirects have absolute addresses; error_handlers.not_found redirects
        title="Scenegate",
        version=__version__,
        description=DESCRIPTION,
        servers=[{"url": ".", "description": "this gateway"}],  # relative to the description's own address
        license_info={"name": "Apache 2.0", "identifier": "Apache-2.0"},
        lifespan=_lifespan,
        swagger_ui_parameters={"validatorUrl": None},  # no request to an online validator
        telemetry=telemetry.config(),
    )
    context = Context(
        settings,
        app,
        registry=ServiceRegistry(essential=frozenset({KERNELS, FURTHER_KERNELS, "render", STATE})),
        metrics=Metrics(),
        workers=_workers(settings),
        # Matching takes a thread for 0.1 to 0.5 s, in which images need the others.
        camera_workers=_workers(settings, "camera", further_threads=1),
        security=Security.from_settings(settings),
        state=state,
        reports=reports,
        log=log,
        supervisor=supervisor,
        page_url=page_url,
        on_started=on_started,
        on_fatal=on_fatal,
        tree=LiveTree() if log is None else log.tree,
    )
    if spans is not None:
        context.exit_stack.callback(telemetry.close, spans)
    app.state.context = context
    _add_routes(context)
    _add_middleware(context)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    """Start the interfaces in a background task; stop them at the end."""
    context: Context = app.state.context
    process_tuning.tune()
    SHARED.max_bytes = context.settings.cache_bytes
    context.registry.expect(KERNELS, *enabled_interfaces(context.settings))
    metrics.watch_registry(context.metrics, context.registry)
    metrics.watch_workers(context.metrics, context.workers)
    metrics.watch_caches(context.metrics, SHARED)
    metrics.watch_tree(context.metrics, context.tree)
    context.security.log_exposure()
    if context.history is not None:
        context.history.start()
        context.exit_stack.callback(context.history.close)
        metrics.watch_history(context.metrics, context.history)
    context.begin_startup(start(context))
    idle = asyncio.create_task(context.return_memory_when_idle(), name="memory")
    try:
        async with write_worker_reports(context):
            yield
    finally:
        idle.cancel()
        await context.close()


def _workers(settings: Settings, name: str = "worker", further_threads: int = 0) -> WorkerPool:
    return WorkerPool(
        (settings.threads or max(1, usable_cpus() // settings.processes)) + further_threads,
        settings.queue,
        settings.queue_mb * MIB,
        name=name,
        niceness=settings.niceness,
        seconds=settings.render_seconds,
        limit_name="--render-seconds",
    )


def _add_routes(context: Context) -> None:
    """Add health, metrics and the index page; the interfaces add theirs when they start."""
    app = context.app
    interfaces = enabled_interfaces(context.settings)
    app.include_router(
        health.router(context.registry, context.metrics, __version__, context.readiness, context.reports)
    )

    @app.get("/", include_in_schema=False)
    async def index() -> HTMLResponse:
        view = {"view": "See the scene"} if "view" in interfaces else {}
        links = {**view, "docs": "HTTP interface", "metrics": "metrics"}
        if documentation_url():
            links[documentation_url()] = "documentation"
        names = {name: (entry.title, documentation_of(name)) for name, entry in NAMES.items()}
        return index_page(__version__, links, names)

    @app.get("/docs", include_in_schema=False)
    async def http_interface() -> HTMLResponse:
        return docs_page(app)


def _add_middleware(context: Context) -> None:
    """Add error responses and middleware; the last one added is the outermost."""
    app = context.app
    app.add_exception_handler(404, error_handlers.not_found)
    app.add_exception_handler(405, error_handlers.not_allowed)
    app.add_exception_handler(RequestValidationError, error_handlers.invalid_parameters)
    openapi.describe(app, token=context.security.http is not None, open_paths=health.OPEN_PATHS)
    gate = StartGate(
        started=context.started,
        problem=lambda: context.not_started_reason,
        open_paths=health.MONITORING_PATHS | {"/"},
        progress=lambda: context.kernels.progress,
    )
    quiet_paths = health.MONITORING_PATHS | POLLED_PATHS
    context.security.protect(app, metrics=context.metrics, quiet_paths=quiet_paths, gate=gate)
    if context.settings.root_path:
        app.add_middleware(PathPrefix, prefix=context.settings.root_path)


def __getattr__(name: str) -> Any:
    """Create ``app`` on first access, so that importing this module reads no settings."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    settings = settings_module.load()
    if settings.processes > 1:
        raise settings_module.SettingsError("SCENEGATE_WORKERS is for `scenegate serve` only; here it must be 1.")
    log_setup.configure(settings.log_format, settings.log_level, log_uvicorn=True)
    stop_uvicorn = partial(signal.raise_signal, signal.SIGTERM)
    return create_app(settings, open_state(settings), on_fatal=stop_uvicorn)
