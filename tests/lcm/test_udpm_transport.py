"""UDP multicast by our own sockets: bounds, a network that takes nothing, and messages to and from liblcm."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
import threading
from typing import Any, cast

import pytest

from gateway.lcm import udpm, udpm_transport
from gateway.lcm.errors import LcmUnavailable
from gateway.treeviewer.protocol import REQUEST, RESPONSE
from tests.support.waiting import SECONDS, until
from tests.treeviewer.transports import free_url, in_thread, join, lossless


@pytest.mark.lcm
async def test_messages_beyond_the_bound_of_waiting_bytes_are_dropped_and_counted(url: str) -> None:
    bus = udpm_transport.UdpmBus(url, REQUEST, 1 << 20, waiting_bytes=3000, message_bytes=1 << 20)
    try:
        for _ in range(20):
            bus._arrived(udpm.Received("c", b"x" * 744))
        assert (bus.waiting_bytes, bus.dropped, bus.dropped_bytes) == (3000, 17, 17 * 744)
        got: list[str] = []
        bus.start(lambda channel, data: got.append(channel))
        join(url).publish(REQUEST, b"y")
        await until(lambda: len(got) >= 3)
        assert bus.waiting_bytes <= 1000
    finally:
        bus.close()


class Narrow:
    """A network that takes what a socket's peer has read."""

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


@pytest.mark.lcm
async def test_a_network_that_takes_nothing_holds_nobody_up(url: str) -> None:
    bus = udpm_transport.UdpmBus(url, REQUEST, 1 << 20, 1 << 20, 1 << 20, unsent_bytes=1 << 20)
    network = Narrow()
    bus._out.close()
    bus._out = cast("socket.socket", network)
    try:
        with pytest.raises(OSError, match="takes nothing now"):  # there is no loop yet that could send the rest
            bus.publish("early", bytes(8 << 20))
        network.read()
        bus.start(lambda channel, data: None)
        big = os.urandom(4 << 20)
        bus.publish("big", big)  # alone, so whatever its size
        with pytest.raises(OSError, match=r"takes nothing: \d+ bytes wait"):
            bus.publish("small", b"x")
        assert bus.status()["unsent_bytes"] == bus.unsent_bytes > 1 << 20
        assembler = udpm.Assembler(b"", 1 << 30, 1 << 30)
        found = []

        def passed() -> list[udpm.Received]:
            for datagram in network.read():
                assembler.scratch[: len(datagram)] = datagram
                place = assembler.place
                if place is not None:
                    place[1][: len(datagram) - len(place[0])] = datagram[len(place[0]) :]
                if (message := assembler.received(len(datagram), ("x", 1))) is not None:
                    found.append(message)
            return found

        await until(lambda: bool(passed()))
        await bus.drained(0)
        bus.publish("small", b"x")
        await until(lambda: len(passed()) == 2)
        assert [(channel, bytes(data)) for channel, data in found] == [("big", big), ("small", b"x")]
        assert bus.unsent_bytes == 0
    finally:
        bus.close()
        network.close()


@pytest.mark.lcm
async def test_a_port_that_another_program_keeps_is_one_sentence(url: str) -> None:
    network = udpm_transport.network_of(url)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taker:
        taker.bind(("", network.port))
        with pytest.raises(LcmUnavailable, match=f"another program keeps port {network.port} for itself"):
            udpm_transport.UdpmBus(url, REQUEST, 1, 1, 1)


@pytest.mark.parametrize(("number", "reason"), [(errno.ENODEV, "ip route add 224"), (errno.EPERM, "not permitted")])
def test_a_machine_without_multicast_is_one_sentence(number: int, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*args: Any) -> None:
        raise OSError(number, os.strerror(number))

    class Refusing(socket.socket):
        bind = fail

    monkeypatch.setattr(socket, "socket", Refusing)
    with pytest.raises(LcmUnavailable, match=reason):
        udpm_transport.UdpmBus(free_url(), REQUEST, 1, 1, 1)


class DeafSocket(socket.socket):
    """Sends nothing."""

    def sendto(self, data: Any, *where: Any) -> int:
        return len(data)


@pytest.mark.lcm
def test_a_firewall_that_swallows_everything_is_one_sentence(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udpm_transport, "SELF_TEST_SECONDS", 0.01)
    monkeypatch.setattr(udpm_transport, "_sender", lambda network: DeafSocket(socket.AF_INET, socket.SOCK_DGRAM))
    with pytest.raises(LcmUnavailable, match="what is sent there does not come back"):
        udpm_transport.UdpmBus(url, REQUEST, 1, 1, 1)


def test_what_udpm_urls_say() -> None:
    read = udpm_transport.network_of
    assert read("udpm://239.255.1.2:7668?ttl=1&recv_buf_size=4096") == udpm_transport.Network(
        "239.255.1.2", 7668, 1, 4096
    )
    assert read("udpm://") == udpm_transport.Network("239.255.76.67", 7667, 0, 0)
    assert read("udpm://224.0.0.1?transmit_only=true").port == 7667


AGAIN_MS = 1000
"""After which a message that may have been dropped is sent again."""


@pytest.mark.lcm
async def test_big_messages_pass_in_both_directions_between_liblcm_and_ours(url: str) -> None:
    """Fragments of both, of sizes around their borders, with small messages of another sender in between."""
    ours = udpm_transport.UdpmBus(url, REQUEST, 8 << 20, 1 << 28, 1 << 28)
    theirs, other = join(url), join(url)
    there: list[bytes] = []
    lossless(theirs, RESPONSE, lambda channel, data: there.append(data))
    here: dict[str, list[bytes]] = {f"{REQUEST}_<b>": [], f"{REQUEST}_<s>": []}
    ours.start(lambda channel, data: here[channel].append(bytes(data)))
    try:
        # more than the second last would need larger buffers than every system has
        for size in (0, 1, udpm.MOST_SHORT, udpm.MOST_FRAGMENT, 130_001, *(() if ours.warning else (1_000_001,))):
            message = os.urandom(size)
            if size < 200_000:
                there.clear()
                async with asyncio.timeout(SECONDS):
                    while message not in there:  # the kernel drops what liblcm's buffer has no room for, whoever sends
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
        ours.close()
