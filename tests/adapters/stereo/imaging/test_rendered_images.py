"""Depth, disparity and shading of rendered scenes: every model, every quality."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.profile import PROFILE_NAMES, read_profile
from gateway.adapters.stereo.device.stream_settings import StreamSettings, read_settings
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.demo import Demo
from gateway.files.gltf import read_gltf
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.transforms import look_at, translation
from renderers.drawlist import AlphaMode, DrawList, Instance, Material
from renderers.interface import LookName, Output
from renderers.primitives import box
from renderers.raster import CpuRenderer
from renderers.stereo.model import Quality, StereoModel
from scenegate.messages.geometry import Sphere
from tests.adapters.stereo.scenes import part, scene_of
from tests.support.corpus import drake_scene

UP = (0.0, 0.0, 1.0)


def demo() -> Capture:
    tree = LiveTree()
    scene = Demo(tree)
    scene.populate()
    scene.move_to(1.3)
    return Capture(0, flatten(tree.snapshot.root), 1, look_at((1.4, -1.1, 1.7), (0.0, 0.0, 0.85), UP), 0)


def recorded() -> Capture:
    """Return a robot arm posted by Drake, from 1.5 m."""
    scene = drake_scene("010_iiwa_wsg")
    root = read_gltf(scene.request("depth").scene, posted=True).root
    return Capture(0, flatten(root), 1, look_at((1.5, 0.9, 1.0), (0.0, 0.0, 0.5), UP), 0)


def settings(quality: Quality) -> StreamSettings:
    return replace(read_settings(Parameters()), quality=quality)


def measure(imaging: Imaging, capture: Capture, quality: Quality) -> NDArray[np.uint16]:
    return imaging.measure(capture, settings(quality), None).disparity


@pytest.mark.parametrize("model", [read_profile(name).model for name in PROFILE_NAMES], ids=lambda m: m.name)
@pytest.mark.parametrize("scene", [demo, pytest.param(recorded, marks=pytest.mark.corpus)])
def test_depth_from_disparity_equals_rendered_depth(renderer: CpuRenderer, scene: object, model: StereoModel) -> None:
    assert callable(scene)
    capture = scene()
    imaging = Imaging(StereoConfig(model=model, noise=False), renderer)
    for quality in Quality:
        disparity = measure(imaging, capture, quality).astype(np.float64) / 16
        k = model.intrinsics(quality.divisor)
        frame: Any = imaging.render(capture, 0.0, quality.divisor, Output.DEPTH)
        depth = frame.depth.astype(np.float64)
        valid = disparity > 0
        assert valid.mean() > (0.3 if scene is demo else 0.05)
        # The published formula: Pz = f t / d; so the disparity of the rasterizer's depth is f t / Pz.
        assert np.abs(k.focal_length * model.baseline / depth[valid] - disparity[valid]).max() <= 1 / 32 + 1e-4


@pytest.mark.parametrize("look", ["phong", "pbr"])
def test_both_cameras_have_the_same_light(renderer: CpuRenderer, look: LookName) -> None:
    """The headlight has one direction for both: a matte surface has the same grey in both images."""
    ball = scene_of(part(Sphere(0.3), (0.7, 0.6, 0.5), 0.0, 0.0, 0.0))
    config = StereoConfig(look=look, noise=False)
    imaging, model = Imaging(config, renderer), config.model
    # The ball's middle half-way between the eyes, at a depth where the disparity is whole pixels.
    depth = model.intrinsics().focal_length * model.baseline / 128.0
    X = look_at((-depth, model.baseline / 2, 0.0), (0.0, model.baseline / 2, 0.0), UP)
    capture = Capture(0, ball, 1, X, 0)
    images, depths = [], []
    for x in (0.0, model.baseline):
        frame: Any = imaging.render(capture, x, 1, Output.COLOR | Output.DEPTH)
        images.append(frame.color.astype(float))
        depths.append(frame.depth.copy())
    width = depths[0].shape[1]
    rows, columns = np.nonzero(np.isfinite(depths[0]))
    landing = columns - np.rint(model.intrinsics().focal_length * model.baseline / depths[0][rows, columns]).astype(int)
    inside = (landing >= 0) & (landing < width)
    rows, columns, landing = rows[inside], columns[inside], landing[inside]
    same = np.abs(depths[1][rows, landing] - depths[0][rows, columns]) < 0.002
    difference = np.abs(images[1][rows, landing] - images[0][rows, columns])[same]
    assert len(difference) > 10_000
    assert np.quantile(difference, 0.95) <= 3


def test_truth_has_no_cut_outs_and_no_surfaces_below_the_threshold(renderer: CpuRenderer) -> None:
    film = Material((1.0, 0.0, 0.0, 0.25), alpha_mode=AlphaMode.BLEND)
    cut_out = Material((1.0, 0.0, 0.0, 0.25), alpha_mode=AlphaMode.MASK)
    boxes = [
        Instance(box(), material, translation(0.0, 0.0, z), label)
        for material, z, label in ((cut_out, 2.0, 1), (film, 4.0, 2), (Material(), 6.0, 3))
    ]
    capture = Capture(0, DrawList(tuple(boxes)), 1, np.eye(4), 0)
    for threshold, label, depth in ((0.0, 2, 3.5), (0.5, 3, 5.5)):
        imaging = Imaging(StereoConfig(alpha_threshold=threshold), renderer)
        frame: Any = imaging.render(capture, 0.0, 8, Output.DEPTH | Output.LABEL)
        middle = frame.label.shape[0] // 2, frame.label.shape[1] // 2
        assert (frame.label[middle], frame.depth[middle]) == (label, pytest.approx(depth, rel=1e-6))
