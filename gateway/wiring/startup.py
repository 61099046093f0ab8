"""Starts the process: loads the kernels, restores the state, starts the interfaces, accepts requests."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from importlib import import_module
from typing import Final

import structlog

from gateway import __version__
from gateway.runtime.kernels.loading import KERNELS
from gateway.runtime.service_registry import InterfaceState
from gateway.runtime.settings import Settings
from gateway.wiring.context import Context, Provided
from gateway.wiring.state import STATE, restore_state

_log = structlog.get_logger("gateway")

SETTLE_SECONDS: Final = 5.0
"""Maximum wait for the services before the start is logged."""

Setup = Callable[[Context, Provided], Awaitable[Provided]]
"""Starts an interface. Gets and returns what the interfaces that have started provide."""


async def _setup(module: str, context: Context, provided: Provided) -> Provided:
    """Import a wiring module, and call its ``setup``.

    Its imports load compiled kernels, which must be in the cache by then. An import that fails (a system library is
    missing) stops this interface only.
    """
    setup: Setup = import_module(f"gateway.wiring.{module}").setup
    return await setup(context, provided)


_NAMES: Final = ("render", "drakeviewer", "treeviewer", "stereo", "scene", "view", "foxglove", "demo")
INTERFACES: Final[Mapping[str, Setup]] = {
    name: partial(_setup, "sceneapi" if name == "scene" else name) for name in _NAMES
}
"""The interfaces by name, in order of start: each after those whose part of ``Provided`` it uses."""


def enabled_interfaces(settings: Settings) -> dict[str, Setup]:
    """Return the interfaces that the settings enable (``--only``, ``--demo``, ``--drake-viewer``, …)."""
    enabled = {
        "demo": settings.demo,
        "drakeviewer": settings.drake_viewer and settings.is_enabled("treeviewer"),
        "foxglove": settings.foxglove_port is not None,
    }
    return {name: setup for name, setup in INTERFACES.items() if enabled.get(name, settings.is_enabled(name))}


async def start(context: Context) -> None:
    """Start everything. Requests wait for ``context.started``.

    The process ends, by ``context.on_fatal``, if the kernels cannot be loaded or the state cannot be restored: an empty
    scene must not be served in its place, nor overwrite it. It ends with any other error, too.
    """
    try:
        await _start(context)
    except Exception:  # noqa: BLE001 - logged; the process ends
        _log.exception("The gateway cannot start")
        context.on_fatal()


async def _start(context: Context) -> None:
    begin = time.perf_counter()
    async with asyncio.TaskGroup() as tasks:
        stage = KERNELS
        try:
            await context.kernels.load_needed()
            tasks.create_task(context.kernels.load_background())  # interfaces may wait for these kernels
            stage = STATE
            await restore_state(context)
        except Exception as error:  # noqa: BLE001 - logged; the process ends
            context.fail(stage, error)
            context.reject_requests("it cannot work; its log has the reason")
            context.on_fatal()
            return
        await _start_interfaces(context)
        _describe_routes(context)
        context.started.set()
        await _announce_start(context, begin)


def _describe_routes(context: Context) -> None:
    """Make the OpenAPI description, before requests can wait for it.

    It takes a tenth of a second of the event loop. In a thread it fails if a request comes at the same time: FastAPI
    prepares the routes for that request, too, and finds a parameter in one preparation that it looks for in the other.
    """
    # FastAPI keeps the description of its first use, which may be from before the interfaces added their routes.
    context.app.openapi_schema = None
    context.app.openapi()


async def _start_interfaces(context: Context) -> None:
    """Start the enabled interfaces in order. One that fails is reported and skipped."""
    provided = Provided()
    for name, setup in enabled_interfaces(context.settings).items():
        try:
            provided = await setup(context, provided)
        except Exception as error:  # noqa: BLE001 - one interface must not stop the others
            context.fail(name, error)
        else:
            if context.registry.entries[name].state is InterfaceState.STARTING:
                context.registry.ready(name)


async def _announce_start(context: Context, begin: float) -> None:
    """Wait until the services are ready, at most ``SETTLE_SECONDS``, then call ``on_started`` and log one line."""
    deadline = time.perf_counter() + SETTLE_SECONDS
    while context.registry.verdict() == "starting" and time.perf_counter() < deadline:  # noqa: ASYNC110 - no event
        await asyncio.sleep(0.02)
    context.on_started()
    _log.info(
        "Scenegate has started",
        **({"url": context.page_url} if context.page_url else {}),
        status=context.registry.verdict(),
        version=__version__,
        seconds=round(time.perf_counter() - begin, 2),
    )
