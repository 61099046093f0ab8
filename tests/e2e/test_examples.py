"""The examples run unchanged against a gateway with the demo scene."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gateway.adapters.viewer.routes import ACKNOWLEDGE, ACKNOWLEDGE_CONTROLS
from tests.support import clients
from tests.support.gateway_process import gateway_process
from tests.support.liblcm import liblcm
from tests.support.ports import free_ports
from tests.support.view_frames import parse_frame
from tests.support.waiting import SECONDS, wait_until

EXAMPLES = Path(__file__).parents[2] / "examples"
MAX_LINES = 80


@pytest.fixture(scope="module")
def gateway() -> Iterator[dict[str, str]]:
    grpc_port, tcpq_port = free_ports(2)
    flags = ("--demo", "--grpc-port", str(grpc_port), "--tcpq-port", str(tcpq_port), "--lcm-url", "memq://")
    with gateway_process(*flags) as (_, url):
        yield {"http": url, "grpc": f"127.0.0.1:{grpc_port}", "tcpq": f"tcpq://127.0.0.1:{tcpq_port}"}


def run(name: str, *arguments: str | Path) -> str:
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_examples_are_short_and_all_here() -> None:
    here = {"animate_robot", "control_panel", "publish_tree", "render_http", "stream_stereo"}
    of_datasets = {"ray_serve", "read_dataset"}  # tests/datasets has them
    longer = {"train_detector"}  # has a network and its training
    lines = {path.stem: len(path.read_text().splitlines()) for path in EXAMPLES.glob("*.py")}
    assert lines.keys() == here | of_datasets | longer
    assert {name for name, count in lines.items() if count > MAX_LINES} <= longer


def test_render_http(gateway: dict[str, str], tmp_path: Path) -> None:
    run("render_http.py", gateway["http"], tmp_path)
    depth = cv2.imread(str(tmp_path / "depth.tiff"), cv2.IMREAD_UNCHANGED)
    label = cv2.imread(str(tmp_path / "label.png"))
    assert depth is not None
    assert label is not None
    assert depth[120, 160] == pytest.approx(3.0, abs=1e-6)
    assert np.isinf(depth[0, 0])
    assert (label[120, 160] == (0, 128, 255)).all()  # BGR of the material's colour
    assert (label[0, 0] == 255).all()


@pytest.mark.lcm
def test_publish_tree(gateway: dict[str, str], tmp_path: Path) -> None:
    liblcm()
    out = run("publish_tree.py", gateway["tcpq"], gateway["http"], tmp_path / "robot.png")
    assert "robot.png" in out
    image: Any = cv2.imread(str(tmp_path / "robot.png"))
    assert image.shape == (480, 640, 3)
    blue, green, red = (image[..., i].astype(int) for i in range(3))
    assert ((red > 150) & (green > 80) & (blue < 80)).sum() > 500, "the orange arm is not visible"


@pytest.mark.lcm
def test_animate_robot(gateway: dict[str, str]) -> None:
    liblcm()
    command = [sys.executable, str(EXAMPLES / "animate_robot.py"), gateway["tcpq"]]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as publisher:
        try:
            first = rover(gateway["http"], lambda head: True)
            rover(gateway["http"], lambda head: head["transform"] != first["transform"])
        finally:
            publisher.terminate()


def test_control_panel(gateway: dict[str, str]) -> None:
    """A page changes a value, and stops the program."""
    command = [sys.executable, str(EXAMPLES / "control_panel.py"), gateway["tcpq"]]
    page = clients.websocket(gateway["http"].replace("http", "ws") + "/view/ws", max_size=None)
    with page, subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as program:
        ids: dict[str, int] = {}
        while not {"Length", "Stop", "Angle", "Mount"} <= ids.keys():
            controls = next_frame(page, "controls")["controls"] or ()
            ids = {each["path"][-1]: each["id"] for each in controls}
        page.send(json.dumps({"control": ids["Length"], "number": 1, "value": 0.5}))
        while not next_frame(page, "controls")["samples"]:
            pass
        page.send(json.dumps({"control": ids["Stop"], "number": 2}))
        _, errors = program.communicate(timeout=SECONDS)
        assert (program.returncode, errors) == (0, "")
        while next_frame(page, "controls")["controls"] != []:
            pass


def next_frame(page: Any, kind: str) -> dict[str, Any]:
    """Return the header of the next frame of a kind. Updates are acknowledged."""
    while True:
        header, _ = parse_frame(page.recv())
        if header["kind"] == "update":
            page.send(ACKNOWLEDGE)
        if header["kind"] == "controls":
            page.send(ACKNOWLEDGE_CONTROLS)
        if header["kind"] == kind:
            return header


def rover(url: str, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    def found() -> dict[str, Any] | None:
        nodes = {tuple(node["path"]): node for node in clients.get(f"{url}/scene").json()["nodes"]}
        head = nodes.get(("rover", "head"))
        return head if head is not None and wanted(head) else None

    head: Any = wait_until(found)
    return head


def test_stream_stereo(gateway: dict[str, str], tmp_path: Path) -> None:
    out = run("stream_stereo.py", gateway["grpc"], tmp_path / "points.npy")
    assert "1280x960 left image" in out
    points = np.load(tmp_path / "points.npy")
    assert points.shape[1] == 3
    assert len(points) > 10_000
    assert np.isfinite(points).all()
