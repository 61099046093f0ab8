"""Director's own client and its three tests of the tree viewer, unmodified, against a running viewer.

They come from a clone of github.com/RobotLocomotion/director, which ``SCENEGATE_DIRECTOR`` names; nothing of it is
part of this project. Its files need two things that today's Python lacks: ``collections.Iterable``, and ``sys`` in
tests that forget to import it (Director runs them in an interpreter that has it). The binary ``drake-visualizer`` that
the tests start is a stand-in that waits; they wait for the ready message, which our hub sends to every new subscriber
and the stand-in sends over UDP.

Two races of the tests, which show on a busy machine, are avoided. A test ends a millisecond after its last request,
with responses still outstanding; here it waits for them. liblcm keeps 30 messages for a thread that is not running and
drops the others; here it keeps all.
"""

import asyncio
import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.runtime.lcm.config import LcmConfig
from gateway.scene.tree.live import LiveTree
from tests.adapters.treeviewer.transports import free_url, join, serving
from tests.support.waiting import SECONDS, until

pytestmark = [pytest.mark.slow, pytest.mark.lcm]

ROOT = Path(__file__).parents[3]
SCRIPTS = (
    "tests/testTreeViewerClient.py",
    "tests/testTreeViewerInterface.py",
    "tests/testTreeViewerPolyLine.py",
    "director/viewerclient.py",
)
OK_RESPONSES = 2000
"""Of the test of the interface."""

_SHIM = """
import builtins, collections, collections.abc, runpy, sys, time
import lcm
class Roomy(lcm.LCM):
    def subscribe(self, *values):
        subscription = super().subscribe(*values)
        subscription.set_queue_capacity(0)
        return subscription
lcm.LCM = Roomy
collections.Iterable = collections.abc.Iterable
sys.executable = {executable!r}
heard = []
def note(*values, **options):
    builtins.print(*values, **options)
    heard.extend(value for value in values if value == "ok")
runpy.run_path({test!r}, init_globals={{"sys": sys, "print": note}}, run_name="__main__")
end = time.monotonic() + {seconds}
while len(heard) < {answers} and time.monotonic() < end:
    time.sleep(0.01)
"""
_VISUALIZER = """#!{python}
import os, time
import lcm
from gateway.adapters.treeviewer import responses
if {announce}:
    lcm.LCM().publish("DIRECTOR_TREE_VIEWER_RESPONSE", responses.encode(responses.ReadyMessage()))
time.sleep({seconds})  # until the tests end it
"""


@contextlib.contextmanager
def prepared(checkout: Path, script: Path, url: str, *, announce: bool) -> Iterator[tuple[list[str], dict[str, str]]]:
    """Yield the command and the environment that run one script with Director's packages, our type and the shims."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        generator = Path(sys.executable).with_name("lcm-gen")
        types = ROOT / "lcmtypes" / "viewer2_comms_t.lcm"
        subprocess.run([generator, "-p", "--ppath", folder, types], check=True, capture_output=True)
        visualizer = folder / "drake-visualizer"
        visualizer.write_text(_VISUALIZER.format(python=sys.executable, announce=announce, seconds=2 * SECONDS))
        visualizer.chmod(0o755)
        answers = OK_RESPONSES + (not announce) if "Interface" in script.name else 0
        shim = _SHIM.format(executable=str(folder / "python"), test=str(script), answers=answers, seconds=SECONDS)
        path = os.pathsep.join(map(str, (folder, checkout / "src" / "python", ROOT)))
        environment = {**os.environ, "PYTHONPATH": path, "LCM_DEFAULT_URL": url, "PYTHONUNBUFFERED": "1"}
        yield [sys.executable, "-c", shim], environment


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
        for name in SCRIPTS:
            script = checkout / "src" / "python" / name
            with prepared(checkout, script, url, announce=udp) as (command, environment):
                process = await asyncio.create_subprocess_exec(
                    *command, env=environment, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
                )
                output = (await process.communicate())[0].decode()
            assert process.returncode == 0, output
            assert "Traceback" not in output
            assert "unhandled" not in output
            if "Interface" in name:
                assert output.split().count("ok") == OK_RESPONSES + (not udp)
        assert service.status()["failed"] == service.status()["undecodable"] == 0


async def test_directors_client_recovers_from_a_restart(checkout: Path, tmp_path: Path) -> None:
    network = free_url()
    join(network)
    config = TreeViewerConfig(lcm=LcmConfig(url=network, tcpq_port=None))
    script = tmp_path / "restart.py"
    script.write_text(RESTART)
    path = ("robot", "link")
    with prepared(checkout, script, network, announce=False) as (command, environment):
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
