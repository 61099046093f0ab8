"""Responses with status 1 are delayed for the race in Director's Python client (see ``director_client``)."""

import asyncio
import json
import sys

import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.delivery import DELAY_SECONDS
from gateway.adapters.treeviewer.dispatch import Dispatcher
from gateway.adapters.treeviewer.protocol import REQUEST, TreeViewerProtocol
from gateway.runtime.lcm.config import LcmConfig
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.tree.live import LiveTree
from scenegate.lcm.transport import LcmMessage
from tests.adapters.treeviewer.conversation import BOX, decoded, message
from tests.adapters.treeviewer.transports import serving
from tests.support.waiting import SECONDS, until

ROUNDS = 400
PAUSE = 0.002
"""Seconds between publishing and clearing: longer than a response takes, shorter than the delay."""
FOUND = message({"setgeometry": [{"path": ["box"], "geometry": BOX}]}, 1)
MISSING = message({"settransform": [{"path": ["nothing"], "transform": {}}]}, 2)


class Client:
    """Sends requests to a dispatcher and records client and ``utime`` of the responses in order."""

    def __init__(self) -> None:
        self.dispatcher = Dispatcher(TreeViewerProtocol(LiveTree()), TreeViewerConfig(), WorkerPool(1))
        self.answered: list[tuple[str, int]] = []

    def send(self, data: bytes, name: str = "a") -> None:
        self.dispatcher.receive(self._reply, LcmMessage(f"{REQUEST}_<{name}>", data))

    def _reply(self, channel: str, data: bytes) -> None:
        self.answered.append((channel[-2:-1], decoded(data)["timestamp"]))


async def test_delays_only_responses_with_missing_paths() -> None:
    client = Client()
    client.send(MISSING)
    client.send(FOUND, "b")
    assert client.answered == [("b", 1)]
    await until(lambda: len(client.answered) == 2)
    assert client.answered[1] == ("a", 2)
    client.send(FOUND)
    assert client.answered[2] == ("a", 1), "the delay is over"


async def test_delayed_responses_keep_their_order() -> None:
    client = Client()
    for data in (FOUND, MISSING, FOUND, MISSING, MISSING, FOUND):
        client.send(data)
    assert client.answered == [("a", 1)]
    await until(lambda: len(client.answered) == 6)
    assert [utime for _, utime in client.answered] == [1, 2, 1, 2, 2, 1]
    assert client.dispatcher.counters.missing == 3


async def test_closing_sends_delayed_responses() -> None:
    client = Client()
    client.send(MISSING)
    client.send(FOUND)
    await client.dispatcher.close()
    assert client.answered == [("a", 2), ("a", 1)]
    ended = asyncio.get_running_loop().create_future()
    asyncio.get_running_loop().call_later(2 * DELAY_SECONDS, ended.set_result, None)
    await ended
    assert len(client.answered) == 2


@pytest.mark.slow
@pytest.mark.lcm
@pytest.mark.parametrize("transport", ["udp", "tcpq"])
async def test_directors_client_loses_no_commands(url: str, transport: str) -> None:
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
