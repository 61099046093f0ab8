"""Helpers that run the service and connect clients to it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import socket
import struct
from collections.abc import AsyncIterator, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.context import MeshLoader
from gateway.adapters.treeviewer.service import TreeViewerService
from gateway.runtime.lcm.config import LcmConfig
from gateway.scene.tree.live import LiveTree
from scenegate.lcm.tcpq import CLIENT_HELLO, HUB_HELLO, FrameType, publish_header, subscription_frame
from tests.support.liblcm import liblcm
from tests.support.waiting import MILLISECONDS, SECONDS


def free_url() -> str:
    return f"udpm://239.255.76.67:{random.randrange(20000, 60000)}?ttl=0"


def config_of(url: str) -> TreeViewerConfig:
    return TreeViewerConfig(lcm=LcmConfig(url=url, tcpq_port=0))


def join(url: str) -> Any:
    """Return a liblcm client; skip the test where LCM does not work."""
    lcm = liblcm()
    # A client receives its own requests, too: in the default buffer, a big one leaves no place for the response.
    buffer = f"recv_buf_size={4 << 20}"
    try:
        return lcm.LCM(f"{url}{'&' if '?' in url else '?'}{buffer}" if url.startswith("udpm") else url)
    except RuntimeError:
        pytest.skip(f"LCM cannot join {url}: there is no route for multicast")


@contextlib.asynccontextmanager
async def serving(
    config: TreeViewerConfig | None = None,
    meshes: MeshLoader | None = None,
    live: LiveTree | None = None,
    **changes: Any,
) -> AsyncIterator[TreeViewerService]:
    """Run the service, by default with a hub on a free port and no LCM. ``changes`` are fields of its configuration."""
    config = config or TreeViewerConfig(lcm=LcmConfig(url="off", tcpq_port=0))
    of_lcm = {name: changes.pop(name) for name in tuple(changes) if name in LcmConfig.__dataclass_fields__}
    config = replace(config, lcm=replace(config.lcm, **of_lcm), **changes)
    service = TreeViewerService(config, live or LiveTree(), meshes)
    task = asyncio.create_task(service.run())
    ready = asyncio.create_task(service.wait_ready())
    try:
        await asyncio.wait({task, ready}, return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            task.result()
        yield service
        assert not task.done(), task
    finally:
        ready.cancel()
        task.cancel()
        await asyncio.gather(task, ready, return_exceptions=True)
        assert not service.ready


class HubClient:
    """A TCPQ client that does not use our parser."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    @classmethod
    async def connect(cls, port: int, *, receive_buffer: int | None = None) -> HubClient:
        sock = socket.socket()
        if receive_buffer is not None:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        sock.setblocking(False)
        await asyncio.get_running_loop().sock_connect(sock, ("127.0.0.1", port))
        reader, writer = await asyncio.open_connection(sock=sock, limit=2**16)
        writer.write(CLIENT_HELLO)
        async with asyncio.timeout(SECONDS):
            assert await reader.readexactly(8) == HUB_HELLO
        return cls(reader, writer)

    async def subscribe(self, pattern: str, kind: FrameType = FrameType.SUBSCRIBE) -> None:
        self.writer.write(subscription_frame(kind, pattern))
        await self.writer.drain()

    async def publish(self, channel: str, data: bytes) -> None:
        self.writer.write(publish_header(channel, len(data)) + data)
        await self.writer.drain()

    async def next(self) -> tuple[str, bytes]:
        async with asyncio.timeout(SECONDS):
            kind, length = struct.unpack(">II", await self.reader.readexactly(8))
            assert kind == 1
            channel = (await self.reader.readexactly(length)).decode()
            (size,) = struct.unpack(">I", await self.reader.readexactly(4))
            return channel, await self.reader.readexactly(size)

    async def ended(self) -> bool:
        async with asyncio.timeout(SECONDS):
            try:
                while await self.reader.read(65536):
                    pass
            except ConnectionError:
                pass
            return True

    async def close(self) -> None:
        self.writer.close()
        with contextlib.suppress(ConnectionError):
            await self.writer.wait_closed()


async def in_thread(function: Callable[..., Any], *args: Any) -> Any:
    return await asyncio.get_running_loop().run_in_executor(None, function, *args)


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def answer_over(client: Any, received: list[tuple[str, bytes]], channel: str, data: bytes) -> tuple[str, bytes] | None:
    received.clear()
    client.publish(channel, data)
    while not received:
        if not client.handle_timeout(MILLISECONDS):
            return None
    return received[0]


def lossless(client: Any, pattern: str, callback: Callable[[str, bytes], None]) -> None:
    client.subscribe(pattern, callback).set_queue_capacity(0)
