"""Compiles kernels that are not cached, and loads them, while a server starts."""

import asyncio
import math
import time
from contextlib import ExitStack
from functools import cache as cache_result
from typing import Final

import structlog

from gateway.runtime.kernels import cache, parts
from gateway.runtime.kernels.progress import KernelProgress, show_progress
from gateway.runtime.service_registry import ServiceRegistry, one_line
from renderers.compiler import pending

_log = structlog.get_logger("gateway")

KERNELS: Final = "kernels"
"""Name of the needed kernels in the service registry."""
FURTHER_KERNELS: Final = "further_kernels"
"""Name of the background kernels in the service registry. The entry exists only after an error."""
START_RETRIES: Final = (1.0, 2.0, 4.0, 8.0)
"""Delays before further attempts to load the needed kernels after a transient error, seconds."""
PASSING_ERRORS: Final = (OSError, MemoryError, cache.KernelLoadError)
"""Transient errors, such as a lack of file descriptors or memory. A failed compilation is final."""
MAX_RETRY_SECONDS: Final = 300.0
"""Maximum delay between attempts to load the background kernels. Their number is not limited."""


class KernelLoader:
    """Loads the kernels of a server, compiled by child processes first where they are not cached."""

    def __init__(self, registry: ServiceRegistry, exit_stack: ExitStack) -> None:
        """The registry shows state and progress; the stack is closed when the server ends."""
        self.progress: KernelProgress | None = None
        """Progress of compiling the kernels that the start needs; None if they are not being compiled."""
        self._registry = registry
        self._exit_stack = exit_stack

    async def load_needed(self) -> None:
        """Load the kernels that the default settings need, again after errors that may pass. Raises KernelError."""
        for seconds in START_RETRIES:
            try:
                return await self._load_needed_once()
            except PASSING_ERRORS as error:
                problem = self._registry.entries[KERNELS].problem = one_line(error)
                _log.warning("The rendering kernels are not loaded yet", reason=problem, retry_seconds=seconds)
                await asyncio.sleep(seconds)
        return await self._load_needed_once()

    async def load_background(self) -> None:
        """Load the other kernels, again after any error, until all are loaded. Calls that need them wait.

        After an error, the calls fail until the next attempt.
        """
        seconds = 1.0
        while True:
            try:
                await _load_pending_parts()
                break
            except Exception as error:  # noqa: BLE001 - the server serves what needs none of these kernels
                problem = one_line(error)
            self._registry.fail(FURTHER_KERNELS, problem)
            pending.fail(math.ceil(seconds))
            _log.error("Further kernels are not loaded; requests for them fail", reason=problem, retry_seconds=seconds)
            await wait_before_retry(seconds)
            seconds = min(2.0 * seconds, MAX_RETRY_SECONDS)
            pending.fail(None)
        if FURTHER_KERNELS in self._registry.entries:
            self._registry.ready(FURTHER_KERNELS)
            _log.info("The further kernels are loaded")

    async def _load_needed_once(self) -> None:
        if not await asyncio.to_thread(cache.are_cached, parts.NEEDED):
            await self._compile_needed()
        announced = {name: cache_result(part.has_kernel) for name, part in parts.BACKGROUND.items()}
        self._exit_stack.enter_context(pending.announced(announced))
        begin = time.perf_counter()
        await asyncio.to_thread(parts.load_needed)
        _log.info("The rendering kernels are loaded", seconds=round(time.perf_counter() - begin, 1))
        from renderers.compiler.cache_locator import watch_compiler

        self._exit_stack.enter_context(watch_compiler(_log_compiled_kernel))
        self._registry.ready(KERNELS)

    async def _compile_needed(self) -> None:
        """Compile the kernels. The log, ``/readyz`` and the starting page show the progress."""
        progress = self.progress = KernelProgress({name: part.function_count for name, part in parts.NEEDED.items()})
        entry = self._registry.entries[KERNELS]
        entry.progress = progress.describe
        _log.info(
            "Compiling the rendering kernels into the cache, once: 15 seconds on two idle cores ...",
            folder=str(cache.configure()),
        )
        try:
            with show_progress(progress, _log.info):
                await cache.compile_missing(parts.NEEDED, progress)
        finally:
            self.progress = None
            entry.progress = None
        _log.info("The rendering kernels are compiled", seconds=progress.seconds)


async def wait_before_retry(seconds: float) -> None:
    """Wait before the next attempt to load kernels of the background."""
    await asyncio.sleep(seconds)


async def _load_pending_parts() -> None:
    """Load the parts of the background that are not loaded: those in the cache, then the others, compiled first."""
    names = []
    for name in parts.BACKGROUND:
        if not pending.is_pending(name):
            continue
        if await asyncio.to_thread(cache.are_cached, [name]):
            await _load_background_part(name)
        else:
            names.append(name)
    if not names:
        return
    progress = KernelProgress({name: parts.BACKGROUND[name].function_count for name in names})
    _log.info("Compiling further kernels in the background; requests for them wait")
    await cache.compile_missing(names, progress, _load_background_part)
    _log.info("The further kernels are compiled", seconds=progress.seconds)


async def _load_background_part(name: str) -> None:
    await asyncio.to_thread(parts.load_background, name)


def _log_compiled_kernel(function: str, depth: int) -> None:
    if depth == 1:
        _log.error("A kernel is compiled in the serving process and blocks every interface", kernel=function)
