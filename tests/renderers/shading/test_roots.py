"""The colour image as roots of light, in finer steps than bytes, and lights at the limits of numbers."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.drawlist import DrawList, Light, LightKind, Material
from renderers.interface import Look, LookName, Output
from renderers.light_rig import STUDIO, CameraLight
from renderers.raster import CpuRenderer
from renderers.shading.gamma import GAMMA
from renderers.stereo.sensor.camera_image import ROOT_STEPS
from tests.renderers.shading.reference import ball, placed, quad
from tests.renderers.shading.test_layers import VIEW, crossing, noise

RENDERER = CpuRenderer(2)
TEXTURED = Material(base_color_texture=noise(), metallic=0.0, double_sided=True)
CAMERA_LIGHT = CameraLight((0.0, 0.0, 0.0), 0.5, 0.5, 0.5)
SCENES = {
    "opaque": DrawList((placed(ball(6), TEXTURED, z=3.0),)),
    "unlit": DrawList((placed(quad(3.0, 5.0), Material((0.3, 0.6, 0.9, 1.0), unlit=True)),)),
    "translucent": DrawList(crossing()),
}


def light_of(roots: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Return the linear light of an image of roots, (H, W, 3)."""
    shifts, masks = np.array((0, 11, 22), np.uint32), np.array((2047, 2047, 1023), np.uint32)
    return np.asarray(((roots[:, : VIEW.width, None] >> shifts & masks) / ROOT_STEPS) ** 2)


@pytest.mark.parametrize("look", ["phong", "plain", "pbr", "gltf"])
@pytest.mark.parametrize("name", SCENES)
def test_roots_are_the_colour_image(name: str, look: LookName) -> None:
    roots = RENDERER.render(SCENES[name], VIEW, Output.ROOTS | Output.DEPTH, Look(look)).roots
    frame = RENDERER.render(SCENES[name], VIEW, Output.COLOR, Look(look))
    assert roots is not None
    assert np.abs(255.0 * light_of(roots) ** (1.0 / GAMMA) - frame.color).max() <= 1.0


def test_roots_have_finer_steps() -> None:
    """Of bytes, a dark surface that turns away slowly shows steps as soon as the exposure is long."""
    dark = placed(ball(40), Material((0.02, 0.02, 0.02, 1.0), metallic=0.0), z=3.0)
    frame = RENDERER.render(DrawList((dark,)), VIEW, Output.COLOR, Look("gltf", (0, 0, 0)))
    roots = RENDERER.render(DrawList((dark,)), VIEW, Output.ROOTS, Look("gltf", (0, 0, 0))).roots
    assert roots is not None
    assert len(np.unique(light_of(roots)[:, :, 1])) > 2 * len(np.unique(frame.color[:, :, 1]))


@pytest.mark.parametrize("look", [Look("studio"), Look("gltf", samples=4)])
def test_roots_have_one_sample_and_no_tone_mapping(look: Look) -> None:
    with pytest.raises(ValueError, match="roots"):
        RENDERER.render(SCENES["opaque"], VIEW, Output.ROOTS, look)


def test_a_light_of_tiny_range_lights_nothing() -> None:
    """The square of the range is 0."""
    lamp = Light(LightKind.POINT, intensity=9.0, position=(0.5, 0.0, 2.0), range=1e-170)
    for dark, lit in (
        (Look("studio"), Look("studio", rig=replace(STUDIO, lights=(*STUDIO.lights, lamp)))),
        (Look("gltf", camera_light=CAMERA_LIGHT), Look("gltf", camera_light=replace(CAMERA_LIGHT, lights=(lamp,)))),
    ):
        images = [RENDERER.render(SCENES["opaque"], VIEW, Output.COLOR, look).color for look in (dark, lit)]
        np.testing.assert_array_equal(images[0], images[1])
