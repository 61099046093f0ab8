"""Our place at somebody else's TCPQ hub (``--lcm-url tcpq://host:port``), without liblcm.

liblcm's own client waits for a whole message in one call, and for the hub's greeting when it connects: on the event
loop both would stop everybody.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Callable
from typing import Final, cast
from urllib.parse import urlsplit

import structlog

from gateway.lcm.errors import LcmUnavailable
from gateway.lcm.tcpq import CLIENT_HELLO, MAGIC_HUB, Frame, FrameError, FrameReader, publish_head, subscription

_log = structlog.get_logger("gateway.treeviewer")

PORT: Final = 7700
RETRY_SECONDS: Final = 1.0
CONNECT_SECONDS: Final = 10.0
DRAIN_SECONDS: Final = 0.005
FINISH_SECONDS: Final = 10.0
MOST_UNSENT_BYTES: Final = 512 * 1024 * 1024
"""Answers waiting for the hub; beyond it they are refused."""

Receive = Callable[[str, "bytes | memoryview"], None]


class TcpqBus:
    """Connects, subscribes, and connects again whenever the hub has gone."""

    def __init__(self, url: str, pattern: str, most_bytes: int) -> None:
        """
        Args:
            url: tcpq://host:port; both may be left out.
            pattern: of the channels to receive.
            most_bytes: of one message.
        Raises:
            LcmUnavailable: the URL has no usable port.
        """
        self.url = url
        parts = urlsplit(url)
        try:
            self.host, self.port = parts.hostname or "127.0.0.1", parts.port or PORT
        except ValueError:
            raise LcmUnavailable(f"LCM cannot join {url}: its port is not a number") from None
        self._pattern = pattern
        self._most = most_bytes
        self._connection: _Connection | None = None
        self._task: asyncio.Task[None] | None = None
        self._problem = "not connected yet"
        self._finishing = False

    def start(self, receive: Receive, connected: Callable[[], None]) -> None:
        """Messages go to ``receive`` from now on; ``connected`` is called after every connecting."""
        self._task = asyncio.get_running_loop().create_task(self._stay(receive, connected))

    def publish(self, channel: str, message: bytes) -> None:
        """Raises OSError when there is no connection, or too much waits for it."""
        if self._connection is None:
            raise OSError(f"{self.url}: {self._problem}")
        self._connection.publish(channel, message)

    async def drained(self, most: int) -> None:
        """Returns when at most ``most`` bytes wait for the hub. Raises OSError when there is no connection."""
        while True:
            if self._connection is None:
                raise OSError(f"{self.url}: {self._problem}")
            if self._connection.unsent_bytes <= most:
                return
            await asyncio.sleep(DRAIN_SECONDS)

    async def finish(self) -> None:
        """Publishes nothing more; returns when the hub has taken everything and left, or does not.

        Closing alone would reset the connection where a word of the hub lies unread here, and the hub would lose what
        it has not read.
        """
        self._finishing = True
        connection = self._connection
        if connection is not None:
            connection.finish()
            await asyncio.wait({connection.lost}, timeout=FINISH_SECONDS)

    async def close(self) -> None:
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task

    def status(self) -> dict[str, object]:
        """Plain JSON values."""
        connected = self._connection is not None
        return {"url": self.url, "connected": connected, **({} if connected else {"warning": self._problem})}

    async def _stay(self, receive: Receive, connected: Callable[[], None]) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                async with asyncio.timeout(CONNECT_SECONDS):
                    _, connection = await loop.create_connection(
                        lambda: _Connection(self._pattern, self._most, receive), self.host, self.port
                    )
            except (OSError, TimeoutError) as error:
                reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else "no answer"
                self._note(f"the hub cannot be reached: {reason}")
            else:
                self._connection = connection
                _log.info("Connected to an LCM hub", url=self.url)
                connected()
                try:
                    reason = await connection.lost
                finally:
                    self._connection = None
                    connection.end("")
                if self._finishing:
                    return
                self._note(f"the hub has gone: {reason}")
            await asyncio.sleep(RETRY_SECONDS)

    def _note(self, problem: str) -> None:
        if problem != self._problem:
            _log.warning(problem, url=self.url)
        self._problem = problem


class _Connection(asyncio.BufferedProtocol):
    def __init__(self, pattern: str, most: int, receive: Receive) -> None:
        self._pattern = pattern
        self._receive = receive
        self._reader = FrameReader(MAGIC_HUB, most, self._framed, lambda _: True)
        self._transport: asyncio.Transport | None = None
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)
        self._transport.write(CLIENT_HELLO + subscription(Frame.SUBSCRIBE, self._pattern))

    def connection_lost(self, exc: Exception | None) -> None:
        self._transport = None
        if not self.lost.done():
            self.lost.set_result(str(exc) if exc is not None else "it has closed the connection")

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._reader.buffer()

    def buffer_updated(self, nbytes: int) -> None:
        try:
            self._reader.received(nbytes)
        except FrameError as error:
            self.end(str(error))

    def publish(self, channel: str, message: bytes) -> None:
        transport = self._transport
        if transport is None or transport.is_closing():
            raise OSError("the hub has gone")
        if transport.get_write_buffer_size() + len(message) > MOST_UNSENT_BYTES:
            raise OSError("the hub does not read")
        transport.write(publish_head(channel, len(message)) + message)

    @property
    def unsent_bytes(self) -> int:
        return self._transport.get_write_buffer_size() if self._transport is not None else 0

    def finish(self) -> None:
        """Tells the hub that nothing more comes."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write_eof()

    def end(self, reason: str) -> None:
        """Closes the connection for this reason."""
        if not self.lost.done():
            self.lost.set_result(reason)
        if self._transport is not None:
            self._transport.abort()

    def _framed(self, kind: Frame, channel: str, data: bytes | memoryview) -> None:
        if kind is Frame.PUBLISH:
            self._receive(channel, data)
