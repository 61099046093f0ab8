"""Transport by LCM's UDP multicast, without liblcm. The event loop reads the socket itself.

liblcm would read in a thread of its own, and hold the GIL while it copies a message. See
docs/decisions/0009-own-lcm-transport.md.
"""

import asyncio
import logging
import time
from collections.abc import Callable
from typing import Final

from scenegate.lcm import udpm, udpm_socket
from scenegate.lcm.transport import LcmMessage, OnMessage, ReceiveQueue, TransportLimits
from scenegate.lcm.udpm_assembler import Assembler
from scenegate.lcm.udpm_sender import UdpmSender
from scenegate.lcm.url import parse_udpm_url

_log = logging.getLogger("scenegate.lcm")

MAX_READ_DATAGRAMS: Final = 1024
"""Maximum number of datagrams read before the event loop continues: they take about 2 ms."""
MAX_READ_BYTES: Final = 1024 * 1024
"""Maximum bytes read before the event loop continues: they take about 0.5 ms."""
ADDRESS_SECONDS: Final = 1.0
"""Seconds after which the list of this machine's addresses is made again, at the next datagram."""


class UdpmTransport:
    """``Transport`` by UDP multicast. It joins the group when created; the kernel keeps datagrams until ``start``."""

    def __init__(self, url: str, prefixes: tuple[str, ...], limits: TransportLimits, max_message: int) -> None:
        """Join the multicast group and test the route; ``prefixes`` as for ``network.open_transport``.

        Raises ValueError if the URL is invalid, LcmUnavailableError if the port is in use, or there is no route.
        """
        self.url = url
        network = self._network = parse_udpm_url(url)
        if network.unknown_options:
            _log.warning("%s has unknown options: %s", url, ", ".join(network.unknown_options))
        self.queue = ReceiveQueue(limits.queued_bytes)
        self._assembler = Assembler(tuple(map(str.encode, prefixes)), max_message, limits.queued_bytes)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._receiver = udpm_socket.receive_socket(url, network)
        sender = udpm_socket.send_socket(network)
        try:
            self.warning = self._raise_receive_buffer(max(limits.receive_buffer_bytes, network.buffer_bytes))
            udpm_socket.check_route(url, network, self._receiver, sender)
        except BaseException:
            self._receiver.close()
            sender.close()
            raise
        self._sender = UdpmSender(sender, (network.address, network.port), url, limits.unsent_bytes)
        self.foreign = 0
        """Number of datagrams of other machines that were dropped, because ``ttl`` is 0."""
        self._own_addresses: frozenset[str] = frozenset()
        self._listed_at = -ADDRESS_SECONDS
        """Time of ``_own_addresses``, in seconds of the monotonic clock."""

    def start(self, on_message: OnMessage, on_connect: Callable[[], None]) -> None:
        self.queue.start(on_message)
        self._sender.start()
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._receiver.fileno(), self._on_readable)
        on_connect()

    @property
    def is_connected(self) -> bool:
        return self._loop is not None

    def publish(self, channel: str, message: bytes | bytearray) -> None:
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
            "unread_bytes": udpm_socket.unread_bytes(self._receiver) + self.queue.waiting_bytes,
            "receive_buffer_bytes": udpm_socket.receive_buffer(self._receiver),
            "lost_datagrams": udpm_socket.dropped_datagrams(self._receiver),
            "foreign_datagrams": self.foreign,
            **({"warning": self.warning} if self.warning else {}),
        }

    def _raise_receive_buffer(self, requested: int) -> str:
        """Request a receive buffer; return, and log, a warning if the kernel grants fewer bytes, else an empty text."""
        granted = udpm_socket.raise_receive_buffer(self._receiver, requested)
        if granted >= requested:
            return ""
        limit = udpm_socket.system_limit()
        current_limit = "" if limit is None else f" (it is {limit} now)"
        warning = (
            f"LCM's receive buffer has {granted} bytes instead of {requested}: larger messages "
            f"and bursts can get lost; 'sysctl -w net.core.rmem_max={requested}' allows more{current_limit}"
        )
        _log.warning(warning)
        return warning

    def _on_readable(self) -> None:
        """Read datagrams, and handle the first messages in the queue."""
        self._read()
        self.queue.handle_some()

    def _read(self) -> None:
        """Read datagrams from the kernel's buffer, which may be small, and queue the messages that they complete."""
        read_bytes = 0
        for _ in range(MAX_READ_DATAGRAMS):
            try:
                datagram, sender, arrival = udpm_socket.receive(self._receiver, udpm.MAX_DATAGRAM_BYTES)
            except (BlockingIOError, InterruptedError):
                return
            except OSError as error:
                _log.warning("LCM could not read a message: %s", error)
                return
            read_bytes += len(datagram)
            if self._network.ttl == 0 and not self._is_own(sender[0]):
                self._count_foreign(sender[0])
            elif (message := self._assembler.receive(datagram, sender)) is not None:
                self.queue.put(LcmMessage(message.channel, message.data, self._network.ttl == 0, arrival))
            if read_bytes > MAX_READ_BYTES:
                return

    def _is_own(self, address: str) -> bool:
        """Return True if an address is one of this machine's.

        Linux drops packets of other machines with such a source address, except with the setting ``accept_local``. The
        source is 0.0.0.0 where loopback is the only interface and the route has no ``src``.
        """
        now = time.monotonic()
        if now - self._listed_at >= ADDRESS_SECONDS:
            self._own_addresses, self._listed_at = udpm_socket.own_addresses(self._receiver), now
        return address in self._own_addresses or address == "0.0.0.0" or address.startswith("127.")  # noqa: S104 - not bound

    def _count_foreign(self, address: str) -> None:
        """Count a dropped datagram of another machine, and log the first one with the setting that receives them."""
        if not self.foreign:
            network = self._network
            _log.warning(
                "Datagrams of other machines such as %s are dropped, because ttl=0 stands for this machine alone; "
                "--lcm-url 'udpm://%s:%d?ttl=1' receives them",
                address,
                network.address,
                network.port,
            )
        self.foreign += 1
