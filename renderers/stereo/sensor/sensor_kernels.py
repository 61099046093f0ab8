"""Kernel of ``image_from_light``: a camera image from a light image."""

from __future__ import annotations

import numpy as np

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.stereo.sensor.exposure import RESPONSE_STEPS
from renderers.stereo.sensor.noise import random64


@kernel(
    "int64(uint16[:,::1], int64, float64, float32[:,::1], int8[:,::1], int8[:,::1], float64, float64, "
    "float32[::1], uint64, uint8[:,::1])"
)
def expose_light(
    light, channels, step_factor, response, offsets, gains, offset_unit, gain_unit, normal_quantiles, key, image
):  # fmt: skip
    """Write a grey or RGB image and return the sum of its levels.

    Args:
        light: (H, W C) uint16, rows of ``light_on_sensor``.
        channels: C, 1 or 3.
        step_factor: steps of ``response`` per unit of ``light``.
        response: (``RESPONSE_STEPS``, 2) float32 by step: grey level plus 0.5, for rounding, and standard deviation of
            the noise, grey levels.
        offsets: (H, W) int8, fixed offset of each pixel; (1, 1): no fixed pattern.
        gains: (H, W) int8, fixed gain of each pixel; (1, 1): no fixed pattern.
        offset_unit: grey levels per unit of ``offsets``.
        gain_unit: relative change of ``light`` per unit of ``gains``: half that of the light, as ``light`` has square
            roots.
        normal_quantiles: (128,) float32, equally likely values of unit variance.
        key: random key.
        image: (H, W C) uint8, output.
    """
    height, size = image.shape
    width = size // channels
    factor, last_step = np.float32(step_factor), np.float32(RESPONSE_STEPS - 1)
    zero, half, one, white = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(255.0)
    offset_scale, gain_scale = np.float32(offset_unit), np.float32(gain_unit)
    # Values of one row. The loops that read no tables compile to vector instructions.
    pixel_factors, fixed_levels = np.full(size, factor, np.float32), np.zeros(size, np.float32)
    steps, noise = np.empty(size, np.uint32), np.empty(size + 8, np.float32)
    level_sum = np.int64(0)
    for row in range(height):
        if offsets.shape[0] > 1:
            for channel in range(channels):
                for column in range(width):
                    i = column * channels + channel
                    pixel_factors[i] = factor * (one + np.float32(gains[row, column]) * gain_scale)
                    fixed_levels[i] = np.float32(offsets[row, column]) * offset_scale
        for i in range(size):
            steps[i] = np.int32(min(np.float32(light[row, i]) * pixel_factors[i] + half, last_step))
        # A channel takes 8 of 64 random bits: one number is enough for eight grey pixels, or for one pixel in colour.
        first_pixel = row * width
        if channels == 1:
            for column in range(0, width, 8):
                _draw(random64(key, first_pixel + column), 8, normal_quantiles, noise, column)
        else:
            for column in range(width):
                _draw(random64(key, first_pixel + column), 3, normal_quantiles, noise, 3 * column)
        row_sum = np.uint32(0)
        for i in range(size):
            step = np.uint64(steps[i])  # unsigned: signed indices are tested for being negative
            noisy = response[step, 0] + response[step, 1] * noise[i] + fixed_levels[i]
            level = np.uint32(np.int32(min(max(noisy, zero), white)))
            image[row, i] = level
            row_sum += level
        level_sum += np.int64(row_sum)
    return level_sum


@inlined
def _draw(random_bits, count, normal_quantiles, noise, first):
    """Write ``count`` normal numbers from 8 random bits each to ``noise`` from ``first``."""
    for i in range(count):
        noise[first + i] = normal_quantiles[random_bits & np.uint64(127)]
        random_bits >>= np.uint64(8)
