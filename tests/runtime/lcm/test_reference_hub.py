"""Our hub and LCM's own (Java) hub relay alike: the same conversation with both."""

import asyncio
import contextlib
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

from scenegate.lcm.tcpq import FrameType
from tests.adapters.treeviewer.transports import HubClient, serving
from tests.support.ports import free_ports
from tests.support.waiting import SECONDS


def reference() -> list[str]:
    """Return the command that starts LCM's hub, to which its port must be added."""
    java, spec = shutil.which("java"), find_spec("lcm")
    if java is None or spec is None or spec.origin is None:
        pytest.skip("there is no Java, or no LCM")
    jars = sorted(Path(spec.origin).parents[1].glob("share/java/lcm.jar"))
    if not jars:
        pytest.skip("this LCM comes without lcm.jar")
    return [java, "-cp", str(jars[0]), "lcm.lcm.TCPService"]


async def settled(client: HubClient, number: int) -> None:
    """Wait until the hub has handled everything that the client sent."""
    await client.subscribe(f"SYNC{number}")
    await client.publish(f"SYNC{number}", b"")
    while (await client.next())[0] != f"SYNC{number}":
        pass


async def conversation(port: int) -> list[tuple[str, int]]:
    """Relaying to the sender, once for several matching patterns, anchored, and the end of a subscription."""
    clients = [await HubClient.connect(port) for _ in range(3)]
    sender, twice, other = clients
    await sender.subscribe("POSE")
    for pattern in ("POSE", "P.*"):
        await twice.subscribe(pattern)
    for pattern in ("POS", "OSE", "END"):
        await other.subscribe(pattern)
    for number, client in enumerate(clients):
        await settled(client, number)
    await sender.publish("POSE", b"x" * 100_000)
    await sender.publish("END", b"e")
    heard = [await client.next() for client in clients]
    await twice.subscribe("P.*", FrameType.UNSUBSCRIBE)
    await settled(twice, 3)
    await sender.publish("POSE", b"22")
    heard.append(await twice.next())
    await twice.subscribe("POSE", FrameType.UNSUBSCRIBE)
    await twice.subscribe("END")
    await settled(twice, 4)
    await sender.publish("POSE", b"333")
    await sender.publish("END", b"ends")
    heard.append(await twice.next())
    for size in (63, 64, 100, 300, 999):
        await other.subscribe("y" * size)
    await other.subscribe("z+")
    await settled(other, 5)
    for size in (63, 64, 100, 300, 999):
        for letter in "yz":
            await sender.publish(letter * size, b"")
            heard.append(await other.next())
    for client in clients:
        await client.close()
    return [(channel, len(data)) for channel, data in heard]


LONG = [(letter * size, 0) for size in (63, 64, 100, 300, 999) for letter in "yz"]
HEARD = [("POSE", 100_000), ("POSE", 100_000), ("END", 1), ("POSE", 2), ("END", 4), *LONG]
"""Messages that the clients of a conversation receive."""


async def test_our_hub_relays() -> None:
    async with serving() as service:
        assert await conversation(service.tcpq_port) == HEARD


@pytest.mark.slow
@pytest.mark.lcm
async def test_lcms_own_hub_relays_alike() -> None:
    (port,) = free_ports(1)
    process = await asyncio.create_subprocess_exec(*reference(), str(port), stdout=asyncio.subprocess.PIPE)
    try:
        async with asyncio.timeout(SECONDS):
            await process.stdout.readline()  # it prints its load every second
        assert await conversation(port) == HEARD
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.communicate()
