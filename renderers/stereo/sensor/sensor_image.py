"""Image sensor: turns a light image of ``optics`` into a camera image with exposure, noise and saturation.

The noise follows ``exposure.noise_sigma``. Its standard deviation is about 0.3 grey levels at mid grey and 0 dB, as in
images recorded with a device.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.sensor import sensor_kernels as kernels
from renderers.stereo.sensor.exposure import LIGHT_WHITE, RESPONSE_STEPS, Exposure
from renderers.stereo.sensor.fixed_pattern import GAIN_UNIT, OFFSET_UNIT, FixedPattern
from renderers.stereo.sensor.noise import NORMAL_TABLE

_GROUP_MEANS: Final = NORMAL_TABLE.reshape(128, -1).mean(axis=1)
"""(128,) float32, means of groups of neighbouring quantiles."""
_NOISE_QUANTILES: Final = np.asarray(_GROUP_MEANS / _GROUP_MEANS.std(), np.float32)
"""(128,) float32, quantiles of the standard normal distribution, coarser than ``NORMAL_TABLE``."""
_NO_PATTERN: Final = FixedPattern(np.zeros((1, 1), np.int8), np.zeros((1, 1), np.int8))


@dataclass(frozen=True, slots=True)
class SensorImage:
    """One camera image."""

    image: NDArray[np.uint8]
    """(H, W) or (H, W, 3) uint8."""
    brightness: float
    """Mean of the image, 0 to 1."""


def image_from_light(
    light: NDArray[np.uint16],
    exposure: Exposure,
    key: np.uint64,
    pattern: FixedPattern | None = None,
    noise_factor: float = 1.0,
) -> SensorImage:
    """Return the camera image of a light image.

    Args:
        light: (H, W, 3 or 1) uint16, ``optics.light_on_sensor`` with the white balance of ``exposure``.
        exposure: exposure; the white balance is not applied again.
        key: random key of this frame and camera (``noise.frame_key``).
        pattern: fixed pattern of the sensor; None: all pixels are alike.
        noise_factor: factor of the noise's standard deviation; 0 disables noise, but not the fixed pattern.
    """
    image = np.empty(light.shape, np.uint8)
    # Steps along the square root of the light, as in the light image.
    saturated_root = (exposure.saturation / exposure.light) ** 0.5
    grey, noise = exposure.response_table
    response = np.stack((grey, (noise_factor * noise).astype(np.float32)), axis=1)
    fixed = pattern or _NO_PATTERN
    rows, channels = light.shape[0], light.shape[2]
    level_sum = kernels.expose_light(
        light.reshape(rows, -1), channels, (RESPONSE_STEPS - 1) / (saturated_root * LIGHT_WHITE), response,
        fixed.offset, fixed.gain, OFFSET_UNIT * exposure.amplification, 0.5 * GAIN_UNIT,
        _NOISE_QUANTILES, np.uint64(key), image.reshape(rows, -1),
    )  # fmt: skip
    return SensorImage(image if channels == 3 else image[:, :, 0], level_sum / (255.0 * image.size))
