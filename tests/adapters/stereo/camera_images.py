"""Camera images of rendered arrays."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.profile import read_profile
from renderers.stereo.sensor.camera_image import (
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
