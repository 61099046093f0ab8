"""Kernels of ``sensor``. Each writes an image and returns the sum of its grey levels."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler.jit import kernel
from renderers.stereo.noise import random64

RESPONSE_STEPS: Final = 4096
"""Number of samples of the response curve along the display-encoded value."""
LUMA_STEPS: Final = 1024
"""Number of luma steps in the table of grey levels: more than 256, to avoid banding."""
_WHITE_LUMA: Final = 255 * 256
"""Luma of white, units of 1/256 grey level."""
_STEPS_PER_LUMA_Q16: Final = 1028
"""Luma steps per unit of luma, times 2^16: the brightest luma is the last step."""


@kernel("int64(uint8[:,:,::1], uint8[:,::1], int64[::1], uint64, uint8[:,::1])")
def grey_from_table(rendered, levels, luma_weights, key, image):
    """Write a grey image.

    Args:
        rendered: (H, W, 3) uint8 RGB.
        levels: (``LUMA_STEPS``, 128) uint8: grey level by luma step and by one of 128 equally likely noise values.
        luma_weights: (3,) int64, weights of red, green and blue, units of 1/256.
        key: random key.
        image: (H, W) uint8, output.
    """
    height, width = image.shape
    level_sum = 0
    red, green, blue = np.uint32(luma_weights[0]), np.uint32(luma_weights[1]), np.uint32(luma_weights[2])
    white = np.uint32(_WHITE_LUMA)
    for row in range(height):
        random_bits = np.uint64(0)
        for column in range(width):
            if column & 7 == 0:
                random_bits = random64(key, row * width + column)
            luma = red * rendered[row, column, 0] + green * rendered[row, column, 1] + blue * rendered[row, column, 2]
            level = levels[(min(luma, white) * _STEPS_PER_LUMA_Q16) >> 16, random_bits & np.uint64(127)]
            random_bits >>= np.uint64(8)
            image[row, column] = level
            level_sum += level
    return level_sum


@kernel("int64(uint8[:,:,::1], uint8[:,:,::1], uint64, uint8[:,:,::1])")
def color_from_table(rendered, levels, key, image):
    """Write an RGB image.

    Args:
        rendered: (H, W, 3) uint8 RGB.
        levels: (3, 256, 128) uint8: level by channel, rendered byte and one of 128 equally likely noise values.
        key: random key.
        image: (H, W, 3) uint8, output.
    """
    height, width = image.shape[:2]
    level_sum = 0
    for row in range(height):
        for column in range(width):
            random_bits = random64(key, row * width + column)
            for channel in range(3):
                level = levels[channel, rendered[row, column, channel], random_bits & np.uint64(127)]
                random_bits >>= np.uint64(8)
                image[row, column, channel] = level
                level_sum += level
    return level_sum


@kernel(
    "int64(uint8[:,:,::1], uint8[:,::1], float32[::1], float32[:,::1], float32[::1], float32[::1], float32[::1], "
    "uint64, uint8[:,:,::1])"
)
def image_with_dots(rendered, dots, dot_factors, channel_weights, response, sigma, normal_table, key, image):
    """Write a grey or RGB image under the projector's light.

    Args:
        rendered: (H, W, 3) uint8 RGB.
        dots: (H, W) uint8, the projector's light.
        dot_factors: (256,) float32; for each value of ``dots``, the factor from a display-encoded value to an index
                of ``response``.
        channel_weights: (1 or 3, 3) float32, weights of red, green and blue in each channel of the image.
        response: (``RESPONSE_STEPS``,) float32, grey level of each step.
        sigma: (``RESPONSE_STEPS``,) float32, standard deviation of the noise of each step, grey levels.
        normal_table: ``noise.NORMAL_TABLE``.
        key: random key.
        image: (H, W, 1 or 3) uint8, output.
    """
    height, width, channels = image.shape
    last_step = np.float32(RESPONSE_STEPS - 1)
    pixels_per_random = 4 // channels
    level_sum = 0
    for row in range(height):
        random_bits = np.uint64(0)
        for column in range(width):
            if column % pixels_per_random == 0:
                random_bits = random64(key, row * width + column)
            factor = dot_factors[dots[row, column]]
            for channel in range(channels):
                value = (
                    rendered[row, column, 0] * channel_weights[channel, 0]
                    + rendered[row, column, 1] * channel_weights[channel, 1]
                    + rendered[row, column, 2] * channel_weights[channel, 2]
                )
                step = int(min(value * factor, last_step))
                noisy = response[step] + sigma[step] * normal_table[random_bits & np.uint64(4095)]
                random_bits >>= np.uint64(16)
                level = int(min(max(noisy, np.float32(0.0)), np.float32(255.0)))
                image[row, column, channel] = level
                level_sum += level
    return level_sum
