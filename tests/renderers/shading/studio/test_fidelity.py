"""Our images against those of other engines (``bench/fidelity.py``).

SCENEGATE_FIDELITY names a recursive checkout of KhronosGroup/glTF-Render-Fidelity.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bench.fidelity import Scenario, compare, distance, inner, measure, scenarios, silhouette, summaries
from renderers.raster import CpuRenderer

FOLDER = os.environ.get("SCENEGATE_FIDELITY", "")
MODELS = (
    "Avocado",
    "BoomBoxWithAxes",
    "Box",
    "BoxTextured",
    "Cube",
    "Duck",
    "NormalTangentTest",
    "Suzanne",
    "TextureSettingsTest",
    "VertexColorTest",
)
MAX_SILHOUETTE = 0.005


@pytest.fixture(scope="module")
def renderer() -> Iterator[CpuRenderer]:
    renderer = CpuRenderer()
    yield renderer
    renderer.close()


@pytest.mark.parametrize("name", MODELS)
def test_distance_to_other_engines_is_within_their_spread(renderer: CpuRenderer, name: str) -> None:
    if not FOLDER:
        pytest.skip("SCENEGATE_FIDELITY names no checkout of KhronosGroup/glTF-Render-Fidelity")
    known, unavailable = scenarios(Path(FOLDER))
    full = f"khronos-{name}"
    if full in unavailable:
        pytest.skip(f"{name}: {unavailable[full]}")
    lines, _, _ = measure(next(each for each in known if each.name == full), renderer)
    assert len(lines) >= 5
    for line in lines:
        assert line.near, line
        # Some engines leave out or blur what others draw, so that they differ from one another, too.
        assert line.silhouette <= max(MAX_SILHOUETTE, line.others_silhouette[-1]), line
    (summary,) = summaries(lines)
    assert summary.silhouette <= MAX_SILHOUETTE
    assert summary.ours <= summary.others, summary


def square(value: float, shift: int = 0) -> np.ndarray:
    image = np.zeros((40, 40, 4))
    image[10:30, 10 + shift : 30 + shift] = (value, value, value, 255.0)
    return image


def test_distances() -> None:
    a, b = square(100.0), square(110.0, 1)
    assert inner(a, b).sum() == 18 * 17
    mean, decibels = distance(a, b)
    assert mean == pytest.approx(10.0)
    # A grey step of ten has the luminance ten and nothing else: 0.5053 * 100 over the largest distance.
    assert decibels == pytest.approx(10 * np.log10(50.53 / 35215), abs=1e-3)
    assert silhouette(a, b) == pytest.approx(40 / 400)
    lines = compare("x", a, {"one": square(104.0), "two": square(110.0), "three": square(97.0), "none": 0 * a})
    assert [line.engine for line in lines] == ["one", "two", "three"]
    assert [round(line.ours) for line in lines] == [4, 10, 3]
    assert [line.near for line in lines] == [True, True, True]
    assert [line.farther for line in lines] == [2, 1, 2]
    (summary,) = summaries(lines)
    assert summary.ours == pytest.approx(4)
    assert summary.others == pytest.approx(7)
    assert summary.near == 3
    assert not compare("x", square(200.0), {"one": a, "two": b, "three": square(90.0)})[0].near


def test_camera() -> None:
    """theta turns towards +X of the file, which is Y up; phi is counted from its +Y."""
    scenario = Scenario("x", Path(), Path(), 300, 200, (1.0, 2.0, 3.0), 90.0, 60.0, 2.0, 45.0, {})
    camera = scenario.camera
    assert (camera.width, camera.height) == (600, 400)
    assert camera.fy == pytest.approx(200 / np.tan(np.radians(22.5)))
    eye = np.array((1 + 2 * np.sin(np.radians(60)), 2 + 1.0, 3.0))
    np.testing.assert_allclose(camera.X_world_camera[:3, 3], (eye[0], -eye[2], eye[1]))
    target = camera.X_camera_world @ (1.0, -3.0, 2.0, 1.0)
    np.testing.assert_allclose(target[:3], (0.0, 0.0, 2.0), atol=1e-12)
    above = camera.X_camera_world @ (1.0, -3.0, 2.5, 1.0)
    assert above[1] < 0  # up in the world is up in the image
