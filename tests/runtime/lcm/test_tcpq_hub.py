"""The TCPQ hub with its clients, and the client of another hub."""

import asyncio
import socket
import threading
from contextlib import suppress
from typing import Any

import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.protocol import REQUEST, RESPONSE, TreeViewerProtocol
from gateway.runtime.lcm.config import LcmConfig
from gateway.scene.tree.live import LiveTree
from scenegate.lcm.tcpq import HUB_HELLO, MAX_CHANNEL_BYTES, publish_header
from scenegate.lcm.tcpq_transport import TcpqTransport
from scenegate.messages import wire
from tests.adapters.treeviewer.conversation import ONE_BOX, decoded, message
from tests.adapters.treeviewer.transports import HubClient, in_thread, serving
from tests.support.liblcm import liblcm
from tests.support.ports import free_ports
from tests.support.waiting import MILLISECONDS, SECONDS, until


async def test_greets_new_subscribers() -> None:
    async with serving() as service:
        client = await HubClient.connect(service.tcpq_port)
        await client.subscribe("OTHER")
        await client.subscribe(RESPONSE)
        channel, response = await client.next()
        assert (channel, decoded(response)) == (RESPONSE, {"timestamp": 0, "status": 0, "ready": True})
        await client.close()


async def test_keeps_order_per_client_without_blocking_others(monkeypatch: pytest.MonkeyPatch) -> None:
    quick_was_answered = threading.Event()
    read = TreeViewerProtocol.read

    def read_late(self: TreeViewerProtocol, comms: wire.Comms, is_local: bool = False, *, at_once: bool = False) -> Any:
        if threading.current_thread() is not threading.main_thread():
            assert quick_was_answered.wait(SECONDS), "the big request holds up the others"
        return read(self, comms, is_local, at_once=at_once)

    monkeypatch.setattr(TreeViewerProtocol, "read", read_late)
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
        assert [response["timestamp"] for response in answers] == [1, 2, 2, 2]
        assert [response["status"] for response in answers] == [0, 0, 0, 0], "the transforms found the cloud"
        assert service.status()["waiting_bytes"] == 0
        await slow.close()
        await quick.close()


async def test_counts_responses_to_too_long_client_ids() -> None:
    async with serving() as service:
        client = await HubClient.connect(service.tcpq_port)
        await client.subscribe(f"{RESPONSE}.*")
        await client.next()  # ready
        longest = MAX_CHANNEL_BYTES - len(f"{RESPONSE}_<>")
        await client.publish(f"{REQUEST}_<{'i' * (longest + 1)}>", ONE_BOX)
        for size in (31, 32, 100, longest):
            await client.publish(f"{REQUEST}_<{'i' * size}>", ONE_BOX)
            assert (await client.next())[0] == f"{RESPONSE}_<{'i' * size}>"
        assert service.status()["unanswerable"] == 1
        await client.close()


async def test_counts_undecodable_messages() -> None:
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


async def test_reports_taken_port() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        config = TreeViewerConfig(lcm=LcmConfig(url="off", tcpq_port=port))
        reason = "Address already in use; --tcpq-port chooses another"
        with pytest.raises(ConnectionError, match=f"^the TCPQ hub cannot listen on 127.0.0.1:{port}: {reason}$"):
            async with serving(config):
                pass


async def test_reconnects_to_another_hub(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenegate.lcm.tcpq_transport.RETRY_SECONDS", 0.05)
    async with serving() as other:
        port = other.tcpq_port
        url = f"tcpq://127.0.0.1:{port}"
        live = LiveTree()
        async with serving(TreeViewerConfig(lcm=LcmConfig(url=url, tcpq_port=None)), live=live) as service:
            await until(lambda: bool(service.status()["lcm"]["connected"]))
            client = await HubClient.connect(port)
            await client.subscribe(f"{RESPONSE}_<me>")
            while live.snapshot.root.find(("a",)) is None:  # until the hub knows of the viewer's subscription
                await client.publish(f"{REQUEST}_<me>", ONE_BOX)
                await client.next()
            await client.close()
            assert service.status()["answered"] >= 1
            for connection in tuple(other.hub.connections):
                connection.abort()
            await until(lambda: not service.status()["lcm"]["connected"])
            assert "the hub has gone" in service.status()["lcm"]["warning"]
            await until(lambda: bool(service.status()["lcm"]["connected"]))


async def test_a_greeting_can_be_answered_at_once() -> None:
    """The greeting may come before the task that connects goes on."""
    answers: asyncio.Queue[bytes] = asyncio.Queue()

    async def greet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(HUB_HELLO + publish_header("GREETING", 2) + b"hi")
        with suppress(asyncio.IncompleteReadError):
            await reader.readuntil(publish_header("ANSWER", 3))
            answers.put_nowait(await reader.readexactly(3))
        writer.close()

    server = await asyncio.start_server(greet, "127.0.0.1", 0)
    transport = TcpqTransport(f"tcpq://127.0.0.1:{server.sockets[0].getsockname()[1]}", "GREETING", 1000)
    async with server, asyncio.timeout(SECONDS):
        transport.start(lambda *_: transport.publish("ANSWER", b"you"), lambda: None)
        assert await answers.get() == b"you"
        await transport.close()


async def test_waits_for_a_hub() -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
        async with serving(TreeViewerConfig(lcm=LcmConfig(url=f"tcpq://127.0.0.1:{port}", tcpq_port=None))) as service:
            await until(lambda: "no hub listens there" in service.status()["lcm"]["warning"])


async def test_does_not_connect_to_its_own_hub(monkeypatch: pytest.MonkeyPatch) -> None:
    (port,) = free_ports(1)
    monkeypatch.setenv("LCM_DEFAULT_URL", f"tcpq://127.0.0.1:{port}")
    async with serving(TreeViewerConfig(lcm=LcmConfig(url=None, tcpq_port=port))) as service:
        assert "lcm" not in service.status()
        assert service.status()["tcpq"]["clients"] == 0


@pytest.mark.lcm
@pytest.mark.parametrize("size", [63, 64, 100, 300, 999])
@pytest.mark.parametrize("pattern", ["", ".*x"], ids=["its name", "a pattern"])
async def test_liblcm_clients_use_long_channel_names(size: int, pattern: str) -> None:
    channel = "x" * size

    def talk(url: str) -> tuple[str, bytes]:
        lcm = liblcm()
        sender, reader = lcm.LCM(url), lcm.LCM(url)
        heard: list[tuple[str, bytes]] = []
        for client in (sender, reader):
            client.subscribe("SYNC", lambda *_: None)
        reader.subscribe(pattern or channel, lambda *message: heard.append(message))
        reader.publish("SYNC", b"")  # it is relayed after the subscription
        assert reader.handle_timeout(MILLISECONDS)
        sender.publish(channel, b"first")
        assert reader.handle_timeout(MILLISECONDS)
        sender.publish(channel, b"second")  # the connection still works
        assert reader.handle_timeout(MILLISECONDS)
        assert [data for _, data in heard] == [b"first", b"second"]
        return heard[0]

    async with serving() as service:
        assert await in_thread(talk, f"tcpq://127.0.0.1:{service.tcpq_port}") == (channel, b"first")
        assert service.status()["tcpq"]["clients"] == 2
        assert service.status()["tcpq"]["dropped"] == 0
