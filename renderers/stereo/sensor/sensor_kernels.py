"""Kernel of ``image_from_light``: a camera image from a light image."""

import numpy as np

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F64, I64, U64, Array1, Array2, f32, i32, i64, u32, u64
from renderers.stereo.sensor.exposure import RESPONSE_STEPS
from renderers.stereo.sensor.noise import random64


@kernel
def expose_light(
    light: Array2[np.uint16],
    channels: I64,
    step_factor: F64,
    response: Array2[np.float32],
    offsets: Array2[np.int8],
    gains: Array2[np.int8],
    offset_unit: F64,
    gain_unit: F64,
    normal_quantiles: Array1[np.float32],
    key: U64,
    image: Array2[np.uint8],
) -> I64:
    """Write a grey or RGB image, (H, W C), and return the sum of its levels.

    Args:
        light: (H, W C), rows of ``light_on_sensor``.
        step_factor: steps of ``response`` per unit of ``light``.
        response: (``RESPONSE_STEPS``, 2) by step: grey level plus 0.5, for rounding, and standard deviation of the
            noise, grey levels.
        offsets, gains: (H, W), fixed offset and gain of each pixel; (1, 1): no fixed pattern.
        offset_unit: grey levels per unit of ``offsets``.
        gain_unit: relative change of ``light`` per unit of ``gains``: half that of the light, as ``light`` has square
            roots.
        normal_quantiles: (128,), equally likely values of unit variance.
    """
    height, size = image.shape
    width = size // channels
    factor, last_step = f32(step_factor), f32(RESPONSE_STEPS - 1)
    zero, half, one, white = f32(0.0), f32(0.5), f32(1.0), f32(255.0)
    offset_scale, gain_scale = f32(offset_unit), f32(gain_unit)
    # Values of one row. The loops that read no tables compile to vector instructions.
    pixel_factors, fixed_levels = np.full(size, factor, np.float32), np.zeros(size, np.float32)
    steps, noise = np.empty(size, np.uint32), np.empty(size + 8, np.float32)
    level_sum = i64(0)
    for row in range(height):
        if offsets.shape[0] > 1:
            for channel in range(channels):
                for column in range(width):
                    i = column * channels + channel
                    pixel_factors[i] = factor * (one + f32(gains[row, column]) * gain_scale)
                    fixed_levels[i] = f32(offsets[row, column]) * offset_scale
        for i in range(size):
            steps[i] = i32(min(f32(light[row, i]) * pixel_factors[i] + half, last_step))
        # A channel takes 8 of 64 random bits: one number is enough for eight grey pixels, or for one pixel in colour.
        first_pixel = row * width
        if channels == 1:
            for column in range(0, width, 8):
                _draw(random64(key, first_pixel + column), 8, normal_quantiles, noise, column)
        else:
            for column in range(width):
                _draw(random64(key, first_pixel + column), 3, normal_quantiles, noise, 3 * column)
        row_sum = u32(0)
        for i in range(size):
            step = u64(steps[i])  # unsigned: signed indices are tested for being negative
            noisy = response[step, 0] + response[step, 1] * noise[i] + fixed_levels[i]
            level = u32(i32(min(max(noisy, zero), white)))
            image[row, i] = level
            row_sum += level
        level_sum += i64(row_sum)
    return level_sum


@inlined
def _draw(
    random_bits: U64, count: I64, normal_quantiles: Array1[np.float32], noise: Array1[np.float32], first: I64
) -> None:
    """Write ``count`` normal numbers from 8 random bits each to ``noise`` from ``first``."""
    for i in range(count):
        noise[first + i] = normal_quantiles[random_bits & u64(127)]
        random_bits >>= u64(8)
