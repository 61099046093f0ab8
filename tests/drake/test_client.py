"""Drake's real client against a running gateway: pictures equal RenderEngineVtk's, refusals are read by people."""

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.gateway_process import gateway_process
from tests.support.waiting import SECONDS

ENVIRONMENT = "SCENEGATE_DRAKE_PYTHON"
ALLOWED = 0.02
"""Fraction of values beyond the limits of Drake's own integration test (20/255, 1 mm, equal labels), where that test
allows 0.2."""

pytestmark = [pytest.mark.drake, pytest.mark.slow]


@pytest.fixture(scope="module")
def python() -> str:
    found = os.environ.get(ENVIRONMENT)
    if not found:
        pytest.skip(f"{ENVIRONMENT} does not name an interpreter with pydrake")
    return found


@pytest.fixture(scope="module")
def url(python: str) -> Iterator[str]:
    with gateway_process("--only", "render") as (_, url):
        yield url


def start(python: str, *arguments: str) -> subprocess.Popen[str]:
    command = [python, "-m", "tests.drake.client", *arguments]
    root = Path(__file__).parents[2]
    return subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def printed(client: subprocess.Popen[str]) -> Any:
    out, err = client.communicate(timeout=SECONDS)
    assert client.returncode == 0, err
    return json.loads(out.splitlines()[-1])


@pytest.fixture(scope="module")
def results(python: str, url: str) -> dict[str, Any]:
    """Two cameras in both looks, and the refusal of a scene that Drake sends without camera."""
    found: dict[str, Any] = printed(start(python, url))
    return found


@pytest.mark.parametrize("view", ["phong/front", "phong/offcentre", "pbr/front", "pbr/offcentre"])
def test_pictures_equal_those_of_render_engine_vtk(results: dict[str, Any], view: str) -> None:
    compared = results["comparisons"][view]
    assert compared["covered"] > 0.5, "the camera looks past the scene"
    assert max(compared[kind] for kind in ("color", "depth", "label")) < ALLOWED, compared


def test_two_cameras_at_once(python: str, url: str) -> None:
    """Two clients whose requests meet get the pictures that each gets alone."""
    alone = [printed(start(python, url, camera)) for camera in ("front", "offcentre")]
    together = [printed(client) for client in [start(python, url, camera) for camera in ("front", "offcentre")]]
    assert together == alone
    assert [len(set(digests)) for digests in together] == [1, 1]
    assert alone[0] != alone[1]


def test_a_bad_request_is_explained_in_drakes_exception(results: dict[str, Any]) -> None:
    assert "HTTP Code:       400" in results["error"]
    assert "no camera" in results["error"]
    assert "perception role" in results["error"]


def test_a_picture_that_takes_too_long_is_explained_in_drakes_exception(python: str) -> None:
    with gateway_process("--only", "render", "--render-seconds", "0.5") as (_, url):
        error = printed(start(python, url, "slow"))
    assert "HTTP Code:       503" in error
    assert "rendering was stopped: it took longer than --render-seconds = 0.5 s" in error
