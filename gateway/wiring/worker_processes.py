"""Tasks of one process under ``--workers``: write its reports, and tell the supervisor that it responds."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final

from gateway.runtime.workers.supervisor import send_heartbeats
from gateway.runtime.workers.worker_reports import INTERVAL_SECONDS
from gateway.wiring.context import Context

_POLL_SECONDS: Final = 0.1


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

    async def write() -> None:
        # With a full disk, the process goes on serving, and the others regard it as silent.
        with contextlib.suppress(OSError):
            await asyncio.to_thread(reports.write, context.readiness(), context.metrics.exposition().decode())

    async def write_repeatedly() -> None:
        while True:
            await write()
            await asyncio.sleep(INTERVAL_SECONDS)

    with contextlib.suppress(OSError):
        await asyncio.to_thread(reports.register)
    tasks = [asyncio.create_task(write_repeatedly(), name="reports")]
    if context.supervisor is not None:
        beats = send_heartbeats(context.supervisor, lambda: context.readiness() in ("ready", "degraded", "busy"))
        tasks.append(asyncio.create_task(beats, name="heartbeat"))
    while reports.is_replacement and not context.started.is_set() and not context.app.state.closing():  # noqa: ASYNC110
        await asyncio.sleep(_POLL_SECONDS)  # uvicorn reports no signal before the block has started
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await write()
