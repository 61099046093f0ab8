"""Images on planes as the rasterizer shows them."""

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.scene.draw.fonts import LINE_PIXELS, MAX_SIDE, font_for, text_image
from gateway.scene.draw.image_meshes import rectangle
from gateway.scene.tree.materials import textured
from gateway.scene.tree.transforms import look_at
from renderers.camera import Camera
from renderers.drawlist import DrawList, Image, Instance
from renderers.interface import Look, Output
from renderers.raster.renderer import CpuRenderer

RED, GREEN, BLUE, WHITE = [255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]
PIXELS = np.array([[[*RED, 255], [*GREEN, 255]], [[*BLUE, 255], [*WHITE, 255]]], np.uint8)
"""Top left red, top right green, bottom left blue, bottom right white."""


def seen_from(eye: tuple[float, float, float]) -> NDArray[np.uint8]:
    """Return what a camera with +y up sees of ``PIXELS`` on a rectangle of 2 m x 2 m."""
    image = Image(b"test", lambda: PIXELS)
    material = textured((1.0, 1.0, 1.0, 1.0), image, has_alpha=False, repeats=False, unlit=True)
    X_world_camera = look_at(eye, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    camera = Camera(40, 40, 40.0, 40.0, 20.0, 20.0, 0.1, 10.0, X_world_camera)
    scene = DrawList((Instance(rectangle(2.0, 2.0), material, np.eye(4)),), (image,))
    frame = CpuRenderer().render(scene, camera, Output.COLOR, Look("plain"))
    return frame.color.copy()


def test_a_rectangle_shows_its_image_upright_to_plus_z() -> None:
    color = seen_from((0.0, 0.0, 2.5))
    assert [color[8, 8].tolist(), color[8, 31].tolist()] == [RED, GREEN]
    assert [color[31, 8].tolist(), color[31, 31].tolist()] == [BLUE, WHITE]


def test_the_back_of_a_rectangle_shows_its_image_mirrored() -> None:
    color = seen_from((0.0, 0.0, -2.5))
    assert [color[8, 8].tolist(), color[8, 31].tolist()] == [GREEN, RED]


@pytest.mark.parametrize(("text", "lines"), [("a", 1), ("a\nb", 2), ("x" * 1000, 1), ("x\n" * 500, 500)])
def test_images_of_text_are_bounded(text: str, lines: int) -> None:
    pixels, height_in_lines = text_image(text, font_for(text), (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0))
    assert max(pixels.shape[:2]) <= MAX_SIDE
    assert height_in_lines == pytest.approx(lines + 0.3, abs=0.2)
    assert pixels[:, :, :3].reshape(-1, 3).tolist() == [RED] * (pixels.shape[0] * pixels.shape[1])
    assert pixels[:, :, 3].max() > 128
    assert lines > 2 or len(text) > 9 or pixels.shape[0] >= lines * LINE_PIXELS


def test_the_alpha_of_the_colour_fades_the_letters() -> None:
    pixels, _ = text_image("M", font_for("M"), (1.0, 0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 0.0))
    assert pixels[:, :, 3].max() in (127, 128)
