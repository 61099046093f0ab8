"""Limits of WebSocket connections."""

import asyncio
import logging
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import pytest
from fastapi import FastAPI, WebSocket, WebSocketDisconnect

from gateway.runtime.http.websocket_protocol import MAX_FRAGMENTS, SLICE_BYTES, BoundedWebSocketProtocol
from tests.runtime.http.listening import connected

UPGRADE = (
    b"GET /ws HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
TEXT, CONTINUATION, PING, PONG = 1, 0, 9, 10


def frame(opcode: int, payload: bytes = b"", *, last: bool = True) -> bytes:
    """Masked with zeros."""
    size = bytes([0x80 | len(payload)]) if len(payload) < 126 else b"\xfe" + struct.pack(">H", len(payload))
    return bytes([0x80 * last | opcode]) + size + bytes(4) + payload


@asynccontextmanager
async def upgraded() -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter, list[str]]]:
    """An upgraded connection to an application that takes messages and sends them back."""
    app = FastAPI()
    got: list[str] = []

    @app.websocket("/ws")
    async def ws(socket: WebSocket) -> None:
        await socket.accept()
        try:
            while True:
                got.append(await socket.receive_text())
                await socket.send_text(got[-1])
        except WebSocketDisconnect as end:
            got.append(str(end.code))

    async with connected(app) as (reader, writer):
        writer.write(UPGRADE)
        assert b" 101 " in await reader.readuntil(b"\r\n\r\n")
        yield reader, writer, got


@pytest.mark.parametrize(
    ("request_head", "status"),
    [
        (UPGRADE.replace(b"/ws", b"/none"), 403),
        (UPGRADE.replace(b"/ws", b"/closed"), 403),
        (UPGRADE.replace(b"Version: 13", b"Version: 12"), 400),
        (UPGRADE.replace(b"Sec-WebSocket-Key", b"X-Key"), 400),
    ],
    ids=["no route", "closed by the application", "another version", "no key"],
)
async def test_a_refused_handshake_closes_the_connection(request_head: bytes, status: int) -> None:
    app = FastAPI()

    @app.websocket("/closed")
    async def closed(socket: WebSocket) -> None:
        await socket.close()

    async with connected(app) as (reader, writer):
        writer.write(request_head)
        response = await reader.read()  # until the end of the connection
    assert response.startswith(f"HTTP/1.1 {status} ".encode())


@pytest.mark.parametrize("payload", [b"", b"x"], ids=["empty", "of a byte"])
async def test_fragments_of_a_message_are_limited(payload: bytes) -> None:
    async with upgraded() as (reader, writer, got):
        fragments = frame(TEXT, last=False) + frame(CONTINUATION, payload, last=False) * (MAX_FRAGMENTS - 2)
        writer.write(fragments + frame(CONTINUATION, b"!"))
        expected = payload.decode() * (MAX_FRAGMENTS - 2) + "!"
        assert (await reader.readexactly(2 + len(expected)))[2:].decode() == expected
        writer.write(fragments + frame(CONTINUATION, payload, last=False) * 2)
        assert struct.unpack(">H", (await reader.read())[2:4]) == (1009,)
    assert got == [expected, "1009"]


@pytest.mark.parametrize("fragments", [1, 2])
async def test_text_that_is_not_utf_8_closes_the_connection(fragments: int, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG):
        async with upgraded() as (reader, writer, got):
            writer.write(frame(TEXT, "é".encode()[:1] + b"x") if fragments == 1 else b"")
            writer.write(b"" if fragments == 1 else frame(TEXT, b"\xff", last=False) + frame(CONTINUATION, b"x"))
            writer.write(frame(TEXT, b"\xff") + frame(TEXT, b"late"))
            head = await reader.readexactly(4)
            assert (head[0], struct.unpack(">H", head[2:])) == (0x88, (1007,))
            await reader.read()
        assert got == ["1007"]
    assert not [record for record in caplog.records if record.levelno > logging.INFO or record.exc_info]


async def test_characters_may_be_split_between_fragments() -> None:
    async with upgraded() as (reader, writer, got):
        data = "é".encode()
        writer.write(frame(TEXT, data[:1], last=False) + frame(CONTINUATION, data[1:]))
        assert (await reader.readexactly(4))[2:] == data
    assert got[0] == "é"


async def test_frames_before_the_handshake_close_the_connection(caplog: pytest.LogCaptureFixture) -> None:
    answering, answered = asyncio.Event(), asyncio.Event()
    app = FastAPI()

    @app.websocket("/ws")
    async def ws(socket: WebSocket) -> None:
        answering.set()
        await answered.wait()
        await socket.accept()
        with suppress(WebSocketDisconnect):
            await socket.receive_text()

    with caplog.at_level(logging.DEBUG):
        async with connected(app) as (reader, writer):
            writer.write(UPGRADE)
            await answering.wait()
            writer.write(frame(TEXT, b"\xff"))
            with suppress(ConnectionError):
                assert await reader.read() == b""
            answered.set()
    assert not [record for record in caplog.records if record.levelno > logging.INFO or record.exc_info]


async def test_frames_are_parsed_in_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    original = BoundedWebSocketProtocol.slice_received

    def slice_received(self: BoundedWebSocketProtocol, data: bytes) -> None:
        sizes.append(len(data))
        original(self, data)

    monkeypatch.setattr(BoundedWebSocketProtocol, "slice_received", slice_received)
    async with upgraded() as (reader, writer, got):
        writer.write(frame(PONG, b"p" * 100) * 1000 + frame(TEXT, b"end"))
        assert await reader.readexactly(5) == b"\x81\x03end"
    assert len(sizes) > 50
    assert max(sizes) <= SLICE_BYTES
    assert got[0] == "end"


async def test_only_the_newest_pong_is_kept() -> None:
    written: list[bytes] = []

    class Transport:
        def write(self, data: bytes) -> None:
            written.append(data)

        def is_closing(self) -> bool:
            return False

    class Connection:
        answer = b""

        def data_to_send(self) -> list[bytes]:
            return [self.answer]

    socket = BoundedWebSocketProtocol.__new__(BoundedWebSocketProtocol)
    socket.writable = asyncio.Event()
    socket.transport = Transport()  # type: ignore[assignment]  # the part that is used
    socket.conn = Connection()  # type: ignore[assignment]  # likewise
    for number in range(1000):
        Connection.answer = b"pong %d" % number
        socket.handle_ping()
    assert written == []
    socket.resume_writing()
    socket.resume_writing()
    assert written == [b"pong 999"]
    socket.handle_ping()
    assert written == [b"pong 999"] * 2
