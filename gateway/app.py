"""Joins the rooms to one application: one event loop, one live tree, one renderer, one way to start and to stop.

``create_app`` gives a FastAPI application whose lifespan starts and stops every interface, those that do not speak
HTTP too, so that ``uvicorn gateway.app:app`` is a whole gateway, configured by the environment.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from typing import TYPE_CHECKING, Any

import structlog
from fastapi import FastAPI
from fastapi.responses import HTMLResponse
from fastapi_offline import FastAPIOffline
from starlette.middleware.body_limit import RequestBodyLimitMiddleware

from gateway import __version__
from gateway import settings as options
from gateway.runtime import kernel_cache, logs, process_tuning
from gateway.runtime.kernel_progress import Progress, shown
from gateway.runtime.metrics_registry import Metrics
from gateway.runtime.service_registry import ServiceRegistry, State
from gateway.runtime.worker_pool import WorkerPool, usable_cpus
from gateway.scene.live import LiveTree
from gateway.server import error_handlers, health, openapi
from gateway.server.index_page import index_page
from gateway.server.middleware import RequestContext, StartGate
from gateway.server.security import Security
from gateway.settings import MIB, Settings
from gateway.state.errors import StateError
from gateway.viewer.sources import IMAGE_NAMES
from gateway.wiring import metrics as figures
from gateway.wiring import warmup
from gateway.wiring.context import NO_TELEMETRY, House
from gateway.wiring.interfaces import JOINS, Join, join_demo
from gateway.wiring.state import STATE, open_state, restore_state

if TYPE_CHECKING:
    from gateway.state.service import PersistentState

_log = structlog.get_logger("gateway")

KERNELS = "kernels"
POLLED = frozenset({"/view/sensor", "/view/renders", *(f"/view/sensor/{name}.jpg" for name in IMAGE_NAMES)})
"""What the page of the browser view asks again and again while a panel is open; not logged above debug level."""
_SETTLE_SECONDS = 5.0
"""Time after which the state is logged although a service is still starting."""
DESCRIPTION = "Drake's glTF render server, an rc_visard stereo camera and Director's tree viewer, on one scene."


def create_app(settings: Settings, state: PersistentState | None = None) -> FastAPI:
    """A whole gateway as an ASGI application; nothing runs before its lifespan starts.

    Args:
        state: as opened already; None: it is opened when the lifespan starts, if the settings name one.

    Raises:
        SettingsError: a token or a certificate that they name cannot be used.
    """
    security = Security.of(settings)
    registry = ServiceRegistry(essential=frozenset({KERNELS, "render"}))
    metrics = Metrics()
    started = asyncio.Event()
    wanted: dict[str, Join] = {n: join for n, join in JOINS.items() if not settings.only or n in settings.only}
    if settings.demo:
        wanted["demo"] = join_demo

    threads = settings.threads or usable_cpus()
    workers = WorkerPool(
        threads,
        settings.queue,
        settings.queue_mb * MIB,
        niceness=settings.niceness,
        seconds=settings.render_seconds,
        limit_name="--render-seconds",
    )
    stateless = settings.only == ("render",)

    def busy() -> bool:
        # Only where nothing but renders would miss it: a balancer must not take streams away for a full queue.
        return stateless and (workers.full or workers.stuck)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        process_tuning.tune()
        registry.expect(KERNELS, *wanted)
        house = House(settings, app, registry, metrics, LiveTree(), workers, security)
        figures.watch_process(metrics, registry, workers)
        figures.watch_tree(metrics, house.tree)
        security.log_exposure()
        house.state = state or await asyncio.to_thread(open_state, settings)
        watch = ExitStack()
        start = asyncio.create_task(_start(house, wanted, started, watch), name="start")

        def leave() -> None:
            house.leave()
            if not started.is_set():  # no room is joined any more; who waits for the start is told so
                start.cancel()
                registry.fail(KERNELS, "it was told to stop")
                started.set()

        app.state.leave = leave
        try:
            yield
        finally:
            start.cancel()
            await asyncio.gather(start, return_exceptions=True)
            await house.close()
            watch.close()

    app: FastAPI = FastAPIOffline(
        redoc_url=None,
        title="Scenegate",
        version=__version__,
        description=DESCRIPTION,
        license_info={"name": "Apache 2.0", "identifier": "Apache-2.0"},
        lifespan=lifespan,
        # Swagger UI would ask a validator in the internet for a badge.
        swagger_ui_parameters={"validatorUrl": None},
        telemetry=NO_TELEMETRY,
    )
    app.add_exception_handler(404, error_handlers.not_found)
    app.add_exception_handler(405, error_handlers.not_allowed)
    openapi.describe(app, token=security.http is not None, open_paths=health.OPEN_PATHS)
    app.include_router(health.router(registry, metrics, __version__, started.is_set, busy))
    app.add_middleware(RequestBodyLimitMiddleware, max_body_size=settings.max_body_mb * MIB)
    app.add_middleware(
        StartGate, started=started, problem=lambda: registry.entries[KERNELS].problem, open_paths=health.PATHS | {"/"}
    )
    security.protect(app)
    app.add_middleware(error_handlers.HeadAsGet)
    app.add_middleware(RequestContext, metrics=metrics, quiet_paths=health.PATHS | POLLED)

    @app.get("/", include_in_schema=False)
    async def index() -> HTMLResponse:
        view = {"view": "See the scene"} if "view" in wanted else {}
        return HTMLResponse(index_page(__version__, {**view, "docs": "HTTP interface", "metrics": "metrics"}))

    return app


async def _start(house: House, wanted: dict[str, Join], started: asyncio.Event, watch: ExitStack) -> None:
    """Makes sure of the kernels, then joins the rooms; requests wait until this is done.

    Args:
        watch: gets what reports compiling from then on.
    """
    begin = time.perf_counter()
    try:
        if not await asyncio.to_thread(kernel_cache.are_cached):
            await _compile(house)
        await asyncio.to_thread(warmup.run)
        watch.enter_context(kernel_cache.compiling_reported(_compiled_while_serving))
        house.registry.ready(KERNELS)
        if not await _restored(house):
            return
        for name, join in wanted.items():
            try:
                join(house)
                if house.registry.entries[name].state is State.STARTING:
                    house.registry.ready(name)
            except Exception as error:  # noqa: BLE001 - a room that cannot be joined must not end the others
                house.fail(name, error)
        started.set()
        house.app.openapi_schema = None  # of before the rooms were joined, if somebody has asked
        await asyncio.to_thread(house.app.openapi)  # kept; describing all routes takes tens of milliseconds
    except Exception as error:  # noqa: BLE001 - nothing renders without kernels, but health tells why
        house.fail(KERNELS, error)
    started.set()
    settled = time.perf_counter() + _SETTLE_SECONDS
    # Rooms say themselves whether they are ready.
    while house.registry.verdict() == "starting" and time.perf_counter() < settled:  # noqa: ASYNC110 - nobody tells when
        await asyncio.sleep(0.02)
    if (on_started := getattr(house.app.state, "on_started", None)) is not None:
        on_started()
    seconds = round(time.perf_counter() - begin, 2)
    _log.info("Scenegate has started", status=house.registry.verdict(), version=__version__, seconds=seconds)


async def _compile(house: House) -> None:
    """Compiles the kernels in child processes; log, ``/readyz`` and a terminal show how far it has got."""
    progress = Progress(len(warmup.PARTS))
    entry = house.registry.entries[KERNELS]
    entry.progress = progress.describe
    folder = str(kernel_cache.configure())
    _log.info("Compiling the rendering kernels into the cache, once ...", folder=folder, parts=progress.parts)
    with shown(progress, _log.info):
        await kernel_cache.compile_missing(warmup.PARTS, progress)
    entry.progress = None  # from here on the kernels are loaded
    _log.info("The rendering kernels are compiled", seconds=progress.seconds)


def _compiled_while_serving(kernel: str) -> None:
    _log.error("A kernel is compiled in the serving process, which every interface waits for", kernel=kernel)


async def _restored(house: House) -> bool:
    """Whether the state is back; without it nothing may run that would be taken for it."""
    try:
        await restore_state(house)
    except StateError as error:
        house.fail(STATE, error)
        if (give_up := getattr(house.app.state, "give_up", None)) is not None:
            give_up()
        return False
    return True


def __getattr__(name: str) -> Any:
    """``app`` for ``uvicorn gateway.app:app``: made when asked for, so that importing this module reads no settings."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    settings = options.load()
    logs.configure(settings.log_format, settings.log_level, uvicorn_starts=True)
    return create_app(settings)
