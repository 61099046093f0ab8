"""LCM's own tools with our logs, and ours with theirs: lcm-logger, lcm-logplayer, lcm-logfilter, and lcm-spy's reader.

They come with the wheel of lcm (or Debian's liblcm-bin); lcm-spy is Java, from the same wheel.
"""

import asyncio
import contextlib
import io
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from gateway.scene.tree.live import LiveTree
from scenegate.lcm.event_log import read_events
from tests.adapters.treeviewer.transports import HubClient, serving
from tests.runtime.lcm.test_replay import EVENTS, written
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS, until

pytestmark = pytest.mark.lcm
ROOT = Path(__file__).parents[3]
SENT = [(event.channel, event.data) for event in EVENTS]
SPY = """
import lcm.logging.Log;
import robotlocomotion.viewer2_comms_t;

/** What lcm-spy does with a message: the type whose fingerprint it carries decodes it. */
public class Spied {
    public static void main(String[] arguments) throws Exception {
        Log log = new Log(arguments[0], "r");
        while (true) {
            Log.Event event;
            try {
                event = log.readNext();
            } catch (java.io.EOFException end) {
                return;
            }
            String seen = event.eventNumber + " " + event.channel + " " + event.data.length;
            if (event.channel.startsWith("DIRECTOR")) {
                viewer2_comms_t message = new viewer2_comms_t(event.data);
                seen += " " + message.format + " " + message.num_bytes + " " + new String(message.data);
            }
            System.out.println(seen);
        }
    }
}
"""


def tool(name: str) -> str:
    """Return the path of one of LCM's tools; skip the test if it does not start."""
    beside = Path(sys.executable).with_name(name)
    place = str(beside) if beside.exists() else shutil.which(name)
    if place is None:
        pytest.skip(f"{name} is not installed (it is in the wheel of lcm and in Debian's liblcm-bin)")
    said = subprocess.run([place, "-h"], capture_output=True, text=True, check=False)
    if "usage" not in (said.stdout + said.stderr).lower():
        pytest.skip(f"{name} does not start: {(said.stderr or said.stdout).strip()[-200:]}")
    return place


async def output_of(*command: str | Path) -> str:
    """Return the output of a program that must succeed."""
    done = await asyncio.to_thread(subprocess.run, command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return str(done.stdout)


async def wait_until_ended(process: asyncio.subprocess.Process) -> None:
    async with asyncio.timeout(SECONDS):
        await process.wait()


@contextlib.asynccontextmanager
async def running(*command: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run a program and its children; interrupt them at the end of the block."""
    process = await asyncio.create_subprocess_exec(
        *command, cwd=ROOT, stderr=asyncio.subprocess.PIPE, start_new_session=True
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            os.killpg(process.pid, signal.SIGINT)
        await wait_until_ended(process)


async def publishing_client(port: int) -> HubClient:
    """Return a client that has published all of EVENTS."""
    client = await HubClient.connect(port)
    for channel, data in SENT:
        await client.publish(channel, data)
    return client


async def record_events(out: Path) -> None:
    """Record a log of EVENTS with ``scenegate record``."""
    async with serving() as service:
        url = f"tcpq://127.0.0.1:{service.tcpq_port}"
        # responses have other channels
        channels = ("--channels", "DIRECTOR_TREE_VIEWER_REQUEST.*|IMU")
        async with running(sys.executable, "-m", "scenegate", "record", str(out), "--lcm-url", url, *channels) as ours:
            assert await ours.stderr.readline() == b"Recording ...\n"
            client = await publishing_client(service.tcpq_port)
            await until(lambda: out.exists() and out.stat().st_size >= len(written(EVENTS)))
            await client.close()


async def test_a_log_of_lcm_logger_is_played(tmp_path: Path) -> None:
    logger, out, live = tool("lcm-logger"), tmp_path / "theirs.lcmlog", LiveTree()
    async with serving() as service:
        url = f"tcpq://127.0.0.1:{service.tcpq_port}"
        async with running(logger, "-q", "--flush-interval=10", "-l", url, str(out)):
            client = await HubClient.connect(service.tcpq_port)

            async def written_down(data: bytes) -> None:
                """Publish until lcm-logger, which does not report that it listens and writes late, has written."""
                async with asyncio.timeout(SECONDS):
                    while not out.exists() or data not in out.read_bytes():
                        await client.publish("MORE", b"?")
                        await asyncio.sleep(0.01)

            await written_down(b"MORE")
            for channel, data in SENT:
                await client.publish(channel, data)
            await written_down(SENT[-1][1])
            await client.close()
    events = [(event.channel, event.data) for event in read_events(io.BytesIO(out.read_bytes()))]
    assert [entry for entry in events if entry in SENT] == SENT
    async with serving(live=live) as service:
        url = f"tcpq://127.0.0.1:{service.tcpq_port}"
        play = [sys.executable, "-m", "scenegate", "play", str(out), "--lcm-url", url, "--rate", "0"]
        async with running(*play) as ours:
            await wait_until_ended(ours)
            assert ours.returncode == 0
        await until(lambda: set(live.snapshot.root.children) == {"a", "b"})


async def test_lcms_tools_play_and_filter_a_log_of_ours(tmp_path: Path) -> None:
    player, out, live = tool("lcm-logplayer"), tmp_path / "ours.lcmlog", LiveTree()
    await record_events(out)
    async with serving(live=live) as service:
        url = f"tcpq://127.0.0.1:{service.tcpq_port}"
        async with running(player, "-l", url, str(out)) as theirs:
            await wait_until_ended(theirs)
            assert theirs.returncode == 0
        await until(lambda: set(live.snapshot.root.children) == {"a", "b"})
        assert service.status()["received"] == 2
    wanted = tmp_path / "imu.lcmlog"
    await output_of(tool("lcm-logfilter"), "-c", "IMU", out, wanted)
    assert [(event.channel, event.data) for event in read_events(io.BytesIO(wanted.read_bytes()))] == [SENT[1]]


@pytest.mark.slow
async def test_lcm_spy_reads_a_log_of_ours(tmp_path: Path) -> None:
    lcm = liblcm()
    jar = next(Path(lcm.__file__).parents[1].glob("share/java/lcm.jar"), None)
    if jar is None or shutil.which("javac") is None:
        pytest.skip("lcm-spy is Java: javac or the wheel's lcm.jar is missing")
    out = tmp_path / "ours.lcmlog"
    await record_events(out)
    types = ROOT / "lcmtypes" / "viewer2_comms_t.lcm"
    await output_of(tool("lcm-gen"), "-j", "--jpath", tmp_path, types)
    (tmp_path / "Spied.java").write_text(SPY)
    place = f"{jar}:{tmp_path}"
    sources = [tmp_path / "Spied.java", tmp_path / "robotlocomotion" / "viewer2_comms_t.java"]
    await output_of("javac", "-cp", place, "-d", tmp_path, *sources)
    lines = (await output_of("java", "-cp", place, "Spied", out)).splitlines()
    assert len(lines) == len(EVENTS)
    for number, (line, (channel, data)) in enumerate(zip(lines, SENT, strict=True)):
        assert line.startswith(f"{number} {channel} {len(data)}")
        if channel != "IMU":
            body = data[data.index(b'{"') :].decode()
            assert line.endswith(f" treeviewer_json {len(body)} {body}")
