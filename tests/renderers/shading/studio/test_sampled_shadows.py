"""Shadows in images of several samples per pixel."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.style import Style
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, TreeEdit
from gateway.scene.tree.transforms import look_at, translation
from renderers.camera import Camera
from renderers.drawlist import Material
from renderers.interface import Output, SampleCount
from renderers.light_rig import LightChange
from renderers.raster import CpuRenderer
from scenegate.messages.geometry import Box, Cylinder


@pytest.mark.parametrize("samples", [4, 8])
def test_shadows_on_slivers_are_those_of_one_sample(samples: SampleCount) -> None:
    """The cap of a cylinder has thin triangles, whose pixels at their edges are shaded outside of them."""
    edit = TreeEdit(Node())
    material = Material((0.2, 0.5, 0.8, 1.0))
    edit.set_parts(("disc",), (Part(Cylinder(1.0, 0.1), material),))
    edit.set_parts(("box",), (Part(Box((0.3, 0.3, 0.3)), material, translation(0.3, 0.2, 0.3)),))
    scene = flatten(edit.commit())
    pose = look_at((0.5, -2.5, 2.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    camera = Camera(200, 160, 60.0, 60.0, 100.0, 80.0, 0.1, 100.0, pose)
    style = Style().for_image(None, LightChange(60.0, 50.0, 1.0, 0.3))
    images = []
    for count in (1, samples):
        frame = CpuRenderer().render(scene, camera, Output.COLOR, replace(style, samples=count).look_for("studio"))
        assert frame.color is not None
        images.append(frame.color)
    single, sampled = images
    kernel = np.ones((3, 3), np.uint8)
    is_smooth = (cv2.dilate(single, kernel) - cv2.erode(single, kernel)).max(axis=2) < 24
    assert is_smooth.mean() > 0.9
    assert np.abs(single.astype(int) - sampled).max(axis=2)[is_smooth].max() <= 24
