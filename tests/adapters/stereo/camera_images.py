"""Camera images of rendered arrays."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.profile import read_profile
from gateway.adapters.stereo.device.stream_settings import StreamSettings
from gateway.adapters.stereo.imaging.matched_depth import matched_depth
from gateway.adapters.stereo.imaging.rendered_images import GREY, ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from renderers.interface import Output
from renderers.stereo.depth.depth_images import true_disparity
from renderers.stereo.depth.matching import ImagePair
from renderers.stereo.sensor.camera_image import (
    NoiseStream,
    SceneLight,
    SensorImage,
    image_from_light,
    light_on_sensor,
    relative_light,
    roots_of,
)
from renderers.stereo.sensor.exposure import DISPLAY_GAMMA, Exposure

K: Final = read_profile("rc_visard_160c").model.intrinsics()


def sensor_image(
    rendered: NDArray[np.uint8],
    exposure: Exposure,
    key: np.uint64,
    *,
    color: bool = False,
    scene_light: SceneLight = SceneLight(),
    noise_factor: float = 1.0,
) -> SensorImage:
    """Return the camera image of a rendered image, (H, W, 3) uint8, without a lens."""
    light = light_on_sensor(roots_of(rendered), replace(K, width=rendered.shape[1]), exposure, scene_light, color=color)
    return image_from_light(light, exposure, key, noise_factor=noise_factor)


def light_of(rendered: NDArray[np.uint8], light: SceneLight = SceneLight()) -> NDArray[np.float32]:
    """Return the grey light of a rendered image, (H, W) float32; 1 is white."""
    roots = roots_of(rendered)
    return relative_light(light_on_sensor(roots, replace(K, width=rendered.shape[1]), Exposure(), light, color=False))[
        :, :, 0
    ]


def rendered_grey(light: float, shape: tuple[int, int] = (240, 320)) -> NDArray[np.uint8]:
    """Return a rendered image, (H, W, 3) uint8, of about this light."""
    return np.full((*shape, 3), round(255 * light ** (1 / DISPLAY_GAMMA)), np.uint8)


def expose(
    imaging: Imaging, capture: Capture, exposure: Exposure, stream: NoiseStream = NoiseStream.LEFT
) -> SensorImage:
    """Return the grey image of one camera."""
    return imaging.expose(capture, ImageRequest(exposure, stream, frozenset((GREY,))))[GREY]


def matched_and_true(
    imaging: Imaging, capture: Capture, settings: StreamSettings
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return matched disparity and that of the rendered depth, pixels, (H, W) each; 0 is invalid."""
    model, divisor = imaging.config.model, settings.quality.divisor
    exposure = imaging.meter(capture, settings).exposure
    left, right = (expose(imaging, capture, exposure, stream) for stream in (NoiseStream.LEFT, NoiseStream.RIGHT))
    measured = matched_depth(imaging.config, ImagePair(left, right, exposure), settings, None)
    seen, other = (imaging.render(capture, x, divisor, Output.DEPTH).depth for x in (0.0, model.baseline))
    assert seen is not None
    assert other is not None
    limits = settings.filters.measurable_depths(model, divisor)
    return measured.disparity / 16, true_disparity(seen, other, model.focal_times_baseline(divisor), limits)
