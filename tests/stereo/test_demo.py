"""Matched depth of the demo scene, measured against what is really there."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.demo import PERIOD, Demo
from gateway.scene.flatten import flatten
from gateway.scene.live import LiveTree
from gateway.scene.mount import parse_mount_pose
from gateway.settings import Settings
from gateway.stereo.config import StereoConfig
from gateway.stereo.images import Shot, Studio, Wanted
from gateway.stereo.parameters import Parameters
from gateway.stereo.settings import read
from renderers.interface import Output
from renderers.raster import CpuRenderer
from renderers.stereo.noise import Stream
from renderers.stereo.truth import DepthRange, true_disparity


@pytest.mark.parametrize("seconds", [1.3, 4.0, 0.625 * PERIOD])
def test_matching_the_demo_scene_with_the_projector(renderer: CpuRenderer, seconds: float) -> None:
    """Over every pixel that both cameras see; the pose and all parameters are the defaults."""
    tree = LiveTree()
    demo = Demo(tree)
    demo.populate()
    demo.edit(seconds)
    scene = flatten(tree.snapshot.root)
    studio, settings = Studio(StereoConfig(depth_mode="matched"), renderer), read(Parameters())
    divisor = settings.quality.divisor
    model = studio.config.model
    shot = Shot(0, scene, 1, parse_mount_pose(Settings(only=()).stereo_pose), 1)
    exposure = studio.meter(shot, settings).exposure
    left, right = (
        studio.take(shot, Wanted(exposure, 1, stream, divisor, frozenset((False,))))[False]
        for stream in (Stream.LEFT_DEPTH, Stream.RIGHT_DEPTH)
    )
    measured = studio.match(left, right, exposure, settings)
    ft = model.intrinsics(divisor).focal_length * model.baseline
    with (
        studio.render(shot, 0.0, divisor, Output.DEPTH) as seen,
        studio.render(shot, model.baseline, divisor, Output.DEPTH) as other,
    ):
        assert seen.depth is not None
        assert other.depth is not None
        true = true_disparity(seen.depth, other.depth, ft, DepthRange(model.nearest_depth(0.1, 100.0, divisor), 100.0))
    visible = true > 0
    assert visible.mean() > 0.6
    valid = visible & (measured.disparity > 0)
    assert valid.sum() / visible.sum() >= 0.95
    assert (np.abs(measured.disparity / 16 - true)[valid] > 1).mean() < 0.01
