"""``scenegate record --mcap`` with a gateway: scene and camera, and what a killed recorder leaves."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.client.recording.readers import foxglove_scene, mcap_reader, ros2_scene, scanned_messages
from tests.support import clients
from tests.support.gateway_process import gateway_process
from tests.support.waiting import SECONDS, wait_until

pytestmark = pytest.mark.slow
MAGIC = b"\x89MCAP0\r\n"


@pytest.fixture(scope="module")
def gateway() -> Iterator[str]:
    ports = ("--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", "off")
    with gateway_process("--demo", *ports, "--stereo-rate", "max") as (_, url):
        yield url


def grpc_port(url: str) -> int:
    port: int = clients.get(f"{url}/healthz").json()["interfaces"]["stereo"]["port"]
    return port


def command(out: Path, url: str, *options: str) -> list[str]:
    return [sys.executable, "-m", "scenegate", "record", "--mcap", str(out), "--gateway", url, *options]


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
def test_scene_and_camera(gateway: str, tmp_path: Path, profile: str) -> None:
    out = tmp_path / "all.mcap"
    camera = ("--camera", f"127.0.0.1:{grpc_port(gateway)}")
    with subprocess.Popen(
        command(out, gateway, *camera, "--profile", profile), stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            wait_until(lambda: out.exists() and out.stat().st_size > 20_000_000)
        finally:
            process.send_signal(signal.SIGTERM)
        _, text = process.communicate(timeout=SECONDS)
    assert process.returncode == 0, text
    with out.open("rb") as file:
        summary = mcap_reader.make_reader(file).get_summary()
    assert summary is not None
    counts = {
        summary.channels[number].topic: count for number, count in summary.statistics.channel_message_counts.items()
    }
    for topic in ("/tf", "/scene", "/scene/points/demo/scanner", "/stereo/disparity", "/stereo/points2"):
        assert counts[topic], topic
    for name in ("left", "right", "depth"):
        assert counts[f"/stereo/{name}/image_rect"] == counts[f"/stereo/{name}/camera_info"] > 1
    read = foxglove_scene(out) if profile == "foxglove" else ros2_scene(out)
    pose = np.linalg.inv(read.world("stereo_left_optical_frame"))
    assert (pose @ (0, 0, 1, 1))[2] > 0.0  # the scene is in front of the camera


def test_a_killed_recorder_leaves_all_but_the_last_second(gateway: str, tmp_path: Path) -> None:
    out = tmp_path / "killed.mcap"
    with subprocess.Popen(command(out, gateway)) as process:
        try:
            wait_until(lambda: out.exists() and scanned_messages(out) > 50)
        finally:
            process.send_signal(signal.SIGKILL)
    assert not out.read_bytes().endswith(MAGIC)  # it has no end
    assert scanned_messages(out) > 50


def test_a_recording_goes_on_after_a_restart(tmp_path: Path) -> None:
    out, options = tmp_path / "two.mcap", ("--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", "off", "--demo")
    with gateway_process(*options) as (_, url):
        process = subprocess.Popen(command(out, url), stderr=subprocess.PIPE, text=True)
        wait_until(lambda: out.exists() and scanned_messages(out) > 50)
    try:
        before = scanned_messages(out)
        with gateway_process(*options, "--port", url.rsplit(":", 1)[1]):
            wait_until(lambda: scanned_messages(out) > before + 50)
            process.send_signal(signal.SIGTERM)
            _, text = process.communicate(timeout=SECONDS)
    finally:
        process.kill()
    assert process.returncode == 0, text
    assert text.count("the recording goes on when it is back") == 1
