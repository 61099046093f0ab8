"""Request bodies on a real connection: pieces, early responses, disconnects, 100-continue, Upgrade."""

import asyncio
import contextlib
import weakref
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import uvloop
from fastapi import FastAPI, Request, Response
from starlette.requests import ClientDisconnect

from gateway.runtime.http import http_protocol
from gateway.runtime.http.disconnect import while_connected
from gateway.runtime.http.http_protocol import CONNECTION, BoundedHttpProtocol
from tests.runtime.http.listening import connected, listening
from tests.support.certificates import certificate
from tests.support.waiting import SECONDS, until

Address = tuple[asyncio.StreamReader, asyncio.StreamWriter]


@dataclass
class Application:
    """Endpoint that reads bodies, and how that ended for each request."""

    received: int = 0
    outcomes: list[str] = field(default_factory=list)
    reject_at: int | None = None
    """Bytes after which a request is rejected."""
    hold: asyncio.Event | None = None
    """Awaited before the response."""
    whole: bool = False
    """True: bodies of known length are received into one buffer."""

    def app(self) -> FastAPI:
        app = FastAPI()
        app.add_api_route("/take", self.take, methods=["POST"])
        return app

    async def take(self, http: Request) -> Response:
        body = bytearray()

        def count(total: int) -> None:
            self.received += total - before[-1]
            before.append(total)
            if self.reject_at is not None and total >= self.reject_at:
                raise ValueError

        before = [0]
        try:
            connection: BoundedHttpProtocol = http.scope[CONNECTION]
            whole = await connection.receive_body(http.scope, lambda _, total: count(total)) if self.whole else None
            if whole is not None:
                body = whole
            async for piece in http.stream():
                body += piece
                if piece:
                    count(len(body))
            if self.hold is not None:
                await while_connected(http, self.hold.wait())
        except (ValueError, ClientDisconnect) as error:
            self.outcomes.append(type(error).__name__)
            return Response(type(error).__name__, 418)
        self.outcomes.append("complete")
        return Response(bytes(body[:10]) + b"%d" % sum(body))


@pytest.fixture(params=[False, True], ids=["pieces", "whole"])
def endpoint(request: pytest.FixtureRequest) -> Application:
    return Application(whole=request.param)


@asynccontextmanager
async def serving(endpoint: Application) -> AsyncIterator[Callable[[], AbstractAsyncContextManager[Address]]]:
    async with listening(endpoint.app()) as port, asyncio.timeout(SECONDS):

        @asynccontextmanager
        async def connect() -> AsyncIterator[Address]:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            try:
                yield reader, writer
            finally:
                writer.close()

        yield connect


def post(body: bytes, *headers: bytes) -> bytes:
    return b"\r\n".join((b"POST /take HTTP/1.1", b"host: h", b"content-length: %d" % len(body), *headers, b"", body))


async def answer(reader: asyncio.StreamReader) -> tuple[int, bytes]:
    head = await reader.readuntil(b"\r\n\r\n")
    length = next(int(line[15:]) for line in head.split(b"\r\n") if line.startswith(b"content-length:"))
    return int(head.split()[1]), await reader.readexactly(length)


def summary(body: bytes) -> bytes:
    return body[:10] + b"%d" % sum(body)


@pytest.mark.parametrize("step", [1, 7, 997, 65_536, 1 << 20])
async def test_body_arrives_whole_in_pieces_of_any_size(endpoint: Application, step: int) -> None:
    body = bytes(range(256)) * (4 if step < 100 else 4000)
    async with serving(endpoint) as connect, connect() as (reader, writer):
        for _ in range(3):  # on one connection: the next head is found behind the body
            whole = post(body)
            head = len(whole) - len(body)
            writer.write(whole[:head])
            await writer.drain()
            for at in range(head, len(whole), step):
                writer.write(whole[at : at + step])
                await writer.drain()
                if step < 100:
                    await asyncio.sleep(0)
            assert await answer(reader) == (200, summary(body))
    assert endpoint.outcomes == ["complete"] * 3
    assert endpoint.received == 3 * len(body)


@pytest.mark.parametrize("size", [5, 100_000])
async def test_pipelined_requests_with_bodies(endpoint: Application, size: int) -> None:
    bodies = (b"a" * size, b"b" * size, b"")
    async with serving(endpoint) as connect, connect() as (reader, writer):
        writer.write(b"".join(post(body) for body in bodies))
        for body in bodies:
            assert await answer(reader) == (200, summary(body))
    assert endpoint.outcomes == ["complete"] * 3


async def test_connection_is_reused_after_an_early_response(endpoint: Application) -> None:
    endpoint.reject_at = 50_000
    async with serving(endpoint) as connect, connect() as (reader, writer):
        whole = post(b"x" * 1_000_000)
        writer.write(whole[:300_000])
        assert await answer(reader) == (418, b"ValueError")
        endpoint.reject_at = None
        writer.write(whole[300_000:] + post(b"y" * 100_000))
        assert await answer(reader) == (200, summary(b"y" * 100_000))
    assert endpoint.outcomes == ["ValueError", "complete"]


async def test_disconnect_within_the_body_is_detected(endpoint: Application) -> None:
    async with serving(endpoint) as connect:
        async with connect() as (_, writer):
            writer.write(post(b"x" * 100_000)[:50_000])
            await until(lambda: endpoint.received > 0)
        await until(lambda: endpoint.outcomes == ["ClientDisconnect"])


@pytest.mark.parametrize("size", [10, 100_000])
async def test_disconnect_before_the_response_is_detected(endpoint: Application, size: int) -> None:
    endpoint.hold = asyncio.Event()
    async with serving(endpoint) as connect:
        async with connect() as (_, writer):
            writer.write(post(b"x" * size))
            await until(lambda: endpoint.received == size)
        await until(lambda: endpoint.outcomes == ["ClientDisconnect"])


async def test_expect_100_continue(endpoint: Application) -> None:
    body = b"z" * 100_000
    async with serving(endpoint) as connect, connect() as (reader, writer):
        whole = post(body, b"expect: 100-continue")
        writer.write(whole[: -len(body)])
        assert await reader.readuntil(b"\r\n\r\n") == b"HTTP/1.1 100 Continue\r\n\r\n"
        writer.write(body)
        assert await answer(reader) == (200, summary(body))
    assert endpoint.received == len(body)


@pytest.mark.parametrize("last", [True, False])
async def test_offers_of_http_2_are_ignored(endpoint: Application, last: bool) -> None:
    """As Java's HttpClient makes them with each request of a connection."""
    offer = [b"Connection: Upgrade, HTTP2-Settings", b"HTTP2-Settings: AAEAAEAA", b"Upgrade: h2c"]
    length = b"Content-Length: 3"
    headers = b"\r\n".join([b"Host: h", *((length, *offer) if last else (*offer, length))])
    async with serving(endpoint) as connect, connect() as (reader, writer):
        for body in (b"abc", b"h2c"):
            writer.write(b"POST /take HTTP/1.1\r\n" + headers + b"\r\n\r\n" + body)
            assert await answer(reader) == (200, summary(body))


async def test_an_offer_of_http_2_may_arrive_in_two_slices() -> None:
    """Whatever the place where the head is cut."""
    offer = b"Connection: Upgrade, HTTP2-Settings\r\nContent-Length: 3\r\nHTTP2-Settings: AAEAAEAA\r\nUpgrade: h2c"
    whole = b"POST /take HTTP/1.1\r\nHost: h\r\n" + offer + b"\r\n\r\nabc"
    async with connected(Application().app()) as (reader, writer):
        for end in range(1, len(whole)):
            for part in (whole[:end], whole[end:]):
                writer.write(part)
                await asyncio.sleep(0.002)
            assert await answer(reader) == (200, summary(b"abc")), whole[:end]


@pytest.mark.parametrize("more", [b"content-length: 300000", b"transfer-encoding: chunked"])
async def test_upgrade_with_a_body_is_refused(endpoint: Application, more: bytes) -> None:
    head = b"POST /take HTTP/1.1\r\nhost: h\r\nconnection: Upgrade\r\nupgrade: websocket\r\n%s\r\n\r\n" % more
    async with serving(endpoint) as connect, connect() as (reader, writer):
        writer.write(head + bytes(300_000))
        status, text = await answer(reader)
        assert (status, await reader.read()) == (400, b"")
        assert b"Upgrade" in text
    assert endpoint.outcomes == []


async def test_refused_upgrade_waits_for_an_earlier_response(received: list[int]) -> None:
    app = FastAPI()

    @app.post("/take")
    async def take() -> Response:
        await until(lambda: sum(received) >= len(first))
        return Response(b"taken")

    first = b"POST /take HTTP/1.1\r\nhost: h\r\ncontent-length: 1\r\n\r\nx"
    other = b"POST /take HTTP/1.1\r\nhost: h\r\nconnection: Upgrade\r\nupgrade: h2c\r\ncontent-length: 1\r\n\r\nx"
    async with connected(app) as (reader, writer):
        writer.write(first + other)
        assert await answer(reader) == (200, b"taken")


async def test_unsupported_upgrade_without_a_body_is_ignored(endpoint: Application) -> None:
    async with serving(endpoint) as connect, connect() as (reader, writer):
        writer.write(b"GET /take HTTP/1.1\r\nhost: h\r\nconnection: Upgrade\r\nupgrade: h2c\r\n\r\n")
        status, _ = await answer(reader)
        assert status == 405


async def test_larger_bodies_arrive_in_pieces(endpoint: Application, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_protocol, "MAX_BUFFER_BYTES", 200_000)
    async with serving(endpoint) as connect, connect() as (reader, writer):
        for size in (200_000, 200_001, 200_000):
            writer.write(post(b"x" * size))
            assert await answer(reader) == (200, summary(b"x" * size))
    assert endpoint.received == 600_001


async def test_bodies_over_tls(endpoint: Application, tmp_path: Path) -> None:
    body = bytes(range(256)) * 4000
    async with connected(endpoint.app(), certificate(tmp_path)) as (reader, writer):
        for _ in range(2):
            for start in range(0, len(whole := post(body)), 300_000):
                writer.write(whole[start : start + 300_000])
                await writer.drain()
            assert await answer(reader) == (200, summary(body))
        writer.write(post(b"first") + post(b"second"))
        assert [await answer(reader) for _ in range(2)] == [(200, summary(b"first")), (200, summary(b"second"))]
        writer.write(post(body)[:300_000])
        writer.close()
        await until(lambda: endpoint.outcomes[4:] == ["ClientDisconnect"])


def test_body_is_released_while_the_connection_stays_open() -> None:
    """On uvloop, whose transports keep the last protocol that had a buffer."""
    counters: list[weakref.ref[Callable[[bytearray, int], None]]] = []

    async def run() -> None:
        app = FastAPI()

        @app.post("/take")
        async def take(request: Request) -> Response:
            def on_bytes(buffer: bytearray, count: int) -> None:
                if count > 500_000:
                    raise ValueError

            counters.append(weakref.ref(on_bytes))
            connection: BoundedHttpProtocol = request.scope[CONNECTION]
            with contextlib.suppress(ValueError):
                await connection.receive_body(request.scope, on_bytes)
            return Response(b"taken")

        async with connected(app) as (reader, writer):
            for size in (400_000, 600_000):
                writer.write(post(bytes(size)))
                assert await answer(reader) == (200, b"taken")
                await until(lambda: counters[-1]() is None)

    uvloop.run(run())


async def test_buffer_grows_with_what_has_arrived() -> None:
    sizes: list[tuple[int, int]] = []
    app = FastAPI()

    @app.post("/take")
    async def take(request: Request) -> Response:
        connection: BoundedHttpProtocol = request.scope[CONNECTION]
        body = await connection.receive_body(request.scope, lambda buffer, count: sizes.append((len(buffer), count)))
        return Response(summary(bytes(body)))

    body = bytes(range(256)) * 8000
    async with connected(app) as (reader, writer):
        writer.write(post(body)[: -len(body)])
        await until(lambda: sizes == [(1 << 16, 0)])
        for start in range(0, len(body), 30_000):
            writer.write(body[start : start + 30_000])
            await until(lambda end=start + 30_000: sizes[-1][1] >= min(end, len(body)))  # type: ignore[misc]  # no type for a default
        assert await answer(reader) == (200, summary(body))
    assert all(size <= max(16 * count, 1 << 16) for size, count in sizes)
    assert sizes[-1] == (len(body), len(body))
