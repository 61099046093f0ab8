"""An answer's head waits for its body."""

from __future__ import annotations

import asyncio
import contextlib
import random
import socket
from typing import cast

import pytest

from gateway.server.joined import Joined
from tests.support.waiting import SECONDS


class Kept:
    """A transport that keeps what is written; closed ones may not be written to, as uvloop has it."""

    def __init__(self) -> None:
        self.written: list[bytes] = []
        self.closing = False

    def write(self, data: bytes) -> None:
        assert not self.closing
        self.written.append(data)

    def writelines(self, parts: tuple[bytes, ...]) -> None:
        self.write(b"".join(parts))

    def is_closing(self) -> bool:
        return self.closing

    def close(self) -> None:
        self.closing = True


def joined() -> tuple[Joined, Kept]:
    kept = Kept()
    return Joined(cast("asyncio.Transport", kept), asyncio.get_running_loop()), kept


async def test_head_and_body_are_one_piece() -> None:
    answer, kept = joined()
    answer.write(b"head ")
    assert kept.written == []
    answer.write(b"body")
    answer.write(b"more")
    assert kept.written == [b"head body", b"more"]


async def test_a_head_alone_is_written_in_the_next_turn() -> None:
    answer, kept = joined()
    answer.write(b"head")
    await asyncio.sleep(0)
    assert kept.written == [b"head"]


async def test_a_head_is_written_before_the_end() -> None:
    answer, kept = joined()
    answer.write(b"head")
    answer.close()
    assert kept.written == [b"head"]
    assert answer.is_closing()


async def test_nothing_is_written_to_a_connection_that_has_ended() -> None:
    answer, kept = joined()
    answer.write(b"head")
    kept.close()
    await asyncio.sleep(0)
    answer.write(b"body")
    answer.flush()
    assert kept.written == []


@pytest.mark.parametrize("earlier", [b"", b"earlier " * 1_000_000])
@pytest.mark.parametrize("size", [300_000, 20_000_000])
async def test_a_large_body_arrives_whole_and_behind_what_came_before(earlier: bytes, size: int) -> None:
    """More than the system takes at once; nobody reads before all is written."""
    loop = asyncio.get_running_loop()
    ours, theirs = socket.socketpair()
    transport, _ = await loop.create_connection(asyncio.Protocol, sock=ours)
    theirs.setblocking(False)
    body = random.Random(size).randbytes(size)
    with contextlib.closing(transport), theirs:
        if earlier:
            transport.write(earlier)
        answer = Joined(transport, loop)
        answer.write(b"head ")
        answer.write(body)
        answer.close()
        got = bytearray()
        while piece := await loop.sock_recv(theirs, 1 << 20):
            got += piece
    assert got == earlier + b"head " + body


async def test_the_transport_deals_with_a_client_that_has_left() -> None:
    loop = asyncio.get_running_loop()
    ours, theirs = socket.socketpair()
    lost: asyncio.Future[Exception | None] = loop.create_future()

    class Told(asyncio.Protocol):
        def connection_lost(self, exc: Exception | None) -> None:
            lost.set_result(exc)

    transport, _ = await loop.create_connection(Told, sock=ours)
    theirs.close()
    answer = Joined(transport, loop)
    answer.write(b"head ")
    answer.write(bytes(1 << 20))
    assert isinstance(await asyncio.wait_for(lost, SECONDS), OSError | None)
