"""Which senders count as programs on this machine, and what other machines can do."""

import asyncio
import json
import subprocess
import sys

import pytest

from gateway.runtime.lcm.config import LcmConfig
from gateway.runtime.lcm.tcpq_hub import TcpqHub
from scenegate.lcm.tcpq_transport import TcpqTransport
from scenegate.lcm.udpm_socket import ROUTE_COMMANDS
from scenegate.lcm.udpm_transport import UdpmTransport
from tests.adapters.treeviewer.transports import HubClient
from tests.support.ports import free_ports
from tests.support.waiting import SECONDS, until

Received = list[tuple[str, bool]]


@pytest.mark.slow
def test_a_machine_on_the_lan_changes_nothing_with_ttl_0() -> None:
    """Two network namespaces: a datagram of the other machine, and frames with false addresses of this one."""
    can = subprocess.run(["unshare", "-Urn", "ip", "link", "set", "lo", "up"], check=False, capture_output=True)
    if can.returncode:
        pytest.skip("this system creates no network namespaces")
    done = subprocess.run(
        ["unshare", "-Urn", sys.executable, "-m", "tests.runtime.lcm.lan"],
        check=True,
        capture_output=True,
        timeout=SECONDS,
    )
    result = json.loads(done.stdout)
    assert result["received"] == [["own", True]]
    assert result["foreign"] == 2, "the datagram and the frame with the true address; the system drops the others"
    logged = [text for text in result["logs"] if "other machines" in text]
    assert len(logged) == 1
    assert "--lcm-url 'udpm://239.255.76.67:7667?ttl=1' receives them" in logged[0]


LAPTOP = """
import asyncio, sys
from gateway.runtime.lcm.config import LcmConfig
from scenegate.lcm.udpm_socket import ROUTE_COMMANDS
from scenegate.lcm.udpm_transport import UdpmTransport
from tests.support.waiting import until

async def main():
    received = []
    transport = UdpmTransport("udpm://239.255.76.67:7667?ttl=0", ("c",), LcmConfig(), 1 << 20)
    transport.start(lambda message: received.append(message.is_local), lambda: None)
    transport.publish("c", b"x")
    await until(lambda: received or transport.foreign)
    await transport.close()
    print(received, transport.foreign)

asyncio.run(main())
"""


@pytest.mark.slow
def test_loopback_alone_suffices_with_the_advised_route() -> None:
    """Datagrams have the source 0.0.0.0 there."""
    setup = f"ip link set lo up; {ROUTE_COMMANDS.replace('sudo ', '')}; exec {sys.executable} -c '{LAPTOP}'"
    can = subprocess.run(["unshare", "-Urn", "ip", "link", "set", "lo", "up"], check=False, capture_output=True)
    if can.returncode:
        pytest.skip("this system creates no network namespaces")
    done = subprocess.run(["unshare", "-Urn", "sh", "-ec", setup], check=True, capture_output=True, timeout=SECONDS)
    assert done.stdout == b"[True] 0\n"


@pytest.mark.lcm
@pytest.mark.parametrize(("ttl", "is_local"), [(0, True), (1, False)])
async def test_own_datagrams_are_local_unless_the_network_is_open(url: str, ttl: int, is_local: bool) -> None:
    transport = UdpmTransport(url.replace("ttl=0", f"ttl={ttl}"), ("c",), LcmConfig(), 1 << 20)
    received: Received = []
    transport.start(lambda message: received.append((message.channel, message.is_local)), lambda: None)
    try:
        transport.publish("c", b"x")
        transport.publish("c", bytes(200_000))  # in fragments
        await until(lambda: len(received) == 2)
        assert received == [("c", is_local)] * 2
    finally:
        await transport.close()


@pytest.mark.lcm
async def test_foreign_datagrams_are_counted_and_dropped(
    url: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Of short and long messages; the first one is logged."""
    transport = UdpmTransport(url, ("c",), LcmConfig(), 1 << 20)
    monkeypatch.setattr(UdpmTransport, "_is_own", lambda self, address: False)
    received: Received = []
    transport.start(lambda message: received.append((message.channel, message.is_local)), lambda: None)
    try:
        transport.publish("c", b"x")
        transport.publish("c", bytes(100_000))
        await until(lambda: transport.status()["foreign_datagrams"] == 3)
        assert (received, transport.status()["waiting_bytes"]) == ([], 0)
        (logged,) = caplog.messages
        assert "ttl=1" in logged
    finally:
        await transport.close()


async def of_hub(config: LcmConfig) -> bool:
    """Return whether a client at 127.0.0.1 counts as local at a hub."""
    received: list[bool] = []
    hub = TcpqHub(config, ("g", b""))
    await hub.start(("c",), lambda message, sender: received.append(message.is_local))
    try:
        client = await HubClient.connect(hub.port)
        await client.publish("c", b"x")
        await until(lambda: received)
        await client.close()
        return received[0]
    finally:
        await hub.close()


async def test_clients_of_a_hub_are_local_if_it_listens_on_loopback_only() -> None:
    assert await of_hub(LcmConfig(tcpq_port=0))
    assert not await of_hub(LcmConfig(tcpq_port=0, tcpq_host="0.0.0.0"))


async def test_what_another_hub_relays_is_not_local() -> None:
    (port,) = free_ports(1)
    hub = TcpqHub(LcmConfig(tcpq_port=port), ("g", b""))
    await hub.start(("c",), lambda *message: None)
    relayed = TcpqTransport(f"tcpq://127.0.0.1:{port}", "c|g", 1 << 20)
    received: Received = []
    connected = asyncio.Event()
    relayed.start(lambda message: received.append((message.channel, message.is_local)), connected.set)
    try:
        async with asyncio.timeout(SECONDS):
            await connected.wait()
        await until(lambda: received)  # the greeting
        client = await HubClient.connect(port)
        await client.publish("c", b"x")
        await until(lambda: len(received) == 2)
        await client.close()
    finally:
        await relayed.close()
        await hub.close()
    assert received == [("g", False), ("c", False)]
