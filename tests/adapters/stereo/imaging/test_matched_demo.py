"""Matched depth of the demo scene against ground truth."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.demo import PERIOD, Demo
from gateway.runtime.settings import Settings
from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.mount import parse_mount_pose
from gateway.scene.tree.live import LiveTree
from renderers.raster import CpuRenderer
from tests.adapters.stereo.camera_images import matched_and_true


@pytest.mark.parametrize("seconds", [1.3, 4.0, 0.625 * PERIOD])
def test_matched_depth_of_the_demo_scene(renderer: CpuRenderer, seconds: float) -> None:
    """Covers every pixel that both cameras see, with the default pose and parameters."""
    tree = LiveTree()
    demo = Demo(tree)
    demo.populate()
    demo.move_to(seconds)
    capture = Capture(0, flatten(tree.snapshot.root), 1, parse_mount_pose(Settings(only=()).stereo_pose), 1, 1)
    measured, true = matched_and_true(Imaging(StereoConfig(), renderer), capture, read_settings(Parameters()))
    visible = true > 0
    assert visible.mean() > 0.6
    valid = visible & (measured > 0)
    assert valid.sum() / visible.sum() >= 0.95
    assert (np.abs(measured - true)[valid] > 1).mean() < 0.02
