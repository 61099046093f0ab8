"""Camera images with and without the parts of ``--stereo-realism``."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture, SceneState
from gateway.demo import PERIOD, Demo
from gateway.runtime.settings import Settings
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.mount import parse_mount_pose
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from renderers.raster import CpuRenderer
from renderers.stereo.model import Quality
from renderers.stereo.realism import REALISM_PARTS, RealismPart
from renderers.stereo.sensor.camera_image import NoiseStream
from renderers.stereo.sensor.exposure import SATURATED_SHARE
from tests.adapters.stereo.camera_images import expose, matched_and_true
from tests.adapters.stereo.conftest import SMALL

ALL = StereoConfig(realism=frozenset(REALISM_PARTS))


def moving_demo(gpio: int, seconds: float = 0.0) -> Capture:
    """Return a capture of the demo scene at a time with the frame before it."""
    tree, flattener = LiveTree(), Flattener(LabelTable())
    demo = Demo(tree)
    demo.populate()
    demo.move_to(seconds)
    before = flattener.flatten(tree.snapshot)
    demo.move_to(seconds + 0.04)
    left = parse_mount_pose(Settings(only=()).stereo_pose)
    return Capture(40_000_000, flattener.flatten(tree.snapshot), 1, left, gpio, 1, SceneState(0, before, left))


@pytest.mark.parametrize("gpio", [0, 1])
def test_equal_inputs_give_equal_bytes(renderer: CpuRenderer, gpio: int) -> None:
    other = CpuRenderer(1)
    config = replace(ALL, model=SMALL)
    images = []
    for each in (renderer, other):
        imaging, capture = Imaging(config, each), moving_demo(gpio)
        exposure = imaging.meter(capture, read_settings(Parameters())).exposure
        request = ImageRequest(exposure, NoiseStream.RIGHT, frozenset((True,)))
        images.append(imaging.expose(capture, request)[True].image)
    other.close()
    assert (images[0] == images[1]).all()


@pytest.mark.parametrize("part", REALISM_PARTS)
def test_each_part_changes_the_image_by_itself(renderer: CpuRenderer, part: RealismPart) -> None:
    capture = moving_demo(int(part == "projector"))
    exposure = replace(read_settings(Parameters()).manual_exposure, time=0.1, gain=-26.0)
    without, with_part = (
        expose(Imaging(StereoConfig(model=SMALL, realism=parts), renderer), capture, exposure).image
        for parts in (frozenset[RealismPart](), frozenset((part,)))
    )
    assert (without != with_part).mean() > 0.001


def test_automatic_exposure_does_not_clip_the_dots(renderer: CpuRenderer) -> None:
    capture = moving_demo(1)
    for parts in (REALISM_PARTS, ("projector",)):
        config = StereoConfig(realism=frozenset(parts))
        imaging = Imaging(config, renderer)
        metered = imaging.meter(capture, read_settings(Parameters()))
        image = expose(imaging, capture, metered.exposure)
        assert (image.image == 255).mean() < SATURATED_SHARE
        assert image.brightness == pytest.approx(metered.brightness, abs=0.08)
        assert image.brightness > 0.2


@pytest.mark.parametrize(
    ("config", "quality", "seconds", "wrong"),
    [
        (ALL, Quality.HIGH, 0.0, 0.03),
        (ALL, Quality.MEDIUM, 0.0, 0.03),
        *((StereoConfig(), Quality.HIGH, seconds, 0.02) for seconds in (1.3, 4.0, 0.625 * PERIOD)),
    ],
)
def test_the_demo_is_matched(
    renderer: CpuRenderer, config: StereoConfig, quality: Quality, seconds: float, wrong: float
) -> None:
    settings = replace(read_settings(Parameters()), quality=quality)
    measured, true = matched_and_true(Imaging(config, renderer), moving_demo(1, seconds), settings)
    assert (true > 0).mean() > 0.6
    valid = (true > 0) & (measured > 0)
    assert valid.sum() / (true > 0).sum() >= 0.95
    errors = np.abs(measured - true)[valid]
    assert (errors > 0.5).mean() < 0.065
    assert (errors > 1.0).mean() < wrong
