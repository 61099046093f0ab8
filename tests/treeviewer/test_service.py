"""The service with real LCM: UDP multicast and liblcm's own TCPQ client."""

from __future__ import annotations

import asyncio
import builtins
import contextlib
import errno
import os
import socket
import sys
import threading
from collections.abc import Iterator
from typing import Any, cast

import pytest

from gateway.scene.live import LiveTree
from gateway.treeviewer import lcm_bus, receive_buffer, udpm, udpm_bus
from gateway.treeviewer.config import TreeViewerConfig
from gateway.treeviewer.errors import TreeViewerUnavailable
from gateway.treeviewer.protocol import REQUEST, RESPONSE
from tests.treeviewer import recordings
from tests.treeviewer.conversation import BOX, decoded, message
from tests.treeviewer.differences import DIFFERENCES
from tests.treeviewer.recorded_meshes import RecordedMeshes
from tests.treeviewer.test_replay import unordered
from tests.treeviewer.transports import answer_over, free_url, join, lossless, serving, until

ONE_BOX = message({"setgeometry": [{"path": ["a"], "geometry": BOX}]})


@pytest.fixture
def url() -> Iterator[str]:
    """A network of this test's own, on which LCM works."""
    network = free_url()
    join(network)
    return network


def config_of(url: str) -> TreeViewerConfig:
    return TreeViewerConfig(lcm_url=url, tcpq_port=0)


async def in_thread(function: Any, *args: Any) -> Any:
    return await asyncio.get_running_loop().run_in_executor(None, function, *args)


@pytest.mark.lcm
async def test_the_ready_message_comes_at_start(url: str) -> None:
    client = join(url)
    heard: list[tuple[str, bytes]] = []
    lossless(client, RESPONSE, lambda channel, data: heard.append((channel, data)))
    async with serving(config_of(url)):
        assert await in_thread(client.handle_timeout, 10_000)
    assert [(channel, decoded(data)) for channel, data in heard] == [
        (RESPONSE, {"timestamp": 0, "status": 0, "ready": True})
    ]


@pytest.mark.lcm
@pytest.mark.corpus
@pytest.mark.slow
@pytest.mark.parametrize("transport", ["udp", "tcpq"])
@pytest.mark.parametrize("name", recordings.names() or [pytest.param("", id="no corpus")])
async def test_recorded_requests_over_real_lcm_are_answered_like_in_process(
    name: str, transport: str, url: str
) -> None:
    name = name or "deep"
    meshes = RecordedMeshes(recordings.folder() / "assets")
    differences = DIFFERENCES.get(name, {})
    async with serving(config_of(url), meshes) as service:
        # connecting waits for the hub's greeting, so it must not hold the event loop
        client = await in_thread(join, url if transport == "udp" else f"tcpq://127.0.0.1:{service.tcpq_port}")
        heard: list[tuple[str, bytes]] = []
        lossless(client, f"{RESPONSE}_.*", lambda channel, data: heard.append((channel, data)))
        lossless(client, RESPONSE, lambda channel, data: heard.append((channel, data)))
        if transport == "tcpq":
            await in_thread(client.handle_timeout, 5000)  # the ready message

        def converse() -> None:
            for exchange in recordings.exchanges(name):
                expected = differences.get(exchange.number)
                id_too_long = len(exchange.channel) == 63
                silent = id_too_long or (expected is not None and expected.status is None)
                if silent:
                    client.publish(exchange.channel, exchange.data)
                    continue
                answer = answer_over(client, heard, exchange.channel, exchange.data)
                assert answer is not None, exchange
                channel, data = answer
                if exchange.response is not None:
                    assert channel == exchange.channel.replace("REQUEST", "RESPONSE").replace("_foo", "").replace(
                        "_<>", ""
                    )
                told = decoded(data)
                if expected is not None:
                    assert told["status"] == expected.status
                elif name != "fuzz":
                    assert unordered(told) == unordered(exchange.response)

        await in_thread(converse)
        status = service.status()
        assert status["received"] == len(recordings.exchanges(name))
        assert status["undecodable"] == sum(d.status is None for d in differences.values())
        assert status["internal_errors"] == status["dropped"] == 0
        assert status["lcm"].get("lost_datagrams", 0) == 0


@pytest.mark.lcm
async def test_a_burst_is_received_and_answered_without_loss(url: str) -> None:
    count = 2000
    async with serving(config_of(url)) as service:
        client = join(url)
        answers = 0
        done = threading.Event()

        def heard(channel: str, data: bytes) -> None:
            nonlocal answers
            answers += decoded(data)["status"] == 0

        lossless(client, f"{RESPONSE}_<b>", heard)

        def converse() -> None:
            for _ in range(count):
                client.publish(f"{REQUEST}_<b>", ONE_BOX)
            while answers < count and client.handle_timeout(3000):
                pass
            done.set()

        await in_thread(converse)
        assert service.status()["received"] == count
        assert service.status()["lcm"]["lost_datagrams"] == 0


@pytest.mark.lcm
async def test_the_receive_buffer_is_raised_or_the_sysctl_is_named(url: str) -> None:
    wanted = 8 * 1024 * 1024
    async with serving(config_of(url), receive_buffer_bytes=wanted) as service:
        status = service.status()["lcm"]
        assert status["url"] == url
        if status["receive_buffer_bytes"] < wanted:
            assert f"sysctl -w net.core.rmem_max={wanted}" in status["warning"]
        else:
            assert "warning" not in status


@pytest.mark.lcm
async def test_a_small_receive_buffer_is_warned_about(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(receive_buffer.ReceiveBuffer, "raise_to", lambda self, size: 212_992)
    monkeypatch.setattr(udpm_bus, "system_limit", lambda: 212_992)
    async with serving(config_of(url)) as service:
        assert service.status()["lcm"]["warning"] == (
            "LCM's receive buffer has 212992 bytes instead of 67108864: larger messages and bursts can get lost; "
            "'sysctl -w net.core.rmem_max=67108864' allows more (it is 212992 now)"
        )


@pytest.mark.lcm
async def test_messages_beyond_the_bound_of_waiting_bytes_are_dropped_and_counted(url: str) -> None:
    bus = udpm_bus.UdpmBus(url, REQUEST, 1 << 20, waiting_bytes=3000, message_bytes=1 << 20)
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
    bus = udpm_bus.UdpmBus(url, REQUEST, 1 << 20, 1 << 20, 1 << 20, unsent_bytes=1 << 20)
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
async def test_lcms_default_url_is_honoured(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LCM_DEFAULT_URL", url)
    async with serving(TreeViewerConfig(lcm_url=None, tcpq_port=None)) as service:
        assert service.status()["lcm"]["url"] == url


# --- what is missing is told


@pytest.fixture
def without_lcm(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine without libglib, where liblcm's extension cannot be loaded."""
    monkeypatch.delitem(sys.modules, "lcm", raising=False)
    real = builtins.__import__

    def fail(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "lcm":
            raise ImportError("No module named 'lcm.Release'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", fail)


@pytest.mark.usefixtures("without_lcm")
async def test_without_libglib_the_hub_works_and_the_reason_is_told() -> None:
    live = LiveTree()
    async with serving(TreeViewerConfig(lcm_url="memq://", tcpq_port=0), live=live) as service:
        assert service.tcpq_port
        assert "libglib-2.0.so.0: apt install libglib2.0-0" in service.status()["lcm"]["problem"]


@pytest.mark.usefixtures("without_lcm")
async def test_without_any_transport_the_service_says_why_it_ends() -> None:
    with pytest.raises(TreeViewerUnavailable, match="libglib"):
        async with serving(TreeViewerConfig(lcm_url="memq://", tcpq_port=None)):
            pass


@pytest.mark.lcm
async def test_udp_multicast_works_without_libglib(url: str, without_lcm: None) -> None:
    async with serving(config_of(url)) as service:
        assert service.status()["lcm"]["lost_datagrams"] == 0


async def test_networks_that_only_liblcm_knows_work() -> None:
    pytest.importorskip("lcm", reason="LCM cannot be imported: it needs libglib-2.0.so.0", exc_type=ImportError)
    bus = lcm_bus.LcmBus("memq://", f"{REQUEST}.*", waiting_bytes=3000)
    try:
        for _ in range(20):
            bus._arrived("c", b"x" * 744)
        assert (bus.waiting_bytes, bus.dropped, bus.dropped_bytes) == (3000, 17, 17 * 744)
        got: list[str] = []
        bus.start(lambda channel, data: got.append(channel))
        bus.publish(REQUEST, b"y")
        await until(lambda: len(got) >= 3)
        assert bus.waiting_bytes <= 1000
    finally:
        bus.close()


@pytest.mark.lcm
@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (
            "bogus://x",
            "LCM cannot join bogus://x: it knows udpm://, tcpq://, mpudpm://, memq://, file:// and 'off', nothing else",
        ),
        ("bogus", "LCM cannot join bogus: it knows udpm://"),
        ("udpm://10.1.2.3:7667", "LCM cannot join udpm://10.1.2.3:7667: 10.1.2.3 is no multicast address (224.0.0.0"),
        ("udpm://robot:7667", "LCM cannot join udpm://robot:7667: robot is no multicast address"),
        ("udpm://239.255.76.67:99999", "LCM cannot join udpm://239.255.76.67:99999: its port is not a number"),
        ("udpm://?ttl=far", "LCM cannot join udpm://?ttl=far: ttl must be a number of 0 to 255, not 'far'"),
        ("tcpq://host:port", "LCM cannot join tcpq://host:port: its port is not a number"),
    ],
)
async def test_a_network_that_cannot_be_joined_is_one_sentence(url: str, bad: str, reason: str) -> None:
    with pytest.raises(TreeViewerUnavailable) as caught:
        async with serving(TreeViewerConfig(lcm_url=bad, tcpq_port=None)):
            pass
    assert str(caught.value).startswith(reason)


@pytest.mark.lcm
async def test_a_port_that_another_program_keeps_is_one_sentence(url: str) -> None:
    network = udpm_bus.network_of(url)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taker:
        taker.bind(("", network.port))
        with pytest.raises(TreeViewerUnavailable, match=f"another program keeps port {network.port} for itself"):
            udpm_bus.UdpmBus(url, REQUEST, 1, 1, 1)


@pytest.mark.parametrize(("number", "reason"), [(errno.ENODEV, "ip route add 224"), (errno.EPERM, "not permitted")])
def test_a_machine_without_multicast_is_one_sentence(number: int, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*args: Any) -> None:
        raise OSError(number, os.strerror(number))

    class Refusing(socket.socket):
        bind = fail

    monkeypatch.setattr(socket, "socket", Refusing)
    with pytest.raises(TreeViewerUnavailable, match=reason):
        udpm_bus.UdpmBus(free_url(), REQUEST, 1, 1, 1)


@pytest.mark.lcm
def test_a_firewall_that_swallows_everything_is_one_sentence(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udpm_bus, "SELF_TEST_SECONDS", 0.01)
    monkeypatch.setattr(udpm_bus, "_sender", lambda network: DeafSocket(socket.AF_INET, socket.SOCK_DGRAM))
    with pytest.raises(TreeViewerUnavailable, match="what is sent there does not come back"):
        udpm_bus.UdpmBus(url, REQUEST, 1, 1, 1)


class DeafSocket(socket.socket):
    """Sends nothing."""

    def sendto(self, data: Any, *where: Any) -> int:
        return len(data)


async def test_liblcm_is_not_started_where_it_would_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("lcm", reason="LCM cannot be imported: it needs libglib-2.0.so.0", exc_type=ImportError)
    monkeypatch.setattr(lcm_bus, "MOST_FILES", 3)
    with pytest.raises(TreeViewerUnavailable, match="open files"):
        lcm_bus.LcmBus("memq://", "x", 1)


def test_what_udpm_urls_say() -> None:
    read = udpm_bus.network_of
    assert read("udpm://239.255.1.2:7668?ttl=1&recv_buf_size=4096") == udpm_bus.Network("239.255.1.2", 7668, 1, 4096)
    assert read("udpm://") == udpm_bus.Network("239.255.76.67", 7667, 0, 0)
    assert read("udpm://224.0.0.1?transmit_only=true").port == 7667


@pytest.mark.lcm
async def test_big_messages_pass_in_both_directions_between_liblcm_and_ours(url: str) -> None:
    """Fragments of both, of sizes around their borders, with small messages of another sender in between."""
    ours = udpm_bus.UdpmBus(url, REQUEST, 8 << 20, 1 << 28, 1 << 28)
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
                for _ in range(20):  # the kernel drops what liblcm's buffer has no room for, whoever sends
                    ours.publish(RESPONSE, message)
                    if await in_thread(theirs.handle_timeout, 1000):
                        break
                assert there.pop() == message
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
