"""Received messages: the queue, the socket's buffer, liblcm's file descriptor, and the choice of the transport."""

import asyncio
import select
import socket
import struct
import sys
import time
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.runtime.lcm import tcpq_hub
from gateway.runtime.lcm.config import LcmConfig
from scenegate.lcm import network, udpm_socket
from scenegate.lcm.liblcm_transport import MAX_READ_MESSAGES, LiblcmTransport
from scenegate.lcm.transport import MAX_HANDLED, OVERHEAD_BYTES, LcmMessage, ReceiveQueue
from tests.support.waiting import SECONDS, until, wait_until


def queue_of(*names: str, handled: list[str]) -> ReceiveQueue:
    queue = ReceiveQueue(1 << 20)
    queue.start(lambda message: handled.append(message.channel))
    for name in names:
        queue.put(LcmMessage(name, b"x"))
    return queue


@pytest.mark.parametrize("count", [0, 1, MAX_HANDLED - 1, MAX_HANDLED])
async def test_a_few_messages_are_handled_at_once(count: int) -> None:
    handled: list[str] = []
    queue = queue_of(*map(str, range(count)), handled=handled)
    queue.handle_some()
    assert handled == [str(number) for number in range(count)]
    assert queue.waiting_bytes == 0


async def test_the_event_loop_continues_between_many_messages() -> None:
    handled: list[str] = []
    names = [str(number) for number in range(4 * MAX_HANDLED)]
    queue = queue_of(*names, handled=handled)
    queue.handle_some()
    assert queue.waiting_bytes == 3 * MAX_HANDLED * (len(b"x") + OVERHEAD_BYTES)
    queue.handle_some()
    for turns in (2, 3, 4):
        assert handled == names[: turns * MAX_HANDLED]
        await asyncio.sleep(0)


def test_messages_beyond_the_limit_are_counted() -> None:
    queue = ReceiveQueue(2 * (10 + OVERHEAD_BYTES))
    for _ in range(3):
        queue.put(LcmMessage("a", bytes(10)))
    assert queue.status() == {"waiting_bytes": 2 * (10 + OVERHEAD_BYTES), "dropped": 1, "dropped_bytes": 10}
    queue.close()
    assert queue.status() == {"waiting_bytes": 0, "dropped": 1, "dropped_bytes": 10}


def test_the_receive_buffer_has_the_requested_size() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 100_000)
        assert udpm_socket.receive_buffer(sock) == 100_000
        assert udpm_socket.raise_receive_buffer(sock, 120_000) == 120_000


@dataclass
class FakeSocket:
    """A socket without permission or counters."""

    refused: tuple[int, ...] = ()
    counters: bytes | None = None
    sizes: dict[int, int] = field(default_factory=dict)

    def setsockopt(self, _: int, option: int, value: int) -> None:
        if option in self.refused:
            raise PermissionError
        self.sizes[option] = value

    def getsockopt(self, _: int, option: int, length: int = 0) -> Any:
        if option == socket.SO_RCVBUF:
            return 2 * next(iter(self.sizes.values()), 50)
        if self.counters is None:
            raise OSError("no such option")
        return self.counters[:length]


def test_the_system_limits_the_receive_buffer_of_other_users() -> None:
    sock: Any = FakeSocket()
    assert udpm_socket.raise_receive_buffer(sock, 100) == 100
    assert list(sock.sizes) == [33], "the option for privileged users is enough"
    sock = FakeSocket(refused=(33,))
    assert udpm_socket.raise_receive_buffer(sock, 100) == 100
    assert list(sock.sizes) == [socket.SO_RCVBUF]
    sock = FakeSocket(refused=(33, socket.SO_RCVBUF))
    assert udpm_socket.raise_receive_buffer(sock, 100) == 50


def test_dropped_datagrams_are_the_last_of_nine_counters() -> None:
    counters = struct.pack("9I", *range(11, 20))
    for data, dropped in ((counters, 19), (counters[:-4], 0), (None, 0)):
        sock: Any = FakeSocket(counters=data)
        assert udpm_socket.dropped_datagrams(sock) == dropped


def test_the_systems_limit(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "rmem_max"
    monkeypatch.setattr(udpm_socket, "_RMEM_MAX", path)
    assert udpm_socket.system_limit() is None
    for text, limit in (("212992\n", 212_992), ("much", None)):
        path.write_text(text)
        assert udpm_socket.system_limit() == limit


@pytest.mark.parametrize("url", ["tcpq://h:1", "udpm://239.1.1.1:1", "file:///log"])
def test_the_transport_of_a_url(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[Any, ...]] = []
    for name in ("TcpqTransport", "UdpmTransport", "LiblcmTransport"):
        monkeypatch.setattr(network, name, lambda *given, name=name: calls.append((name, *given)))
    config = LcmConfig(message_bytes=5000, queued_bytes=77)
    network.open_transport(url, ("DIRECTOR", "DRAKE_"), config)
    expected: dict[str, tuple[Any, ...]] = {
        "tcpq": ("TcpqTransport", url, "(DIRECTOR|DRAKE_).*", 6024),
        "udpm": ("UdpmTransport", url, ("DIRECTOR", "DRAKE_"), config, 6024),
        "file": ("LiblcmTransport", url, "(DIRECTOR|DRAKE_).*", 77),
    }
    assert calls == [expected[url.partition(":")[0]]]


@pytest.mark.parametrize(
    ("url", "environment", "resolved"),
    [
        ("a", "b", "a"),
        (None, "b", "b"),
        ("", "b", "b"),
        (None, None, network.DEFAULT_URL),
        (None, "", network.DEFAULT_URL),
    ],
)
def test_the_url_is_the_given_one_the_environments_or_lcms(
    url: str | None, environment: str | None, resolved: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if environment is None:
        monkeypatch.delenv("LCM_DEFAULT_URL", raising=False)
    else:
        monkeypatch.setenv("LCM_DEFAULT_URL", environment)
    assert network.resolve_url(url) == resolved


class FakeLcm:
    """liblcm with messages that are read one by one."""

    def __init__(self, _: str) -> None:
        self.readable, self.other_end = socket.socketpair()
        self.waiting = 0
        self.timeouts: list[int] = []
        self.capacity = -1
        self.published: list[tuple[str, bytes]] = []

    def subscribe(self, pattern: str, put: Any) -> Any:
        self.put = put
        return SimpleNamespace(set_queue_capacity=lambda size: setattr(self, "capacity", size))

    def fileno(self) -> int:
        return self.readable.fileno()

    def handle_timeout(self, milliseconds: int) -> int:
        self.timeouts.append(milliseconds)
        if self.waiting <= 0:
            return 0
        self.waiting -= 1
        self.put("channel", b"data")
        return 1

    def publish(self, channel: str, message: bytes) -> None:
        if channel == "refused":
            raise OSError("no network")
        self.published.append((channel, message))


@pytest.mark.parametrize("waiting", [1, 3, MAX_READ_MESSAGES, MAX_READ_MESSAGES + 2])
async def test_liblcm_is_read_without_waiting(waiting: int, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[FakeLcm] = []

    def make(url: str) -> FakeLcm:
        made.append(FakeLcm(url))
        return made[-1]

    monkeypatch.setitem(sys.modules, "lcm", SimpleNamespace(LCM=make))
    transport = LiblcmTransport("file:///log", ".*", 1 << 20)
    (lcm,) = made
    assert lcm.capacity == 0, "no limit"
    received: list[str] = []
    transport.start(lambda message: received.append(message.channel), lambda: None)
    lcm.waiting = waiting
    lcm.other_end.send(b"x")
    await until(lambda: received)
    lcm.readable.recv(len(b"x"))
    assert set(lcm.timeouts) == {0}
    await until(lambda: len(received) + lcm.waiting >= waiting)
    transport.publish("channel", b"message")
    assert lcm.published == [("channel", b"message")]
    with pytest.raises(OSError, match="7 bytes on 'refused'"):
        transport.publish("refused", b"message")
    await transport.close()
    for end in (lcm.readable, lcm.other_end):
        end.close()


class FakeTransport:
    """A client's connection."""

    def __init__(self, *, closing: bool) -> None:
        self.closing = closing
        self.calls: list[str] = []

    def is_closing(self) -> bool:
        return self.closing

    def pause_reading(self) -> None:
        self.calls.append("pause")

    def resume_reading(self) -> None:
        self.calls.append("resume")


@pytest.mark.parametrize(("closing", "calls"), [(False, ["pause", "resume", "pause"]), (True, [])])
def test_a_client_is_paused_and_resumed_once(closing: bool, calls: list[str]) -> None:
    hub: Any = SimpleNamespace(config=LcmConfig(), reserve=lambda size: True, release=lambda size: None)
    connection: Any = tcpq_hub.HubConnection(hub)
    connection.pause_reading()
    connection.resume_reading()
    transport = connection._transport = FakeTransport(closing=closing)  # noqa: SLF001 - without a socket
    connection.resume_reading()
    connection.pause_reading()
    connection.pause_reading()
    connection.resume_reading()
    connection.resume_reading()
    connection.pause_reading()
    assert transport.calls == calls


async def test_messages_keep_the_time_of_their_arrival() -> None:
    arrivals: list[int] = []
    queue = ReceiveQueue(1 << 20)
    queue.start(lambda message: arrivals.append(message.arrival))
    for arrival in range(MAX_HANDLED + 2):
        queue.put(LcmMessage("a", b"x", arrival=arrival))
    queue.handle_some()
    await until(lambda: len(arrivals) == MAX_HANDLED + 2)
    assert arrivals == list(range(MAX_HANDLED + 2))


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other timestamps")
def test_datagrams_have_the_time_at_which_the_socket_received_them() -> None:
    receiver, sender = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    receiver.bind(("127.0.0.1", 0))
    udpm_socket.enable_timestamps(receiver)

    def waited_in_the_socket() -> bool:
        begin = time.time_ns()
        sender.sendto(b"datagram", receiver.getsockname())
        select.select([receiver], [], [], SECONDS)
        end = time.time_ns()
        datagram, _, arrival = udpm_socket.receive(receiver, 100)
        return datagram == b"datagram" and begin <= arrival <= end

    with receiver, sender:
        wait_until(waited_in_the_socket)  # the system needs a moment to switch its timestamps on
