"""UDP multicast by our own sockets: limits, a blocked network, errors, and messages to and from liblcm."""

import asyncio
import contextlib
import errno
import os
import socket
import threading
from dataclasses import replace
from typing import Any, cast

import pytest

from gateway.adapters.treeviewer.protocol import REQUEST, RESPONSE
from gateway.runtime.lcm.config import LcmConfig
from scenegate.lcm import udpm, udpm_socket
from scenegate.lcm.transport import LcmMessage, LcmUnavailableError
from scenegate.lcm.udpm_assembler import Assembler
from scenegate.lcm.udpm_sender import UdpmSender
from scenegate.lcm.udpm_transport import UdpmTransport
from scenegate.lcm.url import UdpmUrl, parse_udpm_url
from tests.adapters.treeviewer.transports import free_url, in_thread, join, lossless
from tests.support.waiting import SECONDS, until


def open_udpm(url: str, message_bytes: int = 1 << 20, **limits: Any) -> UdpmTransport:
    return UdpmTransport(url, (REQUEST,), replace(LcmConfig(receive_buffer_bytes=1 << 20), **limits), message_bytes)


@pytest.mark.lcm
async def test_drops_and_counts_messages_beyond_the_queue_limit(url: str) -> None:
    transport = open_udpm(url, queued_bytes=3000)
    for _ in range(20):
        transport.queue.put(LcmMessage("c", b"x" * 744))
    status = transport.status()
    assert (status["waiting_bytes"], status["dropped"], status["dropped_bytes"]) == (3000, 17, 17 * 744)
    await transport.close()


class Narrow:
    """A socket that blocks until its peer reads."""

    def __init__(self) -> None:
        self.near, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.near.setblocking(False)
        self.far.setblocking(False)

    def sendmsg(self, pieces: list[bytes], *_: object) -> int:
        return self.near.sendmsg(pieces)

    def fileno(self) -> int:
        return self.near.fileno()

    def close(self) -> None:
        self.near.close()
        self.far.close()

    def read(self) -> list[bytes]:
        found = []
        with contextlib.suppress(BlockingIOError):
            while True:
                found.append(self.far.recv(1 << 17))
        return found


async def test_queues_what_the_network_does_not_accept_yet() -> None:
    network = Narrow()
    sender = UdpmSender(cast("socket.socket", network), ("x", 1), "udpm://", 1 << 20)
    try:
        with pytest.raises(OSError, match="accepts nothing now"):  # no event loop yet
            sender.send("early", bytes(8 << 20))
        network.read()
        sender.start()
        big = os.urandom(4 << 20)
        sender.send("big", big)  # a single message may exceed the limit
        with pytest.raises(OSError, match=r"accepts nothing: \d+ bytes are queued"):
            sender.send("small", b"x")
        assert sender.unsent_bytes > 1 << 20
        assembler = Assembler((b"",), 1 << 30, 1 << 30)
        found: list[udpm.UdpmMessage] = []

        def passed() -> list[udpm.UdpmMessage]:
            messages = [assembler.receive(datagram, ("x", 1)) for datagram in network.read()]
            found.extend(message for message in messages if message is not None)
            return found

        await until(lambda: bool(passed()))
        await sender.drain(0)
        sender.send("small", b"x")
        await until(lambda: len(passed()) == 2)
        assert [(channel, bytes(data)) for channel, data in found] == [("big", big), ("small", b"x")]
        assert sender.unsent_bytes == 0
    finally:
        sender.close()
        network.close()


async def test_accepts_a_message_that_fills_the_queue_exactly() -> None:
    network = Narrow()
    sender = UdpmSender(cast("socket.socket", network), ("x", 1), "udpm://", 8 << 20)
    try:
        sender.start()
        sender.send("big", bytes(4 << 20))
        room = (8 << 20) - sender.unsent_bytes
        with pytest.raises(OSError, match="accepts nothing"):
            sender.send("c", bytes(room + 1))
        sender.send("c", bytes(room))
    finally:
        sender.close()
        network.close()


@pytest.mark.lcm
async def test_reports_a_taken_udp_port(url: str) -> None:
    network = parse_udpm_url(url)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taker:
        taker.bind(("", network.port))
        with pytest.raises(LcmUnavailableError, match=f"another program keeps port {network.port} for itself"):
            open_udpm(url)


@pytest.mark.parametrize(("number", "reason"), [(errno.ENODEV, "ip route add 224"), (errno.EPERM, "not permitted")])
def test_reports_missing_multicast(number: int, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*args: Any) -> None:
        raise OSError(number, os.strerror(number))

    class Refusing(socket.socket):
        bind = fail

    monkeypatch.setattr(socket, "socket", Refusing)
    with pytest.raises(LcmUnavailableError, match=reason):
        open_udpm(free_url())


class DeafSocket(socket.socket):
    """A socket that sends nothing."""

    def sendto(self, data: Any, *where: Any) -> int:
        return len(data)


@pytest.mark.lcm
def test_reports_a_failed_self_test(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udpm_socket, "SELF_TEST_SECONDS", 0.01)
    monkeypatch.setattr(udpm_socket, "send_socket", lambda network: DeafSocket(socket.AF_INET, socket.SOCK_DGRAM))
    with pytest.raises(LcmUnavailableError, match="what is sent there does not come back"):
        open_udpm(url)


def test_parses_udpm_urls() -> None:
    assert parse_udpm_url("udpm://239.255.1.2:7668?ttl=1&recv_buf_size=4096") == UdpmUrl("239.255.1.2", 7668, 1, 4096)
    assert parse_udpm_url("udpm://") == UdpmUrl("239.255.76.67", 7667, 0, 0)
    unknown = parse_udpm_url("udpm://224.0.0.1?transmit_only=true")
    assert (unknown.port, unknown.unknown_options) == (7667, ("transmit_only",))


AGAIN_MS = 1000
"""Interval at which a message that may have been dropped is sent again."""


@pytest.mark.lcm
async def test_exchanges_big_messages_with_liblcm(url: str) -> None:
    """Sizes around the borders of fragments, with small messages of another sender in between."""
    ours = open_udpm(url, 1 << 28, receive_buffer_bytes=8 << 20)
    theirs, other = join(url), join(url)
    arrived: list[bytes] = []
    lossless(theirs, RESPONSE, lambda channel, data: arrived.append(data))
    here: dict[str, list[bytes]] = {f"{REQUEST}_<b>": [], f"{REQUEST}_<s>": []}
    ours.start(lambda message: here[message.channel].append(bytes(message.data)), lambda: None)
    try:
        # bigger messages need larger buffers than every system has
        for size in (
            0,
            1,
            udpm.MAX_SHORT_BYTES,
            udpm.MAX_FRAGMENT_BYTES,
            130_001,
            *(() if ours.warning else (1_000_001,)),
        ):
            message = os.urandom(size)
            if size < 200_000:
                arrived.clear()
                async with asyncio.timeout(SECONDS):
                    while message not in arrived:  # the kernel drops datagrams when liblcm's buffer is full
                        ours.publish(RESPONSE, message)
                        await in_thread(theirs.handle_timeout, AGAIN_MS)
            theirs.publish("SOMETHING_ELSE", message)

            sending = threading.Thread(target=theirs.publish, args=(f"{REQUEST}_<b>", message))
            sending.start()
            for _ in range(5):
                other.publish(f"{REQUEST}_<s>", b"small")
            await until(lambda: len(here[f"{REQUEST}_<b>"]) == 1 and len(here[f"{REQUEST}_<s>"]) == 5)
            sending.join()
            assert here[f"{REQUEST}_<b>"].pop() == message
            assert here[f"{REQUEST}_<s>"] == [b"small"] * 5
            here[f"{REQUEST}_<s>"].clear()
        assert ours.status()["incomplete"] == ours.status()["waiting_bytes"] == 0
    finally:
        await ours.close()
