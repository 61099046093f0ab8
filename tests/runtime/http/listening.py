"""An application on the gateway's HTTP server, on a port of its own."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import FastAPI

from gateway.runtime.http.http_server import PortService
from tests.support.waiting import until


@asynccontextmanager
async def listening(app: FastAPI, tls: tuple[Path, Path] | None = None) -> AsyncIterator[int]:
    """Yield the port of a running server; ``tls``: its certificate and key."""
    service = PortService(app, "127.0.0.1", 0, tls)
    task = asyncio.create_task(service.run())
    try:
        await until(lambda: service.ready or task.done())
        assert service.ready, task.result()
        yield int(service.status()["port"])
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
