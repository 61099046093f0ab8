"""The TCPQ hub, by clients written from the wire."""

from __future__ import annotations

import asyncio
import socket
import struct
import threading
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.scene.live import LiveTree
from gateway.treeviewer import wire
from gateway.treeviewer.config import TreeViewerConfig
from gateway.treeviewer.patterns import PatternError, compile_pattern
from gateway.treeviewer.protocol import REQUEST, RESPONSE, TreeViewerProtocol
from gateway.treeviewer.tcpq import (
    CLIENT_HELLO,
    MAGIC_CLIENT,
    Frame,
    FrameError,
    FrameReader,
    publish_head,
    subscription,
)
from tests.treeviewer.conversation import BOX, decoded, message
from tests.treeviewer.transports import HubClient, serving, until

ONE_BOX = message({"setgeometry": [{"path": ["a"], "geometry": BOX}]})


async def test_a_client_is_answered_and_the_tree_has_its_geometry() -> None:
    live = LiveTree()
    async with serving(live=live) as service:
        client = await HubClient.connect(service.tcpq_port)
        await client.subscribe(f"{RESPONSE}_<me>")
        await client.publish(f"{REQUEST}_<me>", ONE_BOX)
        channel, answer = await client.next()
        assert channel == f"{RESPONSE}_<me>"
        assert decoded(answer)["added_geometries"] == [["a"]]
        assert live.snapshot.root.find(("a",)) is not None
        await client.close()


async def test_subscribers_of_the_bare_channel_hear_that_the_viewer_is_ready() -> None:
    async with serving() as service:
        client = await HubClient.connect(service.tcpq_port)
        await client.subscribe("OTHER")
        await client.subscribe(RESPONSE)
        channel, answer = await client.next()
        assert (channel, decoded(answer)) == (RESPONSE, {"timestamp": 0, "status": 0, "ready": True})
        await client.close()


async def test_the_hub_relays_to_every_subscriber_once_also_to_the_sender() -> None:
    async with serving() as service:
        clients = [await HubClient.connect(service.tcpq_port) for _ in range(3)]
        sender, twice, other = clients
        for pattern in ("POSE", "P.*"):
            await twice.subscribe(pattern)
        await sender.subscribe("POSE")
        await other.subscribe("POS")  # anchored on both sides
        await other.subscribe("END")
        for client in clients:  # what was sent before this has been handled
            await client.subscribe(f"{RESPONSE}_<{id(client)}>")
            await client.publish(f"{REQUEST}_<{id(client)}>", wire.encode(b"{}"))
            await client.next()
        await sender.publish("POSE", b"x" * 100_000)
        await sender.publish("END", b"e")
        assert await sender.next() == ("POSE", b"x" * 100_000)
        assert await twice.next() == ("POSE", b"x" * 100_000)
        assert await other.next() == ("END", b"e")
        await twice.subscribe("P.*", Frame.UNSUBSCRIBE)
        await twice.subscribe("POSE", Frame.UNSUBSCRIBE)
        await twice.publish(f"{REQUEST}_<{id(twice)}>", wire.encode(b"{}", 5))
        await twice.next()
        await sender.publish("POSE", b"y")
        await sender.next()
        await twice.publish(f"{REQUEST}_<{id(twice)}>", wire.encode(b"{}", 6))
        assert decoded((await twice.next())[1])["timestamp"] == 6, "nothing of POSE in between"
        for client in clients:
            await client.close()


async def test_order_holds_for_a_client_and_others_do_not_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    quick_was_answered = threading.Event()
    read = TreeViewerProtocol.open

    def read_late(self: TreeViewerProtocol, comms: wire.Comms) -> Any:
        if threading.current_thread() is not threading.main_thread():
            assert quick_was_answered.wait(60), "the big request holds up the others"
        return read(self, comms)

    monkeypatch.setattr(TreeViewerProtocol, "open", read_late)
    rows = ", ".join(["[0.123456, 1.5, 2.25]"] * 200_000)
    big = message(
        f'{{"setgeometry": [{{"path": ["cloud"], "geometry": {{"type": "pointcloud", "points": [{rows}]}}}}]}}', 1
    )
    after = message({"settransform": [{"path": ["cloud"], "transform": {}}]}, 2)
    async with serving() as service:
        slow, quick = await HubClient.connect(service.tcpq_port), await HubClient.connect(service.tcpq_port)
        await slow.subscribe(f"{RESPONSE}_<slow>")
        await quick.subscribe(f"{RESPONSE}_<.*>")
        await slow.publish(f"{REQUEST}_<slow>", big)
        for _ in range(3):
            await slow.publish(f"{REQUEST}_<slow>", after)
        await until(lambda: service.status()["received"] >= 4)
        await quick.publish(f"{REQUEST}_<quick>", ONE_BOX)
        assert (await quick.next())[0] == f"{RESPONSE}_<quick>"
        quick_was_answered.set()
        assert [(await quick.next())[0] for _ in range(4)] == [f"{RESPONSE}_<slow>"] * 4
        answers = [decoded((await slow.next())[1]) for _ in range(4)]
        assert [answer["timestamp"] for answer in answers] == [1, 2, 2, 2]
        assert [answer["status"] for answer in answers] == [0, 0, 0, 0], "the transforms found the cloud"
        assert service.status()["waiting_bytes"] == 0
        await slow.close()
        await quick.close()


async def test_a_client_whose_messages_wait_too_much_is_held_back_and_loses_nothing() -> None:
    rows = ", ".join(["[0.5, 1.5, 2.25]"] * 40_000)
    big = message(
        f'{{"setgeometry": [{{"path": ["cloud"], "geometry": {{"type": "pointcloud", "points": [{rows}]}}}}]}}'
    )
    async with serving(client_waiting_bytes=1_000_000, waiting_bytes=10_000_000) as service:
        client = await HubClient.connect(service.tcpq_port)
        await client.subscribe(f"{RESPONSE}_<me>")
        most = 0

        async def publish() -> None:
            for _ in range(40):
                await client.publish(f"{REQUEST}_<me>", big)

        publishing = asyncio.create_task(publish())
        for _ in range(40):
            assert decoded((await client.next())[1])["status"] == 0
            most = max(most, service.status()["waiting_bytes"])
        await publishing
        assert most < 4_000_000
        assert service.status()["dropped"] == 0
        await client.close()


async def test_a_reader_that_does_not_read_is_disconnected_and_others_go_on() -> None:
    async with serving(hub_client_send_bytes=1_000_000) as service:
        lazy = await HubClient.connect(service.tcpq_port, receive_buffer=4096)
        reader, sender = await HubClient.connect(service.tcpq_port), await HubClient.connect(service.tcpq_port)
        for client in (lazy, reader):
            await client.subscribe("BULK")
            await client.subscribe(f"{RESPONSE}_<{id(client)}>")
            await client.publish(f"{REQUEST}_<{id(client)}>", wire.encode(b"{}"))
            await client.next()
        for i in range(60):
            await sender.publish("BULK", bytes([i]) * 300_000)
            assert await reader.next() == ("BULK", bytes([i]) * 300_000)
        assert service.status()["tcpq"]["refused"] == 1
        assert service.status()["tcpq"]["unsent_bytes"] < 1_000_000
        assert await lazy.ended()
        for client in (lazy, reader, sender):
            await client.close()


@pytest.mark.parametrize(
    "garbage",
    [
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
        CLIENT_HELLO + struct.pack(">II", 9, 0),
        CLIENT_HELLO + struct.pack(">II", 0, 0),
        CLIENT_HELLO + struct.pack(">II", Frame.PUBLISH, 64) + b"c" * 64,
        CLIENT_HELLO + struct.pack(">II", Frame.SUBSCRIBE, 2**31),
        CLIENT_HELLO + struct.pack(">II", Frame.PUBLISH, 1) + b"\xff",
        CLIENT_HELLO + struct.pack(">II", Frame.PUBLISH, 1) + b"c" + struct.pack(">I", 2**32 - 1),
    ],
)
async def test_garbage_ends_its_own_connection_only(garbage: bytes) -> None:
    async with serving() as service:
        good = await HubClient.connect(service.tcpq_port)
        reader, writer = await asyncio.open_connection("127.0.0.1", service.tcpq_port)
        bad = HubClient(reader, writer)
        writer.write(garbage)
        assert await bad.ended()
        await good.subscribe(f"{RESPONSE}_<me>")
        await good.publish(f"{REQUEST}_<me>", ONE_BOX)
        assert decoded((await good.next())[1])["status"] == 0
        assert service.status()["tcpq"]["clients"] == 1
        await bad.close()
        await good.close()


async def test_announced_memory_is_bounded_over_all_clients() -> None:
    head = publish_head("C", 40_000_000)
    async with serving(waiting_bytes=100_000_000) as service:
        clients = [await HubClient.connect(service.tcpq_port) for _ in range(4)]
        for index, client in enumerate(clients[:2]):
            client.writer.write(head + b"x" * 1000)
            await until(lambda: service.status()["tcpq"]["arriving_bytes"] == 40_000_000 * (index + 1))  # noqa: B023
        clients[2].writer.write(head + b"x")
        assert await clients[2].ended()
        await clients[0].close()
        await clients[1].close()
        await until(lambda: service.status()["tcpq"]["clients"] == 1)
        await clients[3].publish("C", b"z" * 40_000_000)
        await clients[3].subscribe(f"{RESPONSE}_<me>")
        await clients[3].publish(f"{REQUEST}_<me>", ONE_BOX)
        assert decoded((await clients[3].next())[1])["status"] == 0
        for client in clients[2:]:
            await client.close()


async def test_clients_and_subscriptions_are_bounded() -> None:
    async with serving(hub_clients=2, hub_subscriptions=3) as service:
        first, second = await HubClient.connect(service.tcpq_port), await HubClient.connect(service.tcpq_port)
        reader, writer = await asyncio.open_connection("127.0.0.1", service.tcpq_port)
        third = HubClient(reader, writer)
        assert await third.ended()
        await third.close()
        for i in range(4):
            await first.subscribe(f"C{i}")
        await first.subscribe("(a+)+")
        await second.publish("C3", b"refused subscription")
        await second.publish("C2", b"good subscription")
        while service.status()["tcpq"]["relayed"] < 1:
            await second.publish("C2", b"good subscription")
            await asyncio.sleep(0)
        assert (await first.next())[0] == "C2"
        await first.close()
        await second.close()


async def test_a_clients_patterns_together_are_bounded_in_what_they_cost() -> None:
    async with serving() as service, asyncio.timeout(30):
        client = await HubClient.connect(service.tcpq_port)
        for i in range(3):  # two of them are as much as one client may have matched
            await client.subscribe(f".*.*.*{i}")
        await client.subscribe(".*.*.*0", Frame.UNSUBSCRIBE)
        await client.subscribe(".*.*.*3")
        for i in (2, 0, 1, 3):
            await client.publish(f"C{i}", b"")
        assert [(await client.next())[0] for _ in range(2)] == ["C1", "C3"]
        await client.close()


async def test_an_id_too_long_for_the_answers_channel_is_counted() -> None:
    async with serving() as service:
        client = await HubClient.connect(service.tcpq_port)
        await client.subscribe(f"{RESPONSE}.*")
        await client.next()  # ready
        await client.publish(f"{REQUEST}_<{'i' * 32}>", ONE_BOX)
        await client.publish(f"{REQUEST}_<{'i' * 31}>", ONE_BOX)
        channel, _ = await client.next()
        assert len(channel) == 63
        assert service.status()["unanswerable"] == 1
        await client.close()


async def test_undecodable_messages_are_counted_and_described() -> None:
    async with serving() as service:
        client = await HubClient.connect(service.tcpq_port)
        await client.subscribe(f"{RESPONSE}_<me>")
        await client.publish(f"{REQUEST}_<me>", b"junk")
        await client.publish(f"{REQUEST}_<me>", ONE_BOX)
        await client.next()
        status = service.status()
        assert (status["undecodable"], status["received"], status["answered"]) == (1, 2, 1)
        assert "4 bytes" in status["last_undecodable"]
        await client.close()


async def test_a_taken_port_is_one_sentence() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        config = TreeViewerConfig(lcm_url="off", tcpq_port=port)
        with pytest.raises(
            RuntimeError, match=f"^the TCPQ hub cannot listen on 127.0.0.1:{port}: Address already in use$"
        ):
            async with serving(config):
                pass


# --- at another hub


async def test_a_viewer_joins_another_hub_and_joins_it_again() -> None:
    async with serving() as other:
        port = other.tcpq_port
        url = f"tcpq://127.0.0.1:{port}"
        live = LiveTree()
        async with serving(TreeViewerConfig(lcm_url=url, tcpq_port=None), live=live) as service:
            await until(lambda: bool(service.status()["lcm"]["connected"]))
            client = await HubClient.connect(port)
            await client.subscribe(f"{RESPONSE}_<me>")
            while live.snapshot.root.find(("a",)) is None:  # until the hub knows of the viewer's subscription
                await client.publish(f"{REQUEST}_<me>", ONE_BOX)
                await client.next()
            await client.close()
            assert service.status()["answered"] >= 1
            for connection in tuple(other._hub.connections):
                connection.abort()
            await until(lambda: not service.status()["lcm"]["connected"])
            assert "the hub has gone" in service.status()["lcm"]["warning"]
            await until(lambda: bool(service.status()["lcm"]["connected"]))


async def test_a_hub_that_does_not_exist_yet_is_waited_for() -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
        async with serving(TreeViewerConfig(lcm_url=f"tcpq://127.0.0.1:{port}", tcpq_port=None)) as service:
            await until(lambda: "Connection refused" in service.status()["lcm"]["warning"])


async def test_the_own_hub_is_not_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    monkeypatch.setenv("LCM_DEFAULT_URL", f"tcpq://127.0.0.1:{port}")
    async with serving(TreeViewerConfig(lcm_url=None, tcpq_port=port)) as service:
        assert "lcm" not in service.status()
        assert service.status()["tcpq"]["clients"] == 0


# --- frames


FRAMES = st.lists(
    st.tuples(
        st.sampled_from(list(Frame)), st.text(st.characters(codec="ascii"), max_size=60), st.integers(0, 400_000)
    ),
    max_size=6,
)


@settings(deadline=None, max_examples=60)
@given(FRAMES, st.lists(st.integers(1, 300_000), min_size=1, max_size=20))
def test_frames_are_the_same_however_the_stream_is_cut(frames: list[tuple[Frame, str, int]], cuts: list[int]) -> None:
    got: list[tuple[Frame, str, bytes]] = []
    reader = FrameReader(MAGIC_CLIENT, 1_000_000, lambda k, c, d: got.append((k, c, bytes(d))), lambda _: True)
    stream = CLIENT_HELLO
    expected = []
    for index, (kind, name, size) in enumerate(frames):
        data = bytes([index]) * size if kind is Frame.PUBLISH else b""
        stream += publish_head(name, size) + data if kind is Frame.PUBLISH else subscription(kind, name)
        expected.append((kind, name, data))
    at, turn = 0, 0
    while at < len(stream):
        room = reader.buffer()
        assert len(room) > 0
        piece = stream[at : at + min(len(room), cuts[turn % len(cuts)])]
        room[: len(piece)] = piece
        reader.received(len(piece))
        at, turn = at + len(piece), turn + 1
    assert got == expected


@settings(deadline=None, max_examples=100)
@given(st.binary(max_size=400))
def test_any_bytes_are_frames_or_an_error(data: bytes) -> None:
    reader = FrameReader(MAGIC_CLIENT, 1000, lambda *_: None, lambda _: True)
    for chunk in (CLIENT_HELLO, data):
        room = reader.buffer()
        room[: len(chunk)] = chunk
        try:
            reader.received(len(chunk))
        except FrameError:
            return


# --- patterns


@pytest.mark.parametrize(
    ("pattern", "channel", "matches"),
    [
        ("POSE", "POSE", True),
        ("POSE", "POSE2", False),
        (".*", "anything", True),
        (r"DIRECTOR_TREE_VIEWER_RESPONSE_\<x\>", "DIRECTOR_TREE_VIEWER_RESPONSE_<x>", True),
        ("DIRECTOR_TREE_VIEWER_RESPONSE_<x>", "DIRECTOR_TREE_VIEWER_RESPONSE_<x>", True),
        ("A|B", "B", True),
        ("(?:A|B)[0-9]+", "B12", True),
        (r"a\*b", "a*b", True),
        ("[]*]x", "*x", True),
        ("(A|B|C)_.*_(LEFT|RIGHT).*?x?", "B_1_LEFT", True),
    ],
)
def test_patterns_are_anchored_regular_expressions(pattern: str, channel: str, matches: bool) -> None:
    assert bool(compile_pattern(pattern).fullmatch(channel)) is matches


@pytest.mark.parametrize(
    "pattern",
    [
        *("(a+)+", "(a|a)*", "a*a*a*a*", "(?=a)", r"(a)\1", "(", "[", "*", "a{1,99999999999}", "(?P<n>a)", "(.*){9}"),
        *("a?" * 30 + "a" * 30, "(a|aa)" * 30 + "b", "((a|aa)?)" * 20, "(?:a|aa)" * 10 + ".*.*b"),
    ],
)
def test_patterns_that_could_take_forever_are_refused(pattern: str) -> None:
    with pytest.raises(PatternError):
        compile_pattern(pattern)


@settings(deadline=None, max_examples=300)
@given(st.text(alphabet="ab.*+?{}()[]|\\1,^$<", max_size=20))
def test_any_pattern_is_compiled_or_refused_and_never_slow(pattern: str) -> None:
    try:
        compiled = compile_pattern(pattern)
    except PatternError:
        return
    compiled.fullmatch("a" * 62 + "!")
