"""Kernel of ``sensor.image_from_light``: a camera image from a light image."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler.jit import kernel
from renderers.stereo.noise import random64

RESPONSE_STEPS: Final = 2048
"""Number of samples of the response curve along the square root of the light."""


@kernel(
    "int64(uint16[:,:,::1], float64, float32[:,::1], int8[:,::1], int8[:,::1], float64, float64, "
    "float32[::1], uint64, uint8[:,:,::1])"
)
def expose_light(
    light, step_factor, response, offsets, gains, offset_unit, gain_unit, normal_quantiles, key, image
):  # fmt: skip
    """Write a grey or RGB image and return the sum of its grey levels.

    Args:
        light: (H, W, C) uint16, ``optics.light_on_sensor``.
        step_factor: steps of ``response`` per unit of ``light``.
        response: (``RESPONSE_STEPS``, 2) float32 by step: grey level plus 0.5, for rounding, and standard deviation of
            the noise, grey levels.
        offsets: (H, W) int8, fixed offset of each pixel; (1, 1): no fixed pattern.
        gains: (H, W) int8, fixed gain of each pixel; (1, 1): no fixed pattern.
        offset_unit: grey levels per unit of ``offsets``.
        gain_unit: relative change of ``light``, a square root, per unit of ``gains``.
        normal_quantiles: (128,) float32, equally likely values of unit variance.
        key: random key.
        image: (H, W, C) uint8, output.
    """
    height, width, channels = image.shape
    factor, last_step = np.float32(step_factor), np.float32(RESPONSE_STEPS - 1)
    zero, half, one, white = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(255.0)
    offset_scale, gain_scale = np.float32(offset_unit), np.float32(gain_unit)
    has_pattern = offsets.shape[0] > 1
    # A channel takes 8 of 64 random bits: one number is enough for eight grey pixels, or for one pixel in colour.
    random_mask = 7 if channels == 1 else 0
    level_sum = np.int64(0)
    for row in range(height):
        random_bits = np.uint64(0)
        for column in range(width):
            if column & random_mask == 0:
                random_bits = random64(key, row * width + column)
            gain, offset = factor, zero
            if has_pattern:
                gain = factor * (one + np.float32(gains[row, column]) * gain_scale)
                offset = np.float32(offsets[row, column]) * offset_scale
            for channel in range(channels):
                step = np.int32(min(np.float32(light[row, column, channel]) * gain + half, last_step))
                noise = response[step, 1] * normal_quantiles[random_bits & np.uint64(127)]
                noisy = response[step, 0] + noise + offset
                random_bits >>= np.uint64(8)
                level = np.int32(min(max(noisy, zero), white))
                image[row, column, channel] = level
                level_sum += np.int64(level)
    return level_sum
