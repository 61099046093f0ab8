"""Tasks of one process under ``--workers``: write its reports, and begin its shutdown at a signal."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from types import FrameType

from gateway.runtime.worker_reports import INTERVAL_SECONDS, WorkerReports
from gateway.wiring.context import Context


@asynccontextmanager
async def write_worker_reports(context: Context) -> AsyncIterator[None]:
    """Write this process's reports while the block runs. Without ``--workers``, this does nothing.

    If the process replaces another one, the block starts when it is ready. Until then, the other processes
    accept all connections.
    """
    reports = context.reports
    if reports is None:
        yield
        return
    await asyncio.to_thread(reports.register)
    task = asyncio.create_task(_write_repeatedly(context, reports), name="reports")
    with _shutdown_at_signals(context):
        if reports.is_replacement:
            await context.started.wait()
        try:
            yield
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            with contextlib.suppress(OSError):
                await _write(context, reports)


async def _write_repeatedly(context: Context, reports: WorkerReports) -> None:
    while True:
        # With a full disk, the process goes on serving, and the others regard it as silent.
        with contextlib.suppress(OSError):
            await _write(context, reports)
        await asyncio.sleep(INTERVAL_SECONDS)


async def _write(context: Context, reports: WorkerReports) -> None:
    await asyncio.to_thread(reports.write, context.readiness(), context.metrics.exposition().decode())


@contextmanager
def _shutdown_at_signals(context: Context) -> Iterator[None]:
    """Call ``context.begin_shutdown`` at SIGTERM and SIGINT, after the handlers that uvicorn has installed.

    uvicorn itself ends the application's lifespan only after the last request.
    """
    loop = asyncio.get_running_loop()
    previous_handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}

    def handle_signal(number: int, frame: FrameType | None) -> None:
        handler = previous_handlers[signal.Signals(number)]
        if callable(handler):
            handler(number, frame)
        loop.call_soon_threadsafe(context.begin_shutdown)

    for number in previous_handlers:
        signal.signal(number, handle_signal)
    try:
        yield
    finally:
        for number, handler in previous_handlers.items():
            signal.signal(number, handler)
