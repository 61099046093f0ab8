"""Reports of one of several processes (``--workers``) for the others, and the start of its shutdown."""

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
async def one_of_several(context: Context) -> AsyncIterator[None]:
    """Write reports while the block runs; does nothing if there are no other processes.

    A process that replaces another one enters the block when it is ready, so that the others accept the connections
    meanwhile.
    """
    reports = context.reports
    if reports is None:
        yield
        return
    await asyncio.to_thread(reports.join)
    task = asyncio.create_task(_report(context, reports), name="reports")
    with _shutdown_begun_by_signals(context):
        if reports.replaces:
            await context.started.wait()
        try:
            yield
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            with contextlib.suppress(OSError):
                await _write(context, reports)


async def _report(context: Context, reports: WorkerReports) -> None:
    while True:
        with contextlib.suppress(OSError):  # a full disk: the process becomes silent, and serves
            await _write(context, reports)
        await asyncio.sleep(INTERVAL_SECONDS)


async def _write(context: Context, reports: WorkerReports) -> None:
    await asyncio.to_thread(reports.write, context.readiness(), context.metrics.exposition().decode())


@contextmanager
def _shutdown_begun_by_signals(context: Context) -> Iterator[None]:
    """Call ``context.begin_shutdown`` at SIGTERM and SIGINT, after the handlers of uvicorn's server.

    uvicorn's supervisor makes the server, and calls the application only after the last request has ended.
    """
    loop = asyncio.get_running_loop()
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}

    def begin(number: int, frame: FrameType | None) -> None:
        handler = before[signal.Signals(number)]
        if callable(handler):
            handler(number, frame)
        loop.call_soon_threadsafe(context.begin_shutdown)

    for number in before:
        signal.signal(number, begin)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
