"""Transport by another TCPQ hub (``--lcm-url tcpq://host:port``), without liblcm.

liblcm's client would block the event loop while it connects, and from a message's first byte to its last.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable
from typing import Final, cast
from urllib.parse import urlsplit

from scenegate.lcm.tcpq import CLIENT_HELLO, MAGIC_HUB, FrameError, FrameParser, FrameType, publish, subscription_frame
from scenegate.lcm.transport import LcmMessage, OnMessage

_log = logging.getLogger("scenegate.lcm")

DEFAULT_PORT: Final = 7700
"""liblcm's default port of a hub."""
RETRY_SECONDS: Final = 1.0
"""Interval between attempts to connect."""
CONNECT_SECONDS: Final = 10.0
"""Timeout of one attempt to connect."""
DRAIN_SECONDS: Final = 0.005
"""Interval at which ``drain`` checks the bytes that are queued."""
FINISH_SECONDS: Final = 10.0
"""Maximum time that ``finish`` waits until the hub closes the connection."""
MAX_UNSENT_BYTES: Final = 512 * 1024 * 1024
"""Maximum bytes queued for the hub. Further messages fail."""


class TcpqTransport:
    """``Transport`` by a hub. It subscribes to one pattern, and connects again when the connection is lost."""

    def __init__(self, url: str, pattern: str, max_message: int) -> None:
        """Prepare to receive the channels of a regular expression from ``tcpq://[host[:port]]``; ``start`` connects.

        Raises ValueError if the URL has no valid port.
        """
        self.url = url
        parts = urlsplit(url)
        self.host, self.port = parts.hostname or "127.0.0.1", parts.port or DEFAULT_PORT
        self._pattern = pattern
        self._max_message = max_message
        self._connection: _Connection | None = None
        self._task: asyncio.Task[None] | None = None
        self._problem = "not connected yet"
        """Reason why there is no connection."""
        self._finishing = False

    def start(self, on_message: OnMessage, on_connect: Callable[[], None]) -> None:
        self._task = asyncio.get_running_loop().create_task(self._run(on_message, on_connect))

    @property
    def is_connected(self) -> bool:
        return self._connection is not None

    def publish(self, channel: str, message: bytes | bytearray) -> None:
        self._current_connection().publish(channel, message)

    async def drain(self, max_bytes: int) -> None:
        while self._current_connection().unsent_bytes > max_bytes:  # noqa: ASYNC110 - rare, and a few milliseconds long
            await asyncio.sleep(DRAIN_SECONDS)

    async def finish(self) -> None:
        """Send all queued messages, shut down sending, and wait until the hub closes the connection.

        To close the socket at once would reset the connection if it holds unread messages of the hub. The hub would
        then lose messages that it has not read.
        """
        await self.drain(0)
        self._finishing = True
        connection = self._connection
        if connection is not None:
            connection.write_eof()
            await asyncio.wait({connection.lost}, timeout=FINISH_SECONDS)

    async def close(self) -> None:
        # Before Python 3.12, ``wait_for`` loses a cancellation that comes when the connection is made.
        while self._task is not None and not self._task.done():
            self._task.cancel()
            await asyncio.wait({self._task}, timeout=DRAIN_SECONDS)

    def status(self) -> dict[str, object]:
        connected = self._connection is not None
        return {"url": self.url, "connected": connected, **({} if connected else {"warning": self._problem})}

    def _current_connection(self) -> _Connection:
        """Return the connection; raise OSError if there is none."""
        if self._connection is None:
            raise OSError(f"{self.url}: {self._problem}")
        return self._connection

    async def _run(self, on_message: OnMessage, on_connect: Callable[[], None]) -> None:
        """Connect, again and again, until cancelled or finished."""
        loop = asyncio.get_running_loop()
        while True:
            connection = _Connection(self._pattern, self._max_message, on_message, self._set_connection)
            try:
                connecting = loop.create_connection(lambda: connection, self.host, self.port)  # noqa: B023 - used at once
                await asyncio.wait_for(connecting, CONNECT_SECONDS)
                _log.info("Connected to the LCM hub %s", self.url)
                on_connect()
                problem = f"the hub has gone: {await connection.lost}"
            except socket.gaierror:
                problem = f"the host {self.host!r} is unknown"
            except ConnectionRefusedError:
                problem = "no hub listens there"
            except (OSError, asyncio.TimeoutError) as error:
                reason = error.strerror if isinstance(error, OSError) else None
                problem = f"the hub cannot be reached: {reason or 'timeout'}"
            finally:
                self._connection = None
                connection.close("")
            if self._finishing:
                return
            if problem != self._problem:
                _log.warning("%s: %s", self.url, problem)
            self._problem = problem
            await asyncio.sleep(RETRY_SECONDS)

    def _set_connection(self, connection: _Connection) -> None:
        """Publish by this connection from now on: the hub's first message, its greeting, is answered."""
        self._connection = connection


class _Connection(asyncio.BufferedProtocol):
    """One TCP connection to the hub."""

    def __init__(
        self, pattern: str, max_message: int, on_message: OnMessage, on_made: Callable[[_Connection], None]
    ) -> None:
        self._pattern = pattern
        self._on_message = on_message
        self._on_made = on_made
        self._parser = FrameParser(MAGIC_HUB, max_message, self._on_frame)
        self._transport: asyncio.Transport | None = None
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        """Completed when the connection is lost, with the reason."""

    @property
    def unsent_bytes(self) -> int:
        """Bytes queued for the hub."""
        return self._transport.get_write_buffer_size() if self._transport is not None else 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)
        self._transport.write(CLIENT_HELLO + subscription_frame(FrameType.SUBSCRIBE, self._pattern))
        self._on_made(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._transport = None
        if not self.lost.done():
            self.lost.set_result(str(exc) if exc is not None else "it has closed the connection")

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._parser.buffer()

    def buffer_updated(self, nbytes: int) -> None:
        try:
            self._parser.received(nbytes)
        except FrameError as error:
            self.close(str(error))

    def publish(self, channel: str, message: bytes | bytearray) -> None:
        transport = self._transport
        if transport is None or transport.is_closing():
            raise OSError("the hub has gone")
        if transport.get_write_buffer_size() + len(message) > MAX_UNSENT_BYTES:
            raise OSError("the hub reads too slowly")
        publish(transport, channel, message)

    def write_eof(self) -> None:
        """Shut down sending; receiving continues."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write_eof()

    def close(self, reason: str) -> None:
        """Close the connection at once. ``reason`` becomes the result of ``lost``, unless it has one."""
        if not self.lost.done():
            self.lost.set_result(reason)
        if self._transport is not None:
            self._transport.abort()

    def _on_frame(self, frame_type: FrameType, channel: str, data: bytes | memoryview) -> None:
        if frame_type is FrameType.PUBLISH:
            self._on_message(LcmMessage(channel, data))
