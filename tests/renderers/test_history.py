"""Earlier frames do not change the image, although working memory is reused without clearing."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Image, Instance, Material, Mesh, Texture
from renderers.interface import Look, LookName, Output
from renderers.raster import CpuRenderer
from tests.renderers.scenes import pose, sphere
from tests.renderers.shading.test_pixels import random_scene

SIZES = ((203, 151), (97, 71), (320, 40))


def _painted_ball(columns: int, rows: int) -> Mesh:
    """A sphere with a texture seam, across which neighbouring pixels read opposite borders of the texture."""
    ball = sphere(columns, rows)
    u, v = np.meshgrid(np.linspace(0, 2, columns + 1), np.linspace(0, 1, rows + 1))
    return replace(ball, uv0=np.stack((u, v), axis=-1).reshape(-1, 2).astype(np.float32))


def _scenes() -> tuple[DrawList, ...]:
    rng = np.random.default_rng(5)
    noise = rng.integers(0, 256, (64, 64, 4), dtype=np.uint8)
    noise[..., 3] = 255
    painted = Material(base_color_texture=Texture(Image(b"noise", lambda: noise)))
    glass = Material((0.3, 0.6, 0.9, 0.5), alpha_mode=AlphaMode.BLEND)
    balls = [Instance(_painted_ball(50, 40), painted, pose(rng, z=3.0, scale=0.9), k, k) for k in range(4)]
    return (
        DrawList(tuple(balls)),
        random_scene(np.random.default_rng(7)),
        DrawList((*balls[:2], Instance(sphere(24, 12), glass, pose(rng, z=2.5), 9, 9))),
    )


def _color(renderer: CpuRenderer, drawn: DrawList, size: tuple[int, int], look: Look) -> NDArray[np.uint8]:
    width, height = size
    camera = Camera(width, height, 0.9 * width, 0.9 * width, width / 2 + 0.3, height / 2, 0.05, 50.0, np.eye(4))
    frame = renderer.render(drawn, camera, Output.COLOR | Output.DEPTH, look)
    return frame.color.copy()


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("name", ["phong", "plain", "pbr", "studio"])
def test_earlier_frames_do_not_change_the_image(name: LookName, samples: int) -> None:
    look = Look(name, samples=4 if samples == 4 else 1)
    kinds = [(drawn, size) for drawn in _scenes() for size in SIZES]
    one, three = CpuRenderer(1), CpuRenderer(3)
    expected = [_color(one, *kind, look) for kind in kinds]
    order = np.random.default_rng(3)
    for which in np.concatenate([order.permutation(len(kinds)) for _ in range(3)]).tolist():
        drawn, size = kinds[which]
        for renderer in (one, three):
            np.testing.assert_array_equal(_color(renderer, drawn, size, look), expected[which])
    one.close()
    three.close()
