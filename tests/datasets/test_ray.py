"""Datasets on a Ray cluster of two nodes: complete and the same to the last byte, although a worker is killed."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import msgspec
import pytest

from tests.datasets.conftest import FACET, SETTINGS, TREE, Draw, contents, job_of
from tests.datasets.ray_nodes import ENVIRONMENT as RAY_ENVIRONMENT
from tests.support.ports import free_ports
from tests.support.waiting import SECONDS

ENVIRONMENT = "SCENEGATE_RAY_PYTHON"
ROOT = Path(__file__).parents[2]
pytestmark = [pytest.mark.ray, pytest.mark.slow]
ORBIT = 35
"""Cameras of each of the three scenes: 105 pictures of each type."""


@pytest.fixture(scope="module")
def python() -> str:
    """An interpreter with Ray: that of the variable, or this one."""
    named = os.environ.get(ENVIRONMENT)
    if named is None and find_spec("ray") is None:
        pytest.skip(f"{ENVIRONMENT} names no interpreter with Ray, and there is none here")
    return named or sys.executable


def environment() -> dict[str, str]:
    return {**os.environ, **RAY_ENVIRONMENT, "PYTHONPATH": str(ROOT)}


def speaks(process: subprocess.Popen[str], begin: str, errors: Path) -> str:
    """The first line that a process prints that begins so."""
    assert process.stdout is not None
    line = next((line.strip() for line in process.stdout if line.startswith(begin)), "")
    assert line, errors.read_text()[-4000:]
    return line


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Scenes, and the dataset that the cluster makes of them."""
    base = tmp_path_factory.mktemp("ray")
    scenes = base / "scenes"
    scenes.mkdir()
    (scenes / "mesh.stl").write_text(f"solid t\n{FACET}endsolid t\n")
    for number in range(2):
        arm = {"path": ["arm"], "geometry": {"type": "box", "lengths": [0.1, 0.2 + number, 0.8]}}
        tree = {**TREE, "setgeometry": [*TREE["setgeometry"], arm]}
        (scenes / f"robot{number}.tree.json").write_text(json.dumps(tree))
    return scenes, base / "out"


@pytest.fixture(scope="module")
def cluster(python: str, folders: tuple[Path, Path]) -> Iterator[dict[str, Any]]:
    """Two nodes that have made the dataset while a worker was killed, and are still there."""
    scenes, out = folders
    errors = out.with_name("errors.txt")
    settings = msgspec.json.encode(SETTINGS).decode()
    command = [python, "-m", "tests.datasets.ray_nodes", str(scenes), str(out), str(ORBIT), settings]
    with errors.open("w") as file:
        process = subprocess.Popen(
            command, cwd=ROOT, env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=file, text=True
        )
    try:
        yield json.loads(speaks(process, "{", errors))
        process.communicate("", timeout=SECONDS)
    finally:
        process.kill()
        process.communicate()


def test_a_killed_worker_is_not_to_be_seen(
    cluster: dict[str, Any], folders: tuple[Path, Path], tmp_path: Path, draw: Draw
) -> None:
    scenes, out = folders
    said = {name: cluster[name] for name in ("drawn", "failures", "killed", "nodes")}
    assert said == {"drawn": 3 * ORBIT, "failures": [], "killed": 1, "nodes": 2}
    draw(job_of(scenes, tmp_path / "one", orbit=ORBIT))
    assert contents(out) == contents(tmp_path / "one")


def test_the_command_goes_on_on_a_cluster(
    python: str, cluster: dict[str, Any], folders: tuple[Path, Path], tmp_path: Path
) -> None:
    scenes, out = folders[0], tmp_path / "out"
    arguments = [str(scenes), "-o", str(out), "--orbit", "3", "--width", "32", "--height", "24"]
    command = [python, "-m", "scenegate", "render", *arguments, "--ray", cluster["address"]]

    def drawn() -> str:
        done = subprocess.run(
            command, cwd=ROOT, env=environment(), capture_output=True, text=True, timeout=SECONDS, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stderr

    assert "9 of 9 samples, 0 of them from before, 9 rendered" in drawn()
    whole = contents(out)
    (out / "scenes" / "mesh.stl" / "orbit-001.color.png").unlink()
    assert "9 of 9 samples, 8 of them from before, 1 rendered" in drawn()
    assert contents(out) == whole


def test_the_example_serves_on_a_cluster(python: str, cluster: dict[str, Any], tmp_path: Path) -> None:
    (port,) = free_ports(1)
    command = [python, str(ROOT / "examples" / "ray_serve.py"), "--address", cluster["address"], "--port", str(port)]
    errors = tmp_path / "errors.txt"
    with errors.open("w") as file:
        server = subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, stderr=file, text=True)
    try:
        url = speaks(server, "http://", errors)
        client = [sys.executable, str(ROOT / "examples" / "render_http.py"), url.removesuffix("/render"), str(tmp_path)]
        asked = subprocess.run(client, capture_output=True, text=True, timeout=SECONDS, check=False)
        assert asked.returncode == 0, asked.stderr
        depth = cv2.imread(str(tmp_path / "depth.tiff"), cv2.IMREAD_UNCHANGED)
        assert depth is not None
        assert depth[120, 160] == pytest.approx(3.0, abs=1e-6)
        server.terminate()
        assert server.wait(SECONDS) == 0
    finally:
        server.kill()
        server.communicate()
