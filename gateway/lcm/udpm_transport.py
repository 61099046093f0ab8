"""LCM's UDP multicast network on the event loop, without liblcm.

liblcm would read in a thread of its own and hold the GIL while it copies a message. The event loop reads the socket
itself: no thread is woken. See docs/decisions/0009-own-lcm-transport.md.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

import structlog

from gateway.lcm import udpm, udpm_socket
from gateway.lcm.config import LcmConfig
from gateway.lcm.receive_buffer import dropped_datagrams, raise_receive_buffer, receive_buffer, system_limit
from gateway.lcm.receive_queue import ReceiveQueue
from gateway.lcm.transport import OnMessage
from gateway.lcm.udpm_assembler import Assembler
from gateway.lcm.udpm_sender import UdpmSender

_log = structlog.get_logger("gateway.lcm")

MAX_READ: Final = 1024
"""Datagrams read before the event loop continues; about 2 ms."""
MAX_READ_BYTES: Final = 1024 * 1024
"""Bytes read before the event loop continues; about 0.5 ms."""


class UdpmTransport:
    """``Transport`` by sockets of our own. Joins the group at once; datagrams wait in the kernel until ``start``."""

    def __init__(self, url: str, prefix: str, config: LcmConfig, max_message: int) -> None:
        """
        Args:
            prefix: start of the channel names to receive.
            max_message: maximum bytes of one message.
        Raises:
            LcmUnavailableError: with the reason in one sentence.
        """
        self.url = url
        network = udpm_socket.parse_url(url)
        self.queue = ReceiveQueue(config.queued_bytes)
        self._assembler = Assembler(prefix.encode(), max_message, config.queued_bytes)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._receiver = udpm_socket.receive_socket(url, network)
        sender = udpm_socket.send_socket(network)
        try:
            self.warning = self._raise_buffer(max(config.receive_buffer_bytes, network.buffer_bytes))
            udpm_socket.check_route(url, network, self._receiver, sender)
        except BaseException:
            self._receiver.close()
            sender.close()
            raise
        self._sender = UdpmSender(sender, (network.address, network.port), url, config.unsent_bytes)

    def start(self, on_message: OnMessage, on_connect: Callable[[], None]) -> None:
        self.queue.start(on_message)
        self._sender.start()
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._receiver.fileno(), self._readable)
        on_connect()

    def publish(self, channel: str, message: bytes) -> None:
        self._sender.send(channel, message)

    async def drain(self, max_bytes: int) -> None:
        await self._sender.drain(max_bytes)

    async def finish(self) -> None:
        await self._sender.drain(0)

    async def close(self) -> None:
        if self._loop is not None:
            self._loop.remove_reader(self._receiver.fileno())
            self._loop = None
        self.queue.close()
        self._sender.close()
        self._receiver.close()

    def status(self) -> dict[str, object]:
        self._assembler.discard_stale()
        return {
            "url": self.url,
            **self.queue.status(),
            "waiting_bytes": self.queue.waiting_bytes + self._assembler.waiting_bytes,
            "incomplete": self._assembler.incomplete,
            "refused": self._assembler.refused,
            "unsent_bytes": self._sender.unsent_bytes,
            "receive_buffer_bytes": receive_buffer(self._receiver),
            "lost_datagrams": dropped_datagrams(self._receiver),
            **({"warning": self.warning} if self.warning else {}),
        }

    def _raise_buffer(self, wanted: int) -> str:
        """Return a warning if the kernel grants less than ``wanted`` bytes, else an empty string."""
        granted = raise_receive_buffer(self._receiver, wanted)
        if granted >= wanted:
            return ""
        limit = system_limit()
        current = "" if limit is None else f" (it is {limit} now)"
        warning = (
            f"LCM's receive buffer has {granted} bytes instead of {wanted}: larger messages "
            f"and bursts can get lost; 'sysctl -w net.core.rmem_max={wanted}' allows more{current}"
        )
        _log.warning(warning)
        return warning

    def _readable(self) -> None:
        self._read()
        self.queue.handle()

    def _read(self) -> None:
        """Move datagrams from the kernel, whose buffer may be small, to the queue."""
        read_bytes = 0
        for _ in range(MAX_READ):
            try:
                datagram, sender = self._receiver.recvfrom(udpm.MAX_DATAGRAM_BYTES)
            except (BlockingIOError, InterruptedError):
                return
            except OSError as error:
                _log.warning("LCM could not read a message", reason=str(error))
                return
            message = self._assembler.receive(datagram, sender)
            if message is not None:
                self.queue.put(message.channel, message.data)
            read_bytes += len(datagram)
            if read_bytes > MAX_READ_BYTES:
                return
