"""Interpolation along lines, against float64: the colour of the points that pixels see."""

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.color import srgb_values_from_linear
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.interface import Look, LookName, Output
from renderers.raster import CpuRenderer

CAMERA = Camera(61, 47, 40.0, 44.0, 30.2, 23.6, 0.05, 100.0, np.eye(4))


def share_of_the_end(p: np.ndarray, q: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Return where along p -> q (0 .. 1) rays pass, measured along the line's image.

    Args:
        ray: (n, 2), directions of the pixels with z = 1.
    """
    image_p, image_q = p[:2] / p[2], q[:2] / q[2]
    along = image_q - image_p
    share = np.clip((ray - image_p) @ along / (along @ along), 0.0, 1.0)
    # 1/z is linear along the image of the line.
    found: np.ndarray = share / q[2] / ((1.0 - share) / p[2] + share / q[2])
    return found


@pytest.mark.parametrize("look", ["plain", "gltf", "studio"])
@pytest.mark.parametrize("seed", range(4))
def test_colors_along_lines(seed: int, look: LookName) -> None:
    rng = np.random.default_rng(seed)
    ends = rng.uniform((-1.5, -1.2, 1.0), (1.5, 1.2, 6.0), (8, 2, 3)).astype(np.float32)
    colors = np.tile(np.array(((1, 0, 0, 1), (0, 1, 0, 1)), np.float32), (8, 1))
    lines = [
        Mesh(ends[k], np.array(((0, 1),), np.uint32), colors=np.ascontiguousarray(colors[2 * k : 2 * k + 2]))
        for k in range(8)
    ]
    scene = DrawList(tuple(Instance(line, Material(), np.eye(4), k) for k, line in enumerate(lines)))
    renderer = CpuRenderer(threads=1)
    frame = renderer.render(scene, CAMERA, Output.COLOR | Output.LABEL, Look(look))
    color, label = frame.color.astype(np.float64), frame.label.copy()
    shown = np.unique(label[label < 8])
    assert len(shown) >= 5
    for k in shown:
        rows, columns = np.nonzero(label == k)
        ray = np.stack(((columns + 0.5 - CAMERA.cx) / CAMERA.fx, (rows + 0.5 - CAMERA.cy) / CAMERA.fy), -1)
        t = share_of_the_end(ends[k, 0].astype(np.float64), ends[k, 1].astype(np.float64), ray)
        linear = np.stack((1.0 - t, t, np.zeros_like(t)), -1)
        expected = {"plain": linear, "gltf": linear ** (1 / 2.2), "studio": srgb_values_from_linear(linear)}[look]
        assert np.abs(color[rows, columns] - 255.0 * expected).max() <= 1.0
