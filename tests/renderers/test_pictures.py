"""Golden geometry images of one scene with all features."""

import numpy as np
import pytest

from renderers.drawlist import DrawList, Instance, Material
from renderers.interface import Output
from renderers.raster import CpuRenderer
from tests.renderers.golden_images import assert_equal_to_golden
from tests.renderers.scenes import camera, grid, mesh, sphere


def scene() -> DrawList:
    """A floor through the camera, smooth and mirrored balls, a flat one, lines and points in front and behind."""
    floor = grid(1, 1, ((-50, 0.8, -50), (50, 0.8, -50), (50, 0.8, 50), (-50, 0.8, 50)))
    ball = sphere(24, 12, 0.5)
    flat = sphere(8, 5, 0.4, smooth=False)
    rng = np.random.default_rng(1)
    wires = mesh(rng.uniform((-1.5, -1, 1.5), (1.5, 1, 4), size=(16, 3)), np.arange(16).reshape(-1, 2))
    cloud = mesh(rng.uniform((-1.5, -1, 1.5), (1.5, 1, 4), size=(60, 3)), np.arange(60)[:, None])

    def at(x: float, y: float, z: float, *scale: float) -> np.ndarray:
        X = np.diag((*scale, 1.0)) if scale else np.eye(4)
        X[:3, 3] = x, y, z
        return X

    return DrawList(
        (
            Instance(floor, Material(), np.eye(4), 1, 10),
            Instance(ball, Material(), at(-0.7, 0, 3, 1, 1.3, 0.7), 0x0102, 20),
            Instance(ball, Material(), at(0.4, -0.1, 2.5, -1, 1, 1), 0x030201, 30),
            Instance(flat, Material(), at(0.9, 0.5, 2.2), 32763, 40),
            Instance(wires, Material(line_width=2.0), np.eye(4), 5, 50),
            Instance(cloud, Material(point_size=2.0), np.eye(4), 6, 60),
        )
    )


@pytest.mark.parametrize("threads", [1, 3])
def test_geometry(threads: int) -> None:
    renderer = CpuRenderer(threads)
    view = camera(112, 80, near=0.02, far=20.0)
    frame = renderer.render(scene(), view, Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL)
    assert frame.depth is not None
    assert frame.label is not None
    assert frame.instance is not None
    assert frame.normal is not None
    assert_equal_to_golden(
        "geometry", depth=frame.depth, label=frame.label, instance=frame.instance, normal=frame.normal
    )
