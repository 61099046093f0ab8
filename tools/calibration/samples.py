"""Stereo images of ``scenes``, with their exact disparity."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import StreamSettings, read_settings
from gateway.adapters.stereo.imaging.rendered_images import ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.demo import Demo
from gateway.runtime.settings import Settings
from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.mount import parse_mount_pose
from gateway.scene.tree.live import LiveTree
from renderers.interface import Output
from renderers.raster import CpuRenderer
from renderers.stereo.depth.depth_images import true_disparity
from renderers.stereo.depth.matching import ImagePair
from renderers.stereo.model import Quality
from renderers.stereo.realism import REALISM_PARTS
from renderers.stereo.sensor.camera_image import NoiseStream
from tools.calibration.scenes import POSE, SCENES, Scene, make_scene


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Image pair at the resolution of the depth images, and the inputs of depth."""

    name: str
    """Name of the scene's function."""
    projector: bool
    """The projector is on."""
    left: NDArray[np.uint16]
    """(H, W) uint16, units of 1/16 grey level."""
    right: NDArray[np.uint16]
    """(H, W) uint16, likewise."""
    noise_sigma: NDArray[np.float64]
    """(256,) float64, standard deviation of the noise in both images by grey level, grey levels."""
    exact: NDArray[np.float32]
    """(H, W) float32, disparity of every surface in the left image, pixels, 0: background."""
    visible: NDArray[np.float32]
    """(H, W) float32, pixels: ``exact`` where both cameras see the surface in the measurable range, 0 elsewhere."""
    disparity_count: int
    """Number of disparities to search."""
    imaging: Imaging
    """Source of the images, with the configuration."""
    settings: StreamSettings
    """Parameters of the frame."""
    pair: ImagePair
    """Images at full resolution."""
    capture: Capture
    """Scene, pose and number of the frame."""


@cache
def renderer() -> CpuRenderer:
    return CpuRenderer()


def samples(
    quality: Quality, seed: int, *, realism: bool = False, scenes: Sequence[Scene] = SCENES
) -> Iterator[Sample]:
    """Yield a sample of every scene without and with the projector.

    Args:
        quality: resolution of the depth images.
        seed: seed of scenes, noise and fixed pattern.
        realism: images with all parts of ``--stereo-realism``.
        scenes: functions of the scenes.
    """
    config = StereoConfig(seed=seed, realism=frozenset(REALISM_PARTS if realism else ()))
    imaging, settings = Imaging(config, renderer()), replace(read_settings(Parameters()), quality=quality)
    for number, scene in enumerate(scenes):
        draw_list = make_scene(scene, (seed, number))
        for projector in (False, True):
            yield make_sample(scene.__name__, imaging, settings, Capture(0, draw_list, 1, POSE, int(projector), seed))


def demo_samples(*, realism: bool = False) -> Iterator[Sample]:
    """Yield the demo at three times, without and with the projector, from the camera's default pose at ``High``."""
    tree = LiveTree()
    demo = Demo(tree)
    demo.populate()
    imaging = Imaging(StereoConfig(realism=frozenset(REALISM_PARTS if realism else ())), renderer())
    settings, pose = read_settings(Parameters()), parse_mount_pose(Settings(only=()).stereo_pose)
    for frame, seconds in enumerate((1.3, 4.0, 7.0)):
        demo.move_to(seconds)
        draw_list = flatten(tree.snapshot.root)
        for projector in (False, True):
            yield make_sample("demo", imaging, settings, Capture(0, draw_list, 1, pose, int(projector), frame))


def make_sample(name: str, imaging: Imaging, settings: StreamSettings, capture: Capture) -> Sample:
    """Return images and depth of a capture."""
    model, divisor = imaging.config.model, settings.quality.divisor
    exposure = imaging.meter(capture, settings).exposure
    left, right = (
        imaging.expose(capture, ImageRequest(exposure, stream, frozenset((False,))))[False]
        for stream in (NoiseStream.LEFT, NoiseStream.RIGHT)
    )
    pair = ImagePair(left, right, exposure)
    small_left, small_right = pair.reduced(model, divisor)
    left_view = imaging.render_lit(capture, 0.0, divisor, Output.DEPTH)
    right_view = imaging.render_lit(capture, model.baseline, divisor, Output.DEPTH)
    assert left_view.depth is not None
    assert right_view.depth is not None
    depth = left_view.depth, right_view.depth
    factor, limits = model.focal_times_baseline(divisor), settings.filters.measurable_depths(model, divisor)
    filters, noise = settings.filters, (imaging.config.noise_factor, settings.averaged_images, divisor)
    return Sample(
        name,
        capture.out1_high,
        small_left,
        small_right,
        pair.noise_sigma(*noise, has_pattern=imaging.config.has_fixed_pattern),
        np.asarray(np.where(np.isfinite(depth[0]), factor / depth[0], 0.0), np.float32),
        true_disparity(*depth, factor, limits),
        model.disparity_count(divisor, limits.min_depth, filters.maxdepth),
        imaging,
        settings,
        pair,
        capture,
    )
