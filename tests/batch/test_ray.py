"""Datasets on a Ray cluster of two nodes: complete and the same to the last byte, although a worker is killed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import cv2
import pytest

from tests.batch.conftest import FACET, TREE, Draw, contents, order_of
from tests.support.gateway_process import START_SECONDS, STOP_SECONDS
from tests.support.ports import free_ports

ENVIRONMENT = "SCENEGATE_RAY_PYTHON"
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def python() -> str:
    """An interpreter with Ray: that of the variable, or this one."""
    named = os.environ.get(ENVIRONMENT)
    if named is None and find_spec("ray") is None:
        pytest.skip(f"{ENVIRONMENT} names no interpreter with Ray, and there is none here")
    return named or sys.executable


def environment() -> dict[str, str]:
    # Ray's own report of usage would go out into the world.
    return {**os.environ, "RAY_USAGE_STATS_ENABLED": "0", "RAY_DEDUP_LOGS": "0", "PYTHONPATH": str(ROOT)}


@pytest.mark.ray
def test_a_killed_worker_is_not_to_be_seen(python: str, tmp_path: Path, draw: Draw) -> None:
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    (scenes / "mesh.stl").write_text(f"solid t\n{FACET}endsolid t\n")
    for number in range(2):
        arm = {"path": ["arm"], "geometry": {"type": "box", "lengths": [0.1, 0.2 + number, 0.8]}}
        tree = {**TREE, "setgeometry": [*TREE["setgeometry"], arm]}
        (scenes / f"robot{number}.tree.json").write_text(json.dumps(tree))
    command = [python, "-m", "tests.batch.ray_cluster", str(scenes), str(tmp_path / "ray"), "70"]
    done = subprocess.run(
        command, cwd=ROOT, env=environment(), capture_output=True, text=True, timeout=2 * START_SECONDS, check=False
    )
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    assert said.pop("s") > 0
    assert said == {"drawn": 210, "failures": [], "killed": 1, "nodes": 2}
    draw(order_of(scenes, tmp_path / "one", orbit=70))
    assert contents(tmp_path / "ray") == contents(tmp_path / "one")


@pytest.mark.ray
def test_the_example_serves_on_ray(python: str, tmp_path: Path) -> None:
    (port,) = free_ports(1)
    command = [python, str(ROOT / "examples" / "ray_serve.py"), "--port", str(port), "--most", "2"]
    with (tmp_path / "errors.txt").open("w") as errors:
        server = subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, stderr=errors, text=True)
    try:
        assert server.stdout is not None
        url = next((line.strip() for line in server.stdout if line.startswith("http://")), "")
        assert url == f"http://127.0.0.1:{port}/render", (tmp_path / "errors.txt").read_text()[-4000:]
        example = [
            sys.executable,
            str(ROOT / "examples" / "render_http.py"),
            url.removesuffix("/render"),
            str(tmp_path),
        ]
        drawn = subprocess.run(example, capture_output=True, text=True, timeout=START_SECONDS, check=False)
        assert drawn.returncode == 0, drawn.stderr
        depth = cv2.imread(str(tmp_path / "depth.tiff"), cv2.IMREAD_UNCHANGED)
        assert depth is not None
        assert depth[120, 160] == pytest.approx(3.0, abs=1e-6)
        server.terminate()
        assert server.wait(STOP_SECONDS) == 0
    finally:
        server.kill()
        server.communicate()


def test_without_ray_it_is_said_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from gateway.batch.raytasks import RayError, run_ray

    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(RayError, match=r"pip install 'scenegate\[ray\]'"):
        next(run_ray([], "auto"))
