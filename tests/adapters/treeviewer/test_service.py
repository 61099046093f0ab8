"""The service with real LCM: UDP multicast and liblcm's own TCPQ client."""

import asyncio
import json
import sys
from typing import Any

import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.delivery import DELAY_SECONDS
from gateway.adapters.treeviewer.protocol import REQUEST, RESPONSE
from gateway.runtime.lcm.config import LcmConfig
from scenegate.lcm import udpm_socket
from tests.adapters.treeviewer import recordings
from tests.adapters.treeviewer.conversation import ONE_BOX, decoded
from tests.adapters.treeviewer.differences import DIFFERENCES
from tests.adapters.treeviewer.recorded_meshes import RecordedMeshes
from tests.adapters.treeviewer.test_recorded_requests import unordered
from tests.adapters.treeviewer.transports import answer_over, config_of, in_thread, join, lossless, serving
from tests.support.waiting import MILLISECONDS, SECONDS


@pytest.mark.lcm
async def test_announces_its_start(url: str) -> None:
    client = join(url)
    heard: list[tuple[str, bytes]] = []
    lossless(client, RESPONSE, lambda channel, data: heard.append((channel, data)))
    async with serving(config_of(url)):
        assert await in_thread(client.handle_timeout, MILLISECONDS)
    assert [(channel, decoded(data)) for channel, data in heard] == [
        (RESPONSE, {"timestamp": 0, "status": 0, "ready": True})
    ]


@pytest.mark.lcm
@pytest.mark.corpus
@pytest.mark.slow
@pytest.mark.parametrize("transport", ["udp", "tcpq"])
@pytest.mark.parametrize("name", recordings.names() or [pytest.param("", id="no corpus")])
async def test_recorded_requests_over_real_lcm(name: str, transport: str, url: str) -> None:
    name = name or "deep"
    meshes = RecordedMeshes(recordings.folder() / "assets")
    differences = DIFFERENCES.get(name, {})
    async with serving(config_of(url), meshes) as service:
        # connecting blocks until the hub's hello
        client = await in_thread(join, url if transport == "udp" else f"tcpq://127.0.0.1:{service.tcpq_port}")
        heard: list[tuple[str, bytes]] = []
        lossless(client, f"{RESPONSE}_.*", lambda channel, data: heard.append((channel, data)))
        lossless(client, RESPONSE, lambda channel, data: heard.append((channel, data)))
        if transport == "tcpq":
            assert await in_thread(client.handle_timeout, MILLISECONDS)  # the ready message

        def converse() -> None:
            for exchange in recordings.exchanges(name):
                expected = differences.get(exchange.number)
                # Over UDP the response's channel would be too long for LCM; our hub relays it.
                id_too_long = len(exchange.channel) == 63
                if id_too_long and transport == "tcpq":
                    answer: Any = answer_over(client, heard, exchange.channel, exchange.data)
                    assert answer[0] == exchange.channel.replace("REQUEST", "RESPONSE")
                    continue
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
async def test_loses_nothing_of_a_burst(url: str) -> None:
    bursts, count = 20, 100
    """Messages in a burst: as many as the kernel's default receive buffer holds."""
    async with serving(config_of(url)) as service:
        client = join(url)
        answers = 0

        def heard(channel: str, data: bytes) -> None:
            nonlocal answers
            answers += decoded(data)["status"] == 0

        lossless(client, f"{RESPONSE}_<b>", heard)

        def converse() -> None:
            for burst in range(1, bursts + 1):
                for _ in range(count):
                    client.publish(f"{REQUEST}_<b>", ONE_BOX)
                while answers < burst * count:
                    assert client.handle_timeout(MILLISECONDS), f"{burst * count - answers} answers are missing"

        await in_thread(converse)
        assert service.status()["received"] == bursts * count
        assert service.status()["lcm"]["lost_datagrams"] == 0


@pytest.mark.lcm
async def test_warns_about_a_small_receive_buffer(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udpm_socket, "raise_receive_buffer", lambda sock, size: 212_992)
    monkeypatch.setattr(udpm_socket, "system_limit", lambda: 212_992)
    async with serving(config_of(url)) as service:
        warning = service.status()["lcm"]["warning"]
        assert all(part in warning for part in ("212992 bytes instead of 67108864", "net.core.rmem_max=67108864"))


ROUNDS = 400
PAUSE = 0.002
"""Seconds between publishing and clearing: longer than a response takes, shorter than the delay."""


@pytest.mark.slow
@pytest.mark.lcm
@pytest.mark.parametrize("transport", ["udp", "tcpq"])
async def test_directors_client_loses_no_commands(url: str, transport: str) -> None:
    """Responses with status 1 are delayed for the race in Director's Python client (see ``director_client``)."""
    async with serving(TreeViewerConfig(lcm=LcmConfig(url=url, tcpq_port=0))) as service:
        network = url if transport == "udp" else f"tcpq://127.0.0.1:{service.tcpq_port}"
        command = [sys.executable, "-m", "tests.adapters.treeviewer.director_client", network, str(ROUNDS), str(PAUSE)]
        process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
        async with asyncio.timeout(10 * SECONDS):
            output, _ = await process.communicate()
    assert process.returncode == 0
    rounds = json.loads(output)
    assert len(rounds) == ROUNDS
    # on a busy machine, a client that takes longer than the delay can still lose commands
    assert not [seconds for lost, seconds in rounds if lost and seconds < DELAY_SECONDS]
