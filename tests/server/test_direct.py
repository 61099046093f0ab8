"""Bodies that an application takes from the connection, where they lie."""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field

import pytest
from fastapi import FastAPI, Request, Response
from starlette.requests import ClientDisconnect

from gateway.server.direct import Direct
from tests.server.listening import listening
from tests.support.waiting import SECONDS, until

Address = tuple[asyncio.StreamReader, asyncio.StreamWriter]


@dataclass
class Taker:
    """What arrived by which way, and what the application does about it."""

    by_message: int = 0
    directly: int = 0
    ended: list[str] = field(default_factory=list)
    refuse_at: int | None = None
    patience: float = SECONDS
    hold: asyncio.Event | None = None

    async def __call__(self, http: Request) -> Response:
        direct = Direct.of(http.scope)
        got = bytearray()

        def take(buffer: bytes | bytearray, count: int) -> None:
            self.directly += count
            got.extend(buffer[:count])
            if self.refuse_at is not None and len(got) >= self.refuse_at:
                raise ValueError("enough")

        try:
            if direct is not None:
                await direct.pour(take, self.patience)
            else:
                got += await http.body()
                self.by_message += len(got)
            if self.hold is not None and direct is not None:
                direct.watch(lambda: self.ended.append("left"))
                await self.hold.wait()
                direct.watch(None)
        except (ValueError, TimeoutError, ClientDisconnect) as error:
            self.ended.append(type(error).__name__)
            return Response(type(error).__name__, 418)
        self.ended.append("whole")
        return Response(bytes(got[:10]) + b"%d" % sum(got))


@asynccontextmanager
async def serving(taker: Taker) -> AsyncIterator[Callable[[], AbstractAsyncContextManager[Address]]]:
    app = FastAPI()

    @app.post("/take")
    async def take(request: Request) -> Response:
        return await taker(request)

    async with listening(app) as port, asyncio.timeout(SECONDS):

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
async def test_what_comes_is_what_was_sent_however_it_is_cut(step: int) -> None:
    taker = Taker()
    body = bytes(range(256)) * (4 if step < 100 else 4000)
    async with serving(taker) as connect, connect() as (reader, writer):
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
    assert taker.ended == ["whole"] * 3
    assert taker.directly == 3 * len(body)


async def test_small_requests_in_one_piece() -> None:
    taker = Taker()
    async with serving(taker) as connect, connect() as (reader, writer):
        writer.write(post(b"first") + post(b"second") + post(b"third"))
        for body in (b"first", b"second", b"third"):
            assert await answer(reader) == (200, summary(body))
    assert taker.ended == ["whole"] * 3


async def test_requests_that_wait_behind_a_body() -> None:
    """The second comes in one piece with the end of the first one's body, by message; the third has none."""
    taker = Taker()
    first, second = b"a" * 100_000, b"b" * 100_000
    async with serving(taker) as connect, connect() as (reader, writer):
        writer.write(post(first) + post(second) + post(b""))
        for body in (first, second, b""):
            assert await answer(reader) == (200, summary(body))
    assert taker.ended == ["whole"] * 3
    assert (taker.directly, taker.by_message) == (len(first), len(second))


async def test_after_a_refusal_the_rest_is_thrown_away_and_the_connection_goes_on() -> None:
    taker = Taker(refuse_at=50_000)
    async with serving(taker) as connect, connect() as (reader, writer):
        whole = post(b"x" * 1_000_000)
        writer.write(whole[:300_000])
        assert await answer(reader) == (418, b"ValueError")
        taker.refuse_at = None
        writer.write(whole[300_000:] + post(b"y" * 100_000))
        assert await answer(reader) == (200, summary(b"y" * 100_000))
    assert taker.ended == ["ValueError", "whole"]


async def test_patience_ends_when_nothing_comes() -> None:
    taker = Taker(patience=0.05)
    async with serving(taker) as connect, connect() as (reader, writer):
        writer.write(post(b"x" * 100_000)[:50_000])
        assert await answer(reader) == (418, b"TimeoutError")


async def test_who_leaves_within_the_body_is_noticed() -> None:
    taker = Taker()
    async with serving(taker) as connect:
        async with connect() as (_, writer):
            writer.write(post(b"x" * 100_000)[:50_000])
            await until(lambda: taker.directly > 0)
        await until(lambda: taker.ended == ["ClientDisconnect"])


@pytest.mark.parametrize("size", [10, 100_000])
async def test_who_leaves_before_the_answer_is_noticed(size: int) -> None:
    taker = Taker(hold=asyncio.Event())
    async with serving(taker) as connect:
        async with connect() as (_, writer):
            writer.write(post(b"x" * size))
            await until(lambda: taker.directly == size)
        await until(lambda: taker.ended == ["left"])
        assert taker.hold is not None
        taker.hold.set()
        await until(lambda: taker.ended == ["left", "whole"])


async def test_a_client_that_asks_first_is_told_to_go_on() -> None:
    taker = Taker()
    body = b"z" * 100_000
    async with serving(taker) as connect, connect() as (reader, writer):
        whole = post(body, b"expect: 100-continue")
        writer.write(whole[: -len(body)])
        assert await reader.readuntil(b"\r\n\r\n") == b"HTTP/1.1 100 Continue\r\n\r\n"
        writer.write(body)
        assert await answer(reader) == (200, summary(body))
    assert taker.directly == len(body)


async def test_chunked_bodies_come_by_message_only() -> None:
    app = FastAPI()

    @app.post("/take")
    async def take(request: Request) -> Response:
        assert Direct.of(request.scope) is None
        return Response(b"%d" % len(await request.body()))

    async with listening(app) as port, asyncio.timeout(SECONDS):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"POST /take HTTP/1.1\r\nhost: h\r\ntransfer-encoding: chunked\r\n\r\n3\r\nabc\r\n0\r\n\r\n")
        assert await answer(reader) == (200, b"3")
        writer.close()


@pytest.mark.parametrize("protocol", [b"h2c", b"websocket"])
@pytest.mark.parametrize("more", [b"content-length: 300000", b"transfer-encoding: chunked"])
async def test_a_body_is_not_lost_to_another_protocol_in_silence(protocol: bytes, more: bytes) -> None:
    taker = Taker()
    head = b"POST /take HTTP/1.1\r\nhost: h\r\nconnection: Upgrade\r\nupgrade: %s\r\n%s\r\n\r\n" % (protocol, more)
    async with serving(taker) as connect, connect() as (reader, writer):
        writer.write(head + bytes(300_000))
        status, text = await answer(reader)
        assert (status, await reader.read()) == (400, b"")
        assert b"Upgrade" in text
    assert taker.ended == []


async def test_an_answer_that_is_due_comes_before_one_about_another_protocol(received: list[int]) -> None:
    app = FastAPI()

    @app.post("/take")
    async def take() -> Response:
        await until(lambda: sum(received) >= len(first))
        return Response(b"taken")

    first = b"POST /take HTTP/1.1\r\nhost: h\r\ncontent-length: 1\r\n\r\nx"
    other = b"POST /take HTTP/1.1\r\nhost: h\r\nconnection: Upgrade\r\nupgrade: h2c\r\ncontent-length: 1\r\n\r\nx"
    async with listening(app) as port, asyncio.timeout(SECONDS):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(first + other)
        assert await answer(reader) == (200, b"taken")
        writer.close()


async def test_another_protocol_that_is_not_spoken_is_passed_over_without_a_body() -> None:
    taker = Taker()
    async with serving(taker) as connect, connect() as (reader, writer):
        writer.write(b"GET /take HTTP/1.1\r\nhost: h\r\nconnection: Upgrade\r\nupgrade: h2c\r\n\r\n")
        status, _ = await answer(reader)
        assert status == 405


@pytest.mark.parametrize("how", ["taken", "lost"])
async def test_a_request_that_has_ended_is_not_kept_by_its_connection(how: str) -> None:
    class Begin:
        def __call__(self) -> bytes:
            return b"whole"

    begin = Begin()
    direct = Direct(asyncio.get_running_loop(), 0, begin)
    kept = weakref.ref(begin)
    del begin
    if how == "taken":
        await direct.pour(lambda buffer, count: None, SECONDS)
    else:
        direct.lose()
        with pytest.raises(ClientDisconnect):
            await direct.pour(lambda buffer, count: None, SECONDS)
    assert kept() is None
