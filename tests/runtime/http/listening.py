"""An application on the gateway's HTTP server, on a port of its own."""

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import FastAPI

from gateway.runtime.http.http_server import PortService
from tests.support.waiting import SECONDS, until


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


@asynccontextmanager
async def connected(
    app: FastAPI, tls: tuple[Path, Path] | None = None
) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """Yield a connection to an application on a server of its own."""
    context = ssl.create_default_context(cafile=str(tls[0])) if tls else None
    async with listening(app, tls) as port, asyncio.timeout(SECONDS):
        reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
        try:
            yield reader, writer
        finally:
            writer.close()
