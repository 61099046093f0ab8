"""Limits of the TCPQ hub for memory, time and connections, and invalid frames."""

import asyncio
import struct
from functools import partial

import pytest

from gateway.adapters.treeviewer.protocol import REQUEST, RESPONSE
from gateway.adapters.treeviewer.service import TreeViewerService
from scenegate.lcm.tcpq import CLIENT_HELLO, FrameType, publish_header
from scenegate.messages import wire
from tests.adapters.treeviewer.conversation import ONE_BOX, decoded, message
from tests.adapters.treeviewer.transports import HubClient, serving
from tests.support.waiting import SECONDS, until


async def test_pauses_a_client_with_too_many_waiting_bytes() -> None:
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


async def test_disconnects_slow_readers() -> None:
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
        CLIENT_HELLO + struct.pack(">II", FrameType.PUBLISH, 65_537) + b"c" * 64,
        CLIENT_HELLO + struct.pack(">II", FrameType.SUBSCRIBE, 2**31),
        CLIENT_HELLO + struct.pack(">II", FrameType.PUBLISH, 1) + b"\xff",
        CLIENT_HELLO + struct.pack(">II", FrameType.PUBLISH, 1) + b"c" + struct.pack(">I", 2**32 - 1),
    ],
)
async def test_invalid_frames_close_only_their_connection(garbage: bytes) -> None:
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


def arriving(service: TreeViewerService, size: int) -> bool:
    return bool(service.status()["tcpq"]["arriving_bytes"] == size)


async def test_limits_announced_bytes_of_all_clients() -> None:
    head = publish_header("C", 40_000_000)
    async with serving(queued_bytes=100_000_000) as service:
        clients = [await HubClient.connect(service.tcpq_port) for _ in range(4)]
        for client, announced in zip(clients, (40_000_000, 80_000_000), strict=False):
            client.writer.write(head + b"x" * 1000)
            await until(partial(arriving, service, announced))
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


async def test_limits_clients_and_subscriptions() -> None:
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


async def test_limits_pattern_cost_per_client() -> None:
    async with serving() as service, asyncio.timeout(SECONDS):
        client = await HubClient.connect(service.tcpq_port)
        for i in range(3):  # two of them reach the limit of one client
            await client.subscribe(f".*.*.*{i}")
        await client.subscribe(".*.*.*0", FrameType.UNSUBSCRIBE)
        await client.subscribe(".*.*.*3")
        for i in (2, 0, 1, 3):
            await client.publish(f"C{i}", b"")
        assert [(await client.next())[0] for _ in range(2)] == ["C1", "C3"]
        await client.close()


async def test_drops_messages_with_too_long_channels() -> None:
    async with serving() as service:
        client = await HubClient.connect(service.tcpq_port)
        await client.subscribe("x" * 1999)  # ignored
        await client.subscribe(".*")
        await client.next()  # ready
        for size in (1000, 1999, 65_536, 999):
            await client.publish("x" * size, b"y")
        assert await client.next() == ("x" * 999, b"y")
        assert service.status()["tcpq"]["dropped"] == 3
        assert service.status()["tcpq"]["clients"] == 1
        await client.close()


async def test_skips_expensive_patterns_on_long_channels() -> None:
    async with serving() as service:
        client, other = await HubClient.connect(service.tcpq_port), await HubClient.connect(service.tcpq_port)
        await client.subscribe("a.*a.*a.*b")  # three repetitions
        await client.subscribe("a.*b")
        await other.subscribe("a.*a.*a.*b")
        await other.subscribe("END")
        for reader in (client, other):  # wait until everything sent before is handled
            await reader.subscribe(f"{RESPONSE}_<{id(reader)}>")
            await reader.publish(f"{REQUEST}_<{id(reader)}>", wire.encode(b"{}"))
            await reader.next()
        async with asyncio.timeout(SECONDS):
            await client.publish("a" * 998 + "b", b"")
            await client.publish("a" * 998 + "c", b"")
            await client.publish("END", b"")
            assert (await client.next())[0] == "a" * 998 + "b"
            assert (await other.next())[0] == "END"
        await client.close()
        await other.close()
