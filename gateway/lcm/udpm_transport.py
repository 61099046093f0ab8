"""Our place on LCM's UDP multicast network, without liblcm.

liblcm reads its socket in a thread of its own, tells by a pipe that messages are there, and copies each message while
it holds the interpreter: two changes of thread a request, and milliseconds of everybody's time for a big one. Here the
event loop reads the socket itself, fragments straight to where they belong.
"""

from __future__ import annotations

import asyncio
import errno
import os
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qsl, urlsplit

import structlog

from gateway.lcm import udpm
from gateway.lcm.errors import LcmUnavailable
from gateway.lcm.receive_buffer import ReceiveBuffer, system_limit

_log = structlog.get_logger("gateway.treeviewer")

ADDRESS: Final = "239.255.76.67"
PORT: Final = 7667
"""liblcm's own defaults."""
ROUTE_HINT: Final = "there may be no route for multicast; on one machine 'ip route add 224.0.0.0/4 dev lo' adds one"
SELF_TEST: Final = b"LCM_SELF_TEST"
"""The channel on which liblcm, too, looks whether what it sends comes back."""
SELF_TEST_SECONDS: Final = 2.0
READ_AT_ONCE: Final = 1024
"""Datagrams taken from the kernel before others get their turn: 2 ms."""
BYTES_AT_ONCE: Final = 1024 * 1024
"""As ``READ_AT_ONCE`` for big datagrams: 0.5 ms."""
HANDLED_AT_ONCE: Final = 64
"""Messages answered before the loop goes on: 2 ms when they are small."""
HANDLED_BETWEEN: Final = 8
"""Messages answered before the kernel's buffer is emptied again, which by default holds 200 of them."""
DRAIN_SECONDS: Final = 0.005
OVERHEAD_BYTES: Final = 256


@dataclass(frozen=True, slots=True)
class Network:
    """What a udpm URL says."""

    address: str
    port: int
    ttl: int
    """Routers that a datagram may pass; 0: it stays on this machine."""
    buffer_bytes: int
    """The receive buffer wanted; 0: not said."""


def network_of(url: str) -> Network:
    """Reads udpm://ADDRESS:PORT?ttl=N&recv_buf_size=N; every part may be left out.

    Raises:
        LcmUnavailable: with the part that is wrong.
    """
    parts = urlsplit(url)
    try:
        address, port = parts.hostname or ADDRESS, PORT if parts.port is None else parts.port
    except ValueError:
        raise LcmUnavailable(f"LCM cannot join {url}: its port is not a number of 0 to 65535") from None
    try:
        multicast = 224 <= socket.inet_aton(address)[0] <= 239
    except OSError:
        multicast = False
    if not multicast:
        reason = f"{address} is no multicast address (224.0.0.0 to 239.255.255.255)"
        raise LcmUnavailable(f"LCM cannot join {url}: {reason}")
    numbers = {"ttl": 0, "recv_buf_size": 0}
    for name, text in parse_qsl(parts.query):
        if name not in numbers:
            _log.warning("LCM's URL has an option that means nothing here", url=url, option=name)
            continue
        most = 255 if name == "ttl" else 2**31 - 1
        if not (text.isdecimal() and int(text) <= most):
            raise LcmUnavailable(f"LCM cannot join {url}: {name} must be a number of 0 to {most}, not {text!r}")
        numbers[name] = int(text)
    return Network(address, port, numbers["ttl"], numbers["recv_buf_size"])


class UdpmBus:
    """Joins at once; receives from ``start`` on, in one event loop. What has not been read stays in the kernel."""

    def __init__(
        self,
        url: str,
        prefix: str,
        buffer_bytes: int,
        waiting_bytes: int,
        message_bytes: int,
        unsent_bytes: int = 1 << 26,
    ) -> None:
        """Joins the network.

        Args:
            prefix: of the channels to receive.
            buffer_bytes: wanted for the socket.
            waiting_bytes: of messages on their way, and of those not handled yet; what arrives beyond it is dropped.
            message_bytes: of one message.
            unsent_bytes: of messages that the network does not take yet; one may always wait.
        Raises:
            LcmUnavailable: with the reason in one sentence.
        """
        self.url = url
        network = network_of(url)
        self._to = (network.address, network.port)
        self._most_waiting = waiting_bytes
        self._waiting: deque[udpm.Received] = deque()
        self.waiting_bytes = 0
        self.dropped = 0
        self.dropped_bytes = 0
        self._unsent: deque[list[bytes | memoryview]] = deque()
        self.unsent_bytes = 0
        self._most_unsent = unsent_bytes
        self._sequence = 0
        self._receive: Callable[[str, bytes | memoryview], None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._scheduled = False
        self._assembler = udpm.Assembler(prefix.encode(), message_bytes, waiting_bytes)
        self._in = _joined(url, network)
        self._out = _sender(network)
        try:
            self._buffer = ReceiveBuffer(self._in)
            self.warning = self._raise_buffer(max(buffer_bytes, network.buffer_bytes))
            self._test()
        except BaseException:
            self._in.close()
            self._out.close()
            raise

    def start(self, receive: Callable[[str, bytes | memoryview], None]) -> None:
        """Messages go to ``receive`` from now on, in the running event loop."""
        self._receive = receive
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._in.fileno(), self._readable)

    def publish(self, channel: str, message: bytes) -> None:
        """Sends at once what the network takes at once, the rest as soon as it does; never waits.

        Raises OSError or ValueError when it cannot be sent (a channel of more than 63 bytes, no network, too much that
        waits already).
        """
        if self._unsent and self.unsent_bytes + len(message) > self._most_unsent:
            raise OSError(f"the network {self.url} takes nothing: {self.unsent_bytes} bytes wait for it")
        datagrams = udpm.datagrams(channel, message, self._sequence)
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        if not self._unsent:
            for pieces in datagrams:
                try:
                    self._out.sendmsg(pieces, (), 0, self._to)
                except BlockingIOError:
                    self._wait_with(pieces)
                    break
        for pieces in datagrams:
            self._wait_with(pieces)

    async def drained(self, most: int) -> None:
        """Returns when at most ``most`` bytes wait for the network."""
        while self.unsent_bytes > most:  # noqa: ASYNC110 - nobody else waits for it
            await asyncio.sleep(DRAIN_SECONDS)

    def close(self) -> None:
        """Leaves the network."""
        if self._loop is not None:
            self._loop.remove_reader(self._in.fileno())
            self._loop.remove_writer(self._out.fileno())
            self._loop = None
        self._receive = None
        self._waiting.clear()
        self._unsent.clear()
        self.unsent_bytes = 0
        self._in.close()
        self._out.close()

    def status(self) -> dict[str, object]:
        """Plain JSON values."""
        self._assembler.give_up_stale()
        described: dict[str, object] = {
            "url": self.url,
            "waiting_bytes": self.waiting_bytes + self._assembler.waiting_bytes,
            "dropped": self.dropped,
            "dropped_bytes": self.dropped_bytes,
            "incomplete": self._assembler.incomplete,
            "refused": self._assembler.refused,
            "unsent_bytes": self.unsent_bytes,
            "receive_buffer_bytes": self._buffer.size(),
            "lost_datagrams": self._buffer.lost_datagrams(),
        }
        if self.warning:
            described["warning"] = self.warning
        return described

    def _raise_buffer(self, wanted: int) -> str:
        granted = self._buffer.raise_to(wanted)
        if granted >= wanted:
            return ""
        limit = system_limit()
        known = "" if limit is None else f" (it is {limit} now)"
        warning = (
            f"LCM's receive buffer has {granted} bytes instead of {wanted}: larger messages "
            f"and bursts can get lost; 'sysctl -w net.core.rmem_max={wanted}' allows more{known}"
        )
        _log.warning(warning)
        return warning

    def _test(self) -> None:
        """What is sent must come back, else a route or a firewall is in the way."""
        end = time.monotonic() + SELF_TEST_SECONDS
        datagram = b"".join((udpm.SHORT, os.urandom(4), SELF_TEST, b"\0lcm self test"))
        while time.monotonic() < end:
            try:
                self._out.sendto(datagram, self._to)
            except OSError:
                raise LcmUnavailable(f"LCM cannot join {self.url}: {ROUTE_HINT}") from None
            while select.select([self._in], [], [], 0.1)[0]:
                if self._in.recv(udpm.DATAGRAM_BYTES) == datagram:
                    return
        raise LcmUnavailable(
            f"LCM cannot join {self.url}: what is sent there does not come back, a route or a firewall is in the way"
        )

    def _wait_with(self, pieces: list[bytes | memoryview]) -> None:
        if self._loop is None:
            raise OSError(f"the network {self.url} takes nothing now")
        if not self._unsent:
            self._loop.add_writer(self._out.fileno(), self._writable)
        self._unsent.append(pieces)
        self.unsent_bytes += sum(map(len, pieces))

    def _writable(self) -> None:
        """Sends what waits, a bounded amount: others have their turn, too."""
        size = 0
        while self._unsent and size < BYTES_AT_ONCE:
            pieces = self._unsent[0]
            try:
                self._out.sendmsg(pieces, (), 0, self._to)
            except (BlockingIOError, InterruptedError):
                return
            except OSError as error:  # the network has gone; a message that misses a part is lost as a whole
                _log.warning("LCM could not send a message", reason=str(error))
            self._unsent.popleft()
            here = sum(map(len, pieces))
            self.unsent_bytes -= here
            size += here
        if not self._unsent and self._loop is not None:
            self._loop.remove_writer(self._out.fileno())

    def _readable(self) -> None:
        if not self._scheduled:
            self._go_on()

    def _go_on(self) -> None:
        """Answers what is there; the kernel's buffer is kept empty meanwhile, since it may be small."""
        self._scheduled = False
        if not self._waiting and self._read(1):
            self._handle(1)  # one that comes alone is answered before anything else is looked at
        for _ in range(HANDLED_AT_ONCE // HANDLED_BETWEEN):
            more = self._read(READ_AT_ONCE)
            if not self._waiting:
                return
            self._handle(HANDLED_BETWEEN)
            if not more and not self._waiting:
                return
        if self._waiting and self._loop is not None and not self._scheduled:
            self._scheduled = True
            self._loop.call_soon(self._go_on)

    def _read(self, most: int) -> bool:
        """Moves datagrams from the kernel to the queue; returns whether there may be more."""
        assembler, receiving = self._assembler, self._in
        size = 0
        for _ in range(most):
            place = assembler.place
            try:
                if place is None:
                    count, sender = receiving.recvfrom_into(assembler.scratch)
                else:
                    count, _, _, sender = receiving.recvmsg_into(place)
            except (BlockingIOError, InterruptedError):
                return False
            except OSError as error:
                _log.warning("LCM could not read a message", reason=str(error))
                return False
            message = assembler.received(count, sender)
            if message is not None:
                self._arrived(message)
            size += count
            if size > BYTES_AT_ONCE:
                break
        return True

    def _arrived(self, message: udpm.Received) -> None:
        size = len(message.data) + OVERHEAD_BYTES
        if self.waiting_bytes + size > self._most_waiting:
            self.dropped += 1
            self.dropped_bytes += len(message.data)
            return
        self._waiting.append(message)
        self.waiting_bytes += size

    def _handle(self, most: int) -> None:
        waiting = self._waiting
        for _ in range(min(most, len(waiting))):
            channel, data = waiting.popleft()
            self.waiting_bytes -= len(data) + OVERHEAD_BYTES
            if self._receive is not None:
                self._receive(channel, data)


def _joined(url: str, network: Network) -> socket.socket:
    receiving = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        receiving.setblocking(False)
        receiving.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        receiving.bind((network.address, network.port))
        group = struct.pack("4s4s", socket.inet_aton(network.address), bytes(4))
        receiving.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    except OSError as error:
        receiving.close()
        taken = f"another program keeps port {network.port} for itself"
        reason = {errno.EADDRINUSE: taken, errno.ENODEV: ROUTE_HINT}.get(error.errno or 0, str(error.strerror))
        raise LcmUnavailable(f"LCM cannot join {url}: {reason}") from None
    return receiving


def _sender(network: Network) -> socket.socket:
    sending = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sending.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, network.ttl)
    sending.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    sending.setblocking(False)
    return sending
