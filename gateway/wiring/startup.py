"""Starts the process: loads the kernels, restores the state, starts the interfaces, accepts requests."""

from __future__ import annotations

import asyncio
import math
import time
from typing import Final

import structlog

from gateway import __version__
from gateway.runtime import kernel_cache
from gateway.runtime.kernel_progress import KernelProgress, show_progress
from gateway.runtime.service_registry import State
from gateway.wiring import warmup
from gateway.wiring.context import KERNELS, Context, one_line
from gateway.wiring.interfaces import enabled_interfaces
from gateway.wiring.state import STATE, restore_state
from renderers.compiler import pending

_log = structlog.get_logger("gateway")

SETTLE_SECONDS: Final = 5.0
"""Maximum wait for the services before the start is logged."""
START_RETRIES: Final = (1.0, 2.0, 4.0, 8.0)
"""Delays before further attempts to load the needed kernels after a transient error, seconds."""
PASSING_ERRORS: Final = (OSError, MemoryError, kernel_cache.KernelLoadError)
"""Transient errors, such as a lack of file descriptors or memory. A failed compilation is final."""
MAX_RETRY_SECONDS: Final = 300.0
"""Maximum delay between attempts to load the background kernels. Their number is not limited."""
FURTHER_KERNELS: Final = "further_kernels"
"""Name of the background kernels in the service registry. The entry exists only after an error."""


async def start(context: Context) -> None:
    """Start everything. Requests wait for ``context.started``.

    The process ends, by ``context.on_fatal``, if the kernels cannot be loaded or the state cannot be restored: an empty
    scene must not be served in its place, nor overwrite it.
    """
    begin = time.perf_counter()
    async with asyncio.TaskGroup() as tasks:
        part = KERNELS
        try:
            await _load_kernels(context)
            tasks.create_task(_load_background_kernels(context))  # interfaces may wait for these kernels
            part = STATE
            await restore_state(context)
        except Exception as error:  # noqa: BLE001 - logged; the process ends
            context.fail(part, error)
            context.reject_requests("it cannot work; its log has the reason")
            context.on_fatal()
            return
        await _start_interfaces(context)
        context.started.set()
        context.app.openapi_schema = None  # may be cached from before the routes were added
        await asyncio.to_thread(context.app.openapi)  # fills the cache, which takes tens of milliseconds
        await _log_started(context, begin)


async def _load_kernels(context: Context) -> None:
    """Load the kernels that the default settings need, again after errors that may pass."""
    for seconds in START_RETRIES:
        try:
            return await _load_kernels_once(context)
        except PASSING_ERRORS as error:
            problem = context.registry.entries[KERNELS].problem = one_line(error)
            _log.warning("The rendering kernels are not loaded yet", reason=problem, retry_seconds=seconds)
            await asyncio.sleep(seconds)
    return await _load_kernels_once(context)


async def _load_kernels_once(context: Context) -> None:
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
    try:
        with show_progress(progress, _log.info, bar=context.reports is None):
            await kernel_cache.compile_missing(warmup.NEEDED, progress)
    finally:
        context.compiling = None
        entry.progress = None
    _log.info("The rendering kernels are compiled", seconds=progress.seconds)


async def _load_background_kernels(context: Context) -> None:
    """Load the other kernels, again after any error, until all are loaded. Calls that need them wait in ``pending``.

    After an error, the calls fail until the next attempt.
    """
    seconds = 1.0
    while True:
        try:
            await _load_pending_parts()
            break
        except Exception as error:  # noqa: BLE001 - the server serves what needs none of these kernels
            problem = one_line(error)
        context.registry.fail(FURTHER_KERNELS, problem)
        pending.fail(kernel_cache.KernelsDelayed(math.ceil(seconds)))
        _log.error("Further kernels are not loaded; requests for them fail", reason=problem, retry_seconds=seconds)
        await wait_before_retry(seconds)
        seconds = min(2.0 * seconds, MAX_RETRY_SECONDS)
        pending.fail(None)
    if FURTHER_KERNELS in context.registry.entries:
        context.registry.ready(FURTHER_KERNELS)
        _log.info("The further kernels are loaded")


async def wait_before_retry(seconds: float) -> None:
    """Wait before the next attempt to load kernels of the background."""
    await asyncio.sleep(seconds)


async def _load_pending_parts() -> None:
    """Load the parts of the background that are not loaded, compiled first if necessary."""
    parts = [part for part in warmup.BACKGROUND if pending.is_pending(part)]
    if await asyncio.to_thread(kernel_cache.are_cached, parts):
        for part in parts:
            await _load_background_part(part)
        return
    progress = KernelProgress({part: warmup.FUNCTION_COUNTS[part] for part in parts})
    _log.info("Compiling further kernels in the background; requests for them wait")
    await kernel_cache.compile_missing(parts, progress, _load_background_part)
    _log.info("The further kernels are compiled", seconds=progress.seconds)


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
