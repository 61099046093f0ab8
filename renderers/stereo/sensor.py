"""Image sensor: turns a rendered colour image, or a light image of ``optics``, into a camera image with exposure, noise
and saturation.

The noise follows ``exposure.noise_sigma``. Its standard deviation is about 0.3 grey levels at mid grey and 0 dB, as in
images recorded with a device.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.pending import wait_until_compiled
from renderers.stereo import sensor_kernels as kernels
from renderers.stereo import sensor_light_kernels
from renderers.stereo.exposure import BRACKETS, DISPLAY_GAMMA, LUMA, Exposure, noise_sigma
from renderers.stereo.fixed_pattern import GAIN_UNIT, OFFSET_UNIT, FixedPattern
from renderers.stereo.noise import NORMAL_TABLE
from renderers.stereo.optics import LIGHT_WHITE

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


def sensor_image(
    rendered: NDArray[np.uint8],
    exposure: Exposure,
    key: np.uint64,
    *,
    color: bool,
    dots: NDArray[np.uint8] | None = None,
    dot_light: float = 0.0,
    noise_factor: float = 1.0,
) -> SensorImage:
    """Return the camera image of a rendered image.

    Args:
        rendered: (H, W, 3) uint8 RGB, C-contiguous.
        exposure: exposure and white balance.
        key: random key of this frame and camera (``noise.frame_key``).
        color: return RGB; otherwise grey by Rec. 601 luma.
        dots: (H, W) uint8 light of the projector at each pixel, 255 is full; None: the projector is off.
        dot_light: light that a full dot adds, relative to the scene's own.
        noise_factor: factor of the noise's standard deviation; 0 disables noise.
    """
    wait_until_compiled("stereo")
    height, width = rendered.shape[:2]
    image = np.empty((height, width, 3 if color else 1), np.uint8)
    key = np.uint64(key)
    response, sigma = _response_curves(exposure, noise_factor)
    step_factor = exposure.display_factor / exposure.saturation * (kernels.RESPONSE_STEPS - 1)
    # Without dots, a level depends only on the noise and on one byte (colour) or luma step (grey). A table of noisy
    # levels then halves the time.
    if dots is not None:
        light = 1.0 + dot_light * np.arange(256) / 255.0
        dot_factors = (light ** (1.0 / DISPLAY_GAMMA) * step_factor).astype(np.float32)
        weights = (
            np.diag(exposure.channel_factors / 255.0) if color else (exposure.channel_factors * LUMA / 255.0)[None]
        )
        level_sum = kernels.image_with_dots(
            rendered, dots, dot_factors, weights.astype(np.float32), response, sigma, NORMAL_TABLE, key, image
        )
    elif color:
        levels = [_noisy_levels(response, sigma, 256, step_factor * factor) for factor in exposure.channel_factors]
        level_sum = kernels.color_from_table(rendered, np.stack(levels), key, image)
    else:
        table = _noisy_levels(response, sigma, kernels.LUMA_STEPS, step_factor)
        level_sum = kernels.grey_from_table(rendered, table, _luma_weights(exposure), key, image[:, :, 0])
    return SensorImage(image if color else image[:, :, 0], level_sum / (255.0 * image.size))


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
    wait_until_compiled("stereo")
    image = np.empty(light.shape, np.uint8)
    # Steps along the square root of the light: the display-encoded value is its power of 2 / 2.2.
    saturated_root = (exposure.saturation / exposure.display_factor) ** (DISPLAY_GAMMA / 2.0)
    steps = np.arange(sensor_light_kernels.RESPONSE_STEPS) / (sensor_light_kernels.RESPONSE_STEPS - 1)
    values = steps ** (2.0 / DISPLAY_GAMMA) * exposure.saturation
    response = np.stack(_response_at(values, exposure, noise_factor), axis=1)
    fixed = pattern or _NO_PATTERN
    level_sum = sensor_light_kernels.expose_light(
        light, (sensor_light_kernels.RESPONSE_STEPS - 1) / (saturated_root * LIGHT_WHITE), response,
        fixed.offset, fixed.gain, OFFSET_UNIT * exposure.amplification, 0.5 * GAIN_UNIT,
        _NOISE_QUANTILES, np.uint64(key), image,
    )  # fmt: skip
    return SensorImage(image if light.shape[2] == 3 else image[:, :, 0], level_sum / (255.0 * image.size))


def _luma_weights(exposure: Exposure) -> NDArray[np.int64]:
    """Return the weights of red, green and blue, (3,) int64, units of 1/256; their sum is 256 at neutral white
    balance."""
    return np.rint(np.array((77.0, 150.0, 29.0)) * exposure.channel_factors).astype(np.int64)


def _noisy_levels(
    response: NDArray[np.float32], sigma: NDArray[np.float32], count: int, step_factor: float
) -> NDArray[np.uint8]:
    """Return the grey levels of display-encoded values from 0 to 1, each with 128 equally likely noise values.

    Args:
        response: grey level of each step (``_response_curves``).
        sigma: standard deviation of the noise of each step (``_response_curves``).
        count: number of values.
        step_factor: steps per display-encoded value.

    Returns:
        (count, 128) uint8.
    """
    values = np.arange(count, dtype=np.float32) / (count - 1) * np.float32(step_factor)
    step = np.minimum(values, kernels.RESPONSE_STEPS - 1).astype(np.int32)
    levels = response[step][:, None] + sigma[step][:, None] * _NOISE_QUANTILES
    return np.clip(levels, 0.0, 255.0).astype(np.uint8)


def _response_curves(exposure: Exposure, noise_factor: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the grey level plus 0.5, for rounding, and the noise's standard deviation, both (4096,) float32.

    The index is the step of a display-encoded value multiplied by the exposure's factors, from 0 to saturation.
    """
    return _response_at(
        np.arange(kernels.RESPONSE_STEPS) / (kernels.RESPONSE_STEPS - 1) * exposure.saturation, exposure, noise_factor
    )


def _response_at(
    values: NDArray[np.float64], exposure: Exposure, noise_factor: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the grey level plus 0.5 and the noise's standard deviation, both float32, of ascending values from 0 to
    saturation: display-encoded values multiplied by the exposure's factors."""
    grey = 255.0 * exposure.response(values)
    amplification = exposure.amplification
    if exposure.hdr:
        sigma = _hdr_noise_sigma(values, amplification) * np.gradient(grey, values)
    else:
        sigma = noise_sigma(grey, amplification)
    return (grey + 0.5).astype(np.float32), (sigma * noise_factor).astype(np.float32)


def _hdr_noise_sigma(values: NDArray[np.float64], amplification: float) -> NDArray[np.float64]:
    """Return the standard deviation of the noise in a high dynamic range image before compression.

    The image is the mean of three exposures. Each exposure is weighted by its distance from black and white.

    Args:
        values: display-encoded values multiplied by the exposure's factors.
        amplification: gain as a factor.
    """
    weight_sum, variance = np.zeros_like(values), np.zeros_like(values)
    for bracket in BRACKETS:
        scale = bracket ** (1.0 / DISPLAY_GAMMA)
        exposed = np.minimum(values * scale, 1.0)
        weight = np.maximum(1.0 - (2.0 * exposed - 1.0) ** 12, 1e-3) * np.where(exposed < 1.0, scale**2, 1e-6)
        weight_sum += weight
        variance += (weight * (noise_sigma(255.0 * exposed, amplification) / 255.0 / scale)) ** 2
    sigma: NDArray[np.float64] = np.sqrt(variance) / weight_sum
    return sigma
