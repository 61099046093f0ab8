"""A service with a port of its own."""

import asyncio
import socket

import httpx2
import pytest
from fastapi import FastAPI

from gateway.runtime.http.http_server import PortService
from tests.support.waiting import until


def app() -> FastAPI:
    app = FastAPI()

    @app.get("/")
    async def root() -> str:
        return "here"

    return app


async def test_the_port_is_known_once_it_is_open() -> None:
    service = PortService(app(), "127.0.0.1", 0)
    assert (service.ready, service.status()) == (False, {"port": 0})
    task = asyncio.create_task(service.run())
    await until(lambda: service.ready or task.done())
    port = service.status()["port"]
    assert port > 0
    async with httpx2.AsyncClient() as http:
        assert (await http.get(f"http://127.0.0.1:{port}/")).json() == "here"
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert not service.ready
    with socket.socket() as sock, pytest.raises(ConnectionRefusedError):
        sock.connect(("127.0.0.1", port))


async def test_a_taken_port_is_one_sentence() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(OSError, match=rf"^cannot listen: .*\(127\.0\.0\.1 port {port}\)$"):
            await PortService(app(), "127.0.0.1", port).run()
