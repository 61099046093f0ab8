"""Limits of HTTP connections, and early responses."""

import asyncio
import contextlib
from contextlib import AsyncExitStack

import pytest
from fastapi import FastAPI, Request, Response

from gateway.runtime.http import http_protocol
from gateway.runtime.http.edge import Edge
from gateway.runtime.http.http_protocol import BoundedHttpProtocol
from tests.runtime.http.listening import connected, listening
from tests.support.waiting import SECONDS


def application(held: asyncio.Event | None = None) -> FastAPI:
    """Return an application whose ``/wait`` waits for ``held``."""
    app = FastAPI()

    @app.get("/hello")
    async def hello() -> str:
        return "there"

    @app.post("/take")
    async def take(request: Request) -> int:
        assert "authorization" not in request.headers
        return len(await request.body())

    @app.get("/wait")
    async def wait() -> str:
        await held.wait()
        return "waited"

    @app.post("/full")
    async def full() -> Response:
        return Response("busy", 503, headers={"Retry-After": "7"})

    app.add_middleware(Edge)
    return app


async def test_shutdown_responds_to_the_first_request_of_a_new_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_protocol, "FIRST_REQUEST_SECONDS", SECONDS)
    begun = asyncio.Event()
    end = BoundedHttpProtocol.shutdown

    def begin(connection: BoundedHttpProtocol) -> None:
        end(connection)
        begun.set()

    monkeypatch.setattr(BoundedHttpProtocol, "shutdown", begin)
    async with AsyncExitStack() as server:
        port = await server.enter_async_context(listening(application()))
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        ending = asyncio.create_task(server.aclose())
        await begun.wait()
        writer.write(b"GET /hello HTTP/1.1\r\nhost: here\r\n\r\n")
        assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 200 OK")
        writer.close()
        await ending


async def test_head_limit_is_per_request() -> None:
    padding = b"".join(b"x-padding-%d: %s\r\n" % (i, b"p" * 4000) for i in range(12))
    async with connected(application()) as (reader, writer):
        for _ in range(5):
            writer.write(b"GET /hello HTTP/1.1\r\nhost: here\r\n" + padding + b"\r\n")
            head = await reader.readuntil(b"\r\n\r\n")
            assert head.startswith(b"HTTP/1.1 200 OK")
            assert await reader.readexactly(7) == b'"there"'


async def test_endless_headers_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_protocol, "DISCARD_SECONDS", SECONDS)  # else a slow client loses the answer
    async with listening(application()) as port, asyncio.timeout(SECONDS):
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 20)
        answer = asyncio.create_task(reader.readuntil(b"\r\n\r\n"))
        writer.write(b"GET /hello HTTP/1.1\r\nhost: here\r\nx-endless: ")
        while not answer.done():
            writer.write(b"p" * 10_000)
            await writer.drain()
            await asyncio.sleep(0)
        assert (await answer).startswith(b"HTTP/1.1 431 ")
        assert b"longer than 65536 bytes" in await reader.readline()
        writer.close()


@pytest.mark.parametrize("start", [b"", b"GET /hello HT"], ids=["nothing", "a piece"])
async def test_incomplete_head_closes_the_connection(monkeypatch: pytest.MonkeyPatch, start: bytes) -> None:
    monkeypatch.setattr(http_protocol, "HEAD_SECONDS", 0.05)
    async with connected(application()) as (reader, writer):
        writer.write(start)
        with contextlib.suppress(ConnectionError):  # of a client so slow that its piece came after the end
            assert await reader.read() == b""


async def test_stalled_body_closes_the_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_protocol, "BODY_SECONDS", 0.05)
    async with connected(application()) as (reader, writer):
        writer.write(b"POST /take HTTP/1.1\r\nhost: here\r\ncontent-length: 100\r\n\r\nbegin")
        assert await reader.read() == b""


@pytest.mark.parametrize(
    ("first", "rest"),
    [
        (b"GET /hello HTTP/1.1\r\nhost: here\r\n\r\n", b"\r\n"),
        (b"POST /nowhere HTTP/1.1\r\nhost: here\r\ncontent-length: 9\r\n\r\n", b"just late"),
        (b"POST /hello HTTP/1.1\r\nhost: here\r\ncontent-length: 9\r\n\r\nnot", b" taken"),
    ],
)
async def test_idle_connection_closes_after_stray_bytes(
    monkeypatch: pytest.MonkeyPatch, first: bytes, rest: bytes
) -> None:
    made = http_protocol.BoundedHttpProtocol.connection_made

    def soon(self: http_protocol.BoundedHttpProtocol, transport: asyncio.Transport) -> None:
        made(self, transport)
        self.timeout_keep_alive = 0.1  # type: ignore[assignment]  # uvicorn passes it to call_later

    monkeypatch.setattr(http_protocol.BoundedHttpProtocol, "connection_made", soon)
    async with connected(application()) as (reader, writer):
        writer.write(first)
        await reader.readuntil(b"\r\n\r\n")
        writer.write(rest)
        await reader.read()
        assert reader.at_eof()


async def test_malformed_request_is_refused_after_the_previous_response() -> None:
    """An answer without a body, and something that is no request right behind."""
    async with listening(application()) as port, asyncio.timeout(SECONDS):
        for _ in range(20):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(b"HEAD /hello HTTP/1.1\r\nhost: here\r\n\r\n")
            assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 200")
            writer.write(b"nothing\r\n\r\n")
            assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 400")
            writer.close()


async def test_number_of_connections_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_protocol, "MAX_CONNECTIONS", 2)
    async with listening(application()) as port:
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


@pytest.mark.parametrize("sent", [0, 10, 1 << 20], ids=["nothing", "some", "much"])
async def test_early_response_is_readable_while_the_body_is_incomplete(sent: int) -> None:
    async with connected(application()) as (reader, writer):
        writer.write(b"POST /full HTTP/1.1\r\nhost: here\r\ncontent-length: 100000000\r\n\r\n" + b"b" * sent)
        head = await reader.readuntil(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 503 Service Unavailable\r\n")
        assert b"\r\nretry-after: 7\r\n" in head
        assert await reader.readexactly(4) == b"busy"


async def test_early_response_is_readable_after_sending_the_whole_body_and_the_connection_stays() -> None:
    async with connected(application()) as (reader, writer):
        for _ in range(2):
            writer.write(b"POST /full HTTP/1.1\r\nhost: here\r\ncontent-length: 30000000\r\n\r\n")
            for _ in range(30):
                writer.write(b"b" * 1_000_000)
                await writer.drain()
            assert (await reader.readuntil(b"busy")).startswith(b"HTTP/1.1 503 ")
        writer.write(_HELLO)
        assert (await reader.readuntil(b'"there"')).startswith(b"HTTP/1.1 200 OK")


async def test_early_response_on_a_connection_that_closes_is_readable_after_sending_the_whole_body() -> None:
    """The body fills the buffers of both ends: closing with unread bytes would reset the connection."""
    async with connected(application()) as (reader, writer):
        writer.write(b"POST /full HTTP/1.1\r\nhost: here\r\nconnection: close\r\ncontent-length: 30000000\r\n\r\n")
        for _ in range(30):
            writer.write(b"b" * 1_000_000)
            await writer.drain()
        answer = await reader.read()  # to the end of the connection
        assert answer.startswith(b"HTTP/1.1 503 ")
        assert b"\r\nconnection: close\r\n" in answer
        assert answer.endswith(b"\r\n\r\nbusy")


@pytest.mark.parametrize("limit", ["DISCARD_SECONDS", "DISCARD_BYTES"])
async def test_endless_body_after_an_early_response_closes_the_connection(
    monkeypatch: pytest.MonkeyPatch, limit: str
) -> None:
    monkeypatch.setattr(http_protocol, limit, 0.05 if limit == "DISCARD_SECONDS" else 1 << 20)
    async with connected(application()) as (_, writer):
        writer.write(b"POST /full HTTP/1.1\r\nhost: here\r\ntransfer-encoding: chunked\r\n\r\n")

        async def send_for_ever() -> None:
            while True:
                writer.write(b"8000\r\n" + b"b" * 0x8000 + b"\r\n")
                await writer.drain()

        with pytest.raises(ConnectionError):
            await send_for_ever()


CHUNKED = b"POST /take HTTP/1.1\r\nhost: here\r\ntransfer-encoding: chunked\r\n\r\n"


@pytest.mark.parametrize("malformed", [b"no chunk size\r\n", b"1;" + b"e" * (http_protocol.MAX_HEAD_BYTES + 1)])
async def test_a_malformed_body_after_its_response_gets_no_second_response(malformed: bytes) -> None:
    async with connected(application()) as (reader, writer):
        writer.write(b"POST /full HTTP/1.1\r\nhost: here\r\ntransfer-encoding: chunked\r\n\r\n1\r\nx\r\n")
        head = await reader.readuntil(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 503 ")
        assert await reader.readexactly(4) == b"busy"
        writer.write(malformed)
        with contextlib.suppress(ConnectionError):
            assert await reader.read() == b""


async def test_trailers_are_ignored() -> None:
    async with connected(application()) as (reader, writer):
        writer.write(CHUNKED + b"5\r\nhello\r\n0\r\nauthorization: Bearer stolen\r\n\r\n")
        assert (await reader.readuntil(b"\r\n\r\n5")).startswith(b"HTTP/1.1 200 OK")


@pytest.mark.parametrize(
    ("start", "more"),
    [(b"5\r\nhello\r\n0\r\n", b"a: b\r\n" * 1000), (b"0\r\na: ", b"b" * 10_000), (b"5;", b"b" * 10_000)],
    ids=["trailers", "a trailer", "an extension"],
)
async def test_chunk_extensions_and_trailers_are_limited(start: bytes, more: bytes) -> None:
    async with connected(application()) as (reader, writer):
        writer.write(CHUNKED + start)
        for _ in range(100):
            writer.write(more)
        answer = await reader.readuntil(b"\r\n\r\n")
        assert answer.startswith(b"HTTP/1.1 431 ")
        assert await reader.readline() == b"The chunk extensions or trailers are longer than 65536 bytes.\n"


async def test_tiny_chunks_are_parsed_in_slices(received: list[int]) -> None:
    async with connected(application()) as (reader, writer):
        writer.write(CHUNKED + b"1\r\nx\r\n" * 50_000 + b"0\r\n\r\n")
        assert (await reader.readuntil(b"\r\n\r\n50000")).startswith(b"HTTP/1.1 200 OK")
        assert max(received) <= http_protocol.SLICE_BYTES
        size = 10_000_000  # nothing in a plain body has to be looked at, so it comes in larger pieces
        writer.write(b"POST /take HTTP/1.1\r\nhost: here\r\ncontent-length: %d\r\n\r\n" % size + b"b" * size)
        assert (await reader.readuntil(b"\r\n\r\n10000000")).startswith(b"HTTP/1.1 200 OK")
        assert max(received) > http_protocol.SLICE_BYTES


async def test_pipelined_requests_are_limited() -> None:
    get = b"GET /hello HTTP/1.1\r\nhost: here\r\n\r\n"
    async with connected(application()) as (reader, writer):
        writer.write(get * 20)
        for _ in range(20):
            assert (await reader.readuntil(b'"there"')).startswith(b"HTTP/1.1 200 OK")
        writer.write(get * 1000)
        try:
            answers = await reader.read()
        except ConnectionError:
            answers = b""  # the connection is cut off, with what was on its way
        assert answers.count(b'"there"') < 1000


_WAIT = b"GET /wait HTTP/1.1\r\nhost: here\r\n\r\n"
_HELLO = b"GET /hello HTTP/1.1\r\nhost: here\r\n\r\n"
_JUNK = b"POST /take HTTP/1.1\r\nhost: here\r\ntransfer-encoding: chunked\r\n\r\n1\r\nx\r\n0\r\n"


@pytest.mark.parametrize("between", [b"", _HELLO])
@pytest.mark.parametrize(
    ("refused", "status"),
    [
        (b"GET /hello HTTP/1.1\r\nx-long: " + b"p" * (2 * http_protocol.MAX_HEAD_BYTES), b"431"),
        (_JUNK + b"x-trailer: 1\r\n" * 20_000, b"431"),
        (b"\r\n" * (2 * http_protocol.MAX_HEAD_BYTES), b"431"),
        (b"GET /hello no such version\r\n\r\n", b"400"),
    ],
    ids=["head", "trailers", "nothing", "malformed"],
)
async def test_refusal_follows_the_responses_to_earlier_requests(
    refused: bytes, status: bytes, between: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_protocol, "DISCARD_SECONDS", 0.05)
    held = asyncio.Event()
    async with listening(application(held)) as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(_WAIT + between)
        await writer.drain()
        writer.write(refused)
        other = await asyncio.open_connection("127.0.0.1", port)
        for _ in range(20):  # meanwhile the server has read as much as it wants; a refusal that comes at once is there
            other[1].write(_HELLO)
            await other[0].readuntil(b'"there"')
        other[1].close()
        held.set()
        answers: list[bytes] = []
        for _ in range(2 if between else 1):
            head = await reader.readuntil(b"\r\n\r\n")
            assert head.startswith(b"HTTP/1.1 200 ")
            answers.append(await reader.readexactly(7 if answers else 8))
        assert answers == [b'"waited"', b'"there"'][: len(answers)]
        last = await asyncio.wait_for(reader.read(), SECONDS)
        assert last.startswith(b"HTTP/1.1 " + status + b" ")
        assert last.count(b"HTTP/1.1 ") == 1
        writer.close()
