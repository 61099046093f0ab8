"""Director's own client and tests, from the checkout ``SCENEGATE_DIRECTOR`` (docs/tree-viewer-compatibility.md)."""

import asyncio
import os
from pathlib import Path
from typing import Any

import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.runtime.lcm.config import LcmConfig
from gateway.scene.tree.live import LiveTree
from tests.adapters.treeviewer import director_checkout
from tests.adapters.treeviewer.transports import free_url, join, serving
from tests.support.waiting import until

pytestmark = [pytest.mark.slow, pytest.mark.lcm]

RESTART = """
import sys, time
from director.viewerclient import Visualizer, Box
viewer = Visualizer("robot")
viewer.start_handler()
viewer["link"].setgeometry(Box([1, 2, 3]))
print("shown", flush=True)
sys.stdin.readline()  # the viewer has been restarted
import numpy as np
while True:  # the client sends its scene again with the first publish after a response with missing paths
    viewer["link"].settransform(np.eye(4))
    time.sleep(0.02)
"""


@pytest.fixture
def checkout() -> Path:
    value = os.environ.get("SCENEGATE_DIRECTOR")
    if not value:
        pytest.skip("SCENEGATE_DIRECTOR does not name a checkout of Director")
    return Path(value)


@pytest.mark.parametrize("transport", ["udp", "tcpq"])
async def test_directors_tests_pass(checkout: Path, transport: str) -> None:
    network = free_url()
    join(network)
    async with serving(TreeViewerConfig(lcm=LcmConfig(url=network, tcpq_port=0))) as service:
        udp = transport == "udp"
        url = network if udp else f"tcpq://127.0.0.1:{service.tcpq_port}"
        for script in director_checkout.scripts(checkout):
            outcome = await asyncio.to_thread(director_checkout.run, checkout, script, url, announce=udp)
            assert outcome.status == 0, outcome.output
            assert "Traceback" not in outcome.output
            assert "unhandled" not in outcome.output
            if "Interface" in outcome.script:
                ready = 0 if udp else 1
                assert outcome.ok_answers == director_checkout.ANSWERS_OF_INTERFACE_TEST + ready
        assert service.status()["failed"] == service.status()["undecodable"] == 0


async def test_directors_client_recovers_from_a_restart(checkout: Path, tmp_path: Path) -> None:
    network = free_url()
    join(network)
    config = TreeViewerConfig(lcm=LcmConfig(url=network, tcpq_port=None))
    script = tmp_path / "restart.py"
    script.write_text(RESTART)
    path = ("robot", "link")
    with director_checkout.prepared(checkout, script, network, announce=False) as (command, environment):
        first, second = LiveTree(), LiveTree()
        async with serving(config, live=first):
            client: Any = await asyncio.create_subprocess_exec(
                *command, env=environment, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
            )
            assert await client.stdout.readline() == b"shown\n"
            await until(lambda: first.snapshot.root.find(path) is not None)
        async with serving(config, live=second):
            client.stdin.write(b"\n")
            await client.stdin.drain()

            def shown() -> bool:
                node = second.snapshot.root.find(path)
                return node is not None and bool(node.parts)

            try:
                await until(shown)
            finally:
                client.kill()
                await client.wait()
