"""Starts the process: loads the kernels, restores the state, starts the interfaces, accepts requests."""

from __future__ import annotations

import asyncio
import time
from typing import Final

import structlog

from gateway import __version__
from gateway.runtime import kernel_cache
from gateway.runtime.kernel_progress import KernelProgress, show_progress
from gateway.runtime.service_registry import State
from gateway.state.errors import StateError
from gateway.wiring import warmup
from gateway.wiring.context import KERNELS, Context
from gateway.wiring.interfaces import enabled_interfaces
from gateway.wiring.state import STATE, restore_state
from renderers.compiler import pending

_log = structlog.get_logger("gateway")

SETTLE_SECONDS: Final = 5.0
"""Maximum wait for the services before the start is logged."""


async def start(context: Context) -> None:
    """Start everything. Requests wait for ``context.started``; if the stored state is invalid, it stays unset."""
    begin = time.perf_counter()
    async with asyncio.TaskGroup() as tasks:
        try:
            await _load_kernels(context)
            tasks.create_task(_load_background_kernels())  # interfaces may wait for these kernels
            try:
                await restore_state(context)
            except StateError as error:
                # An empty scene must neither be served instead of the stored one nor overwrite it.
                context.fail(STATE, error)
                context.on_fatal()
                return
            await _start_interfaces(context)
            context.started.set()
            context.app.openapi_schema = None  # may be cached from before the routes were added
            await asyncio.to_thread(context.app.openapi)  # fills the cache, which takes tens of milliseconds
        except Exception as error:  # noqa: BLE001 - /healthz reports the problem
            context.fail(KERNELS, error)
        context.started.set()
        await _log_started(context, begin)


async def _load_kernels(context: Context) -> None:
    """Load the kernels that the default settings need. If they are not cached, child processes compile them first."""
    if not await asyncio.to_thread(kernel_cache.are_cached, warmup.NEEDED):
        await _compile_kernels(context)
    context.exit_stack.enter_context(pending.announced(tuple(warmup.BACKGROUND)))
    begin = time.perf_counter()
    await asyncio.to_thread(warmup.load_needed)
    _log.info("The rendering kernels are loaded", seconds=round(time.perf_counter() - begin, 1))
    context.exit_stack.enter_context(kernel_cache.report_compiled_kernels(_log_compiled_kernel))
    context.registry.ready(KERNELS)


async def _compile_kernels(context: Context) -> None:
    """Compile the kernels. The log or a terminal, ``/readyz`` and the starting page show the progress."""
    progress = KernelProgress({part: warmup.FUNCTION_COUNTS[part] for part in warmup.NEEDED})
    entry = context.registry.entries[KERNELS]
    entry.progress = progress.describe
    context.compiling = progress
    _log.info(
        "Compiling the rendering kernels into the cache, once: 15 seconds on two idle cores ...",
        folder=str(kernel_cache.configure()),
    )
    with show_progress(progress, _log.info, bar=context.reports is None):
        await kernel_cache.compile_missing(warmup.NEEDED, progress)
    context.compiling = None
    entry.progress = None
    _log.info("The rendering kernels are compiled", seconds=progress.seconds)


async def _load_background_kernels() -> None:
    """Load the other kernels, compiled first if necessary. Calls that need them wait in ``compiler.pending``."""
    progress = KernelProgress({part: warmup.FUNCTION_COUNTS[part] for part in warmup.BACKGROUND})
    try:
        if await asyncio.to_thread(kernel_cache.are_cached, warmup.BACKGROUND):
            for part in warmup.BACKGROUND:
                await _load_background_part(part)
        else:
            _log.info("Compiling further kernels in the background; requests for them wait")
            await kernel_cache.compile_missing(warmup.BACKGROUND, progress, _load_background_part)
            _log.info("The further kernels are compiled", seconds=progress.seconds)
    except Exception as error:  # noqa: BLE001 - requests for these kernels get the reason
        pending.fail(kernel_cache.KernelError(str(error)))
        _log.error("Further kernels cannot be used; requests for them fail", reason=str(error))


async def _load_background_part(part: str) -> None:
    await asyncio.to_thread(warmup.load_background, part)


def _log_compiled_kernel(kernel: str) -> None:
    _log.error("A kernel is compiled in the serving process and blocks every interface", kernel=kernel)


async def _start_interfaces(context: Context) -> None:
    """Start the enabled interfaces in order. One that fails is reported and skipped."""
    for name, setup in enabled_interfaces(context.settings).items():
        try:
            await setup(context)
        except Exception as error:  # noqa: BLE001 - one interface must not stop the others
            context.fail(name, error)
        else:
            if context.registry.entries[name].state is State.STARTING:
                context.registry.ready(name)


async def _log_started(context: Context, begin: float) -> None:
    """Wait until the services are ready, at most ``SETTLE_SECONDS``, then log one line and call ``on_started``."""
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
