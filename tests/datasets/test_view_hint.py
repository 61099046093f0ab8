"""Hints about scenes of which a camera sees nothing."""

from pathlib import Path

import numpy as np
import pytest

from gateway.datasets.rendering import view_hint
from gateway.files.robots.scene_files import SceneOptions
from gateway.scene.tree.transforms import look_at
from renderers.camera import Camera
from renderers.primitives import box
from renderers.raster import CpuRenderer
from tests.datasets.conftest import loaded


@pytest.mark.parametrize(
    ("scale", "eye", "far", "hint"),
    [
        (1.0, (3000.0, -2.0, 1.0), np.inf, "the scene spans 1 km; --scale 0.001"),
        (1.0, (3.0, -2.0, 1.0), np.inf, "nothing in view; the scene spans 1 km; --scale 0.001"),
        (0.001, (3.0, -2.0, 1.0), np.inf, ""),
        (0.001, (30.0, -2.0, 1.0), np.inf, "nothing in view; the scene spans 1 m"),
        (1.0, (3000.0, -2000.0, 500.0), np.inf, ""),
        (1.0, (3000.0, -2000.0, 500.0), 10.0, "nothing in view; the scene spans 1 km; --scale 0.001"),
    ],
)
def test_a_scene_in_millimetres(
    renderer: CpuRenderer, tmp_path: Path, scale: float, eye: tuple[float, float, float], far: float, hint: str
) -> None:
    mesh = box()
    corners = mesh.positions * np.float32(1000.0) + np.array((3000, 0, 0), np.float32)
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.elements]
    (tmp_path / "mm.obj").write_text("\n".join(lines))
    scene = loaded(tmp_path / "mm.obj", SceneOptions(scale=scale))
    X_world_camera = look_at(eye, (eye[0], 0.0, 0.0), (0.0, 0.0, 1.0))
    camera = Camera(80, 60, 70.0, 70.0, 40.0, 30.0, 0.01, far, X_world_camera)
    found = view_hint(renderer, scene, camera) or ""
    assert (hint in found, bool(found), "--scale" in found) == (True, bool(hint), "--scale" in hint)
