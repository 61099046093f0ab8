"""Send LCM messages over UDP multicast without blocking, for ``udpm_transport``."""

import asyncio
import logging
import socket
import sys
from collections import deque
from typing import Final

from scenegate.lcm import udpm

_log = logging.getLogger("scenegate.lcm")

MAX_SENT_BYTES: Final = 1024 * 1024
"""Maximum bytes sent from the queue before the event loop continues: they take about 0.5 ms."""
DRAIN_SECONDS: Final = 0.005
"""Interval at which ``drain`` checks the queue."""


class UdpmSender:
    """Sends datagrams in order, and queues those that the kernel does not accept yet."""

    def __init__(self, sock: socket.socket, address: tuple[str, int], url: str, max_unsent: int) -> None:
        """Send with a non-blocking socket, which the sender closes, to a multicast address. Errors name the URL.

        The queue has at most ``max_unsent`` bytes, but for a single larger message.
        """
        self._socket = sock
        self._address = address
        self._url = url
        self._max_unsent = max_unsent
        self._queue: deque[list[bytes | bytearray | memoryview]] = deque()
        self._sequence = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self.unsent_bytes = 0
        """Bytes in the queue."""

    def start(self) -> None:
        """Send queued datagrams on the running event loop. Before this call nothing can be queued."""
        self._loop = asyncio.get_running_loop()

    def send(self, channel: str, message: bytes | bytearray) -> None:
        """Send a message, or queue it. Raises ValueError if the channel name or the message is too long.

        Raises OSError if the kernel refuses it, or too many bytes are queued.
        """
        if self._queue and self.unsent_bytes + len(message) > self._max_unsent:
            raise OSError(f"the network {self._url} accepts nothing: {self.unsent_bytes} bytes are queued")
        datagrams = udpm.datagrams(channel, message, self._sequence)
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        for datagram in datagrams:
            if not self._queue:
                if self._try_send(datagram):
                    continue
                if self._loop is None:
                    raise OSError(f"the network {self._url} accepts nothing now")
                self._loop.add_writer(self._socket.fileno(), self._on_writable)
            self._queue.append(datagram)
            self.unsent_bytes += sum(map(len, datagram))

    async def drain(self, max_bytes: int) -> None:
        """Wait until at most ``max_bytes`` are queued."""
        while self.unsent_bytes > max_bytes:  # noqa: ASYNC110 - rare, and a few milliseconds long
            await asyncio.sleep(DRAIN_SECONDS)

    def close(self) -> None:
        """Discard the queue and close the socket."""
        if self._loop is not None:
            self._loop.remove_writer(self._socket.fileno())
            self._loop = None
        self._queue.clear()
        self.unsent_bytes = 0
        self._socket.close()

    def _try_send(self, datagram: list[bytes | bytearray | memoryview]) -> bool:
        """Send a datagram; return False if the kernel does not accept it yet."""
        try:
            if sys.platform == "win32":
                self._socket.sendto(b"".join(datagram), self._address)
            else:
                self._socket.sendmsg(datagram, (), 0, self._address)
        except (BlockingIOError, InterruptedError):
            return False
        return True

    def _on_writable(self) -> None:
        """Send queued datagrams."""
        sent_bytes = 0
        while self._queue and sent_bytes < MAX_SENT_BYTES:
            datagram = self._queue[0]
            try:
                if not self._try_send(datagram):
                    return
            except OSError as error:  # no network; receivers discard the message if one datagram is lost
                _log.warning("LCM could not send a message: %s", error)
            self._queue.popleft()
            size = sum(map(len, datagram))
            self.unsent_bytes -= size
            sent_bytes += size
        if not self._queue and self._loop is not None:
            self._loop.remove_writer(self._socket.fileno())
