"""Responses with status 1 are delayed for the race in Director's Python client (see ``director_client``)."""

import asyncio
import json
import sys

import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.delivery import DELAY_SECONDS
from gateway.runtime.lcm.config import LcmConfig
from tests.adapters.treeviewer.transports import serving
from tests.support.waiting import SECONDS

ROUNDS = 400
PAUSE = 0.002
"""Seconds between publishing and clearing: longer than a response takes, shorter than the delay."""


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
