"""Matched depth of the demo scene against ground truth."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.matched_depth import matched_depth
from gateway.adapters.stereo.imaging.rendered_images import ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.demo import PERIOD, Demo
from gateway.runtime.settings import Settings
from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.mount import parse_mount_pose
from gateway.scene.tree.live import LiveTree
from renderers.interface import Output
from renderers.raster import CpuRenderer
from renderers.stereo.depth.depth_images import true_disparity
from renderers.stereo.depth.matching import ImagePair
from renderers.stereo.sensor.camera_image import NoiseStream


@pytest.mark.parametrize("seconds", [1.3, 4.0, 0.625 * PERIOD])
def test_matched_depth_of_the_demo_scene(renderer: CpuRenderer, seconds: float) -> None:
    """Covers every pixel that both cameras see, with the default pose and parameters."""
    tree = LiveTree()
    demo = Demo(tree)
    demo.populate()
    demo.move_to(seconds)
    scene = flatten(tree.snapshot.root)
    imaging, settings = Imaging(StereoConfig(depth_mode="matched"), renderer), read_settings(Parameters())
    divisor = settings.quality.divisor
    model = imaging.config.model
    capture = Capture(0, scene, 1, parse_mount_pose(Settings(only=()).stereo_pose), 1, 1)
    exposure = imaging.meter(capture, settings).exposure
    left, right = (
        imaging.expose(capture, ImageRequest(exposure, stream, frozenset((False,))))[False]
        for stream in (NoiseStream.LEFT, NoiseStream.RIGHT)
    )
    images = matched_depth(imaging.config, ImagePair(left, right, exposure), settings, None)
    seen = imaging.render(capture, 0.0, divisor, Output.DEPTH)
    other = imaging.render(capture, model.baseline, divisor, Output.DEPTH)
    assert seen.depth is not None
    assert other.depth is not None
    true = true_disparity(
        seen.depth, other.depth, model.focal_times_baseline(divisor), settings.filters.measurable_depths(model, divisor)
    )
    visible = true > 0
    assert visible.mean() > 0.6
    valid = visible & (images.disparity > 0)
    assert valid.sum() / visible.sum() >= 0.95
    assert (np.abs(images.disparity / 16 - true)[valid] > 1).mean() < 0.02
