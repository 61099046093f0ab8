"""The HTTP server's bounds on what comes before a request's body."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from fastapi import FastAPI, Request

from gateway.ops import http


@asynccontextmanager
async def serving() -> AsyncIterator[int]:
    app = FastAPI()

    @app.get("/hello")
    async def hello() -> str:
        return "there"

    @app.post("/take")
    async def take(request: Request) -> int:
        return len(await request.body())

    service = http.PortService(app, "127.0.0.1", 0)
    task = asyncio.create_task(service.run())
    try:
        while not service.ready:
            assert not task.done(), task.result()
            await asyncio.sleep(0)
        yield int(service.status()["port"])
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_requests_on_one_connection_each_have_a_whole_allowance() -> None:
    padding = b"".join(b"x-padding-%d: %s\r\n" % (i, b"p" * 4000) for i in range(12))
    async with serving() as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        for _ in range(5):
            writer.write(b"GET /hello HTTP/1.1\r\nhost: here\r\n" + padding + b"\r\n")
            head = await reader.readuntil(b"\r\n\r\n")
            assert head.startswith(b"HTTP/1.1 200 OK")
            assert await reader.readexactly(7) == b'"there"'
        writer.close()
        await writer.wait_closed()


async def test_endless_headers_are_refused() -> None:
    async with serving() as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 20)
        writer.write(b"GET /hello HTTP/1.1\r\nhost: here\r\nx-endless: ")
        try:
            for _ in range(1000):
                writer.write(b"p" * 10_000)
                await writer.drain()
        except ConnectionError:
            pass  # it has been ended in the middle
        try:
            answer = await reader.read(1 << 16)
        except ConnectionError:
            answer = b""  # what was on its way is lost when more keeps coming
        assert answer == b"" or answer.startswith(b"HTTP/1.1 431 ")
        writer.close()


async def test_a_refusal_says_the_limit() -> None:
    async with serving() as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"GET /hello HTTP/1.1\r\nhost: here\r\nx-long: " + b"p" * (http.MAX_HEAD_BYTES + 1))
        await writer.drain()
        await asyncio.sleep(0.05)  # the next piece has to come by itself
        writer.write(b"p")
        answer = await reader.read(1 << 16)
        assert answer.startswith(b"HTTP/1.1 431 ")
        assert b"longer than 65536 bytes" in answer
        writer.close()


@pytest.mark.parametrize("start", [b"", b"GET /hello HT"], ids=["nothing", "a piece"])
async def test_headers_that_never_end_end_the_connection(monkeypatch: pytest.MonkeyPatch, start: bytes) -> None:
    monkeypatch.setattr(http, "HEAD_SECONDS", 0.05)
    async with serving() as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(start)
        assert await asyncio.wait_for(reader.read(), 30) == b""
        writer.close()
        await writer.wait_closed()


async def test_a_body_that_stops_ends_the_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http, "BODY_SECONDS", 0.05)
    async with serving() as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"POST /take HTTP/1.1\r\nhost: here\r\ncontent-length: 100\r\n\r\nbegin")
        async with asyncio.timeout(30):
            assert await reader.read() == b""
        writer.close()


async def test_connections_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http, "MAX_CONNECTIONS", 2)
    async with serving() as port:
        held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(2)]
        for reader, writer in held:  # they are known to the server when it has answered
            writer.write(b"GET /hello HTTP/1.1\r\nhost: here\r\n\r\n")
            await reader.readuntil(b'"there"')
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        answer = await reader.read()
        assert answer.startswith(b"HTTP/1.1 503 Service Unavailable")
        assert answer.endswith(b"\r\n\r\nThere are 2 connections already.\n")
        writer.close()
        for _, writer in held:
            writer.close()
