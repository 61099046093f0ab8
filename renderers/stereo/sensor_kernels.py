"""Kernels of ``sensor``. Each returns the sum of the grey levels that it wrote."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler.cache_locator import cached_njit
from renderers.stereo.noise import random64

STEPS: Final = 4096
"""Entries of the response curve over the display-encoded value."""


@cached_njit(nogil=True)
def grey_from_table(rendered, table, weights, key, out):
    """Write grey levels; ``weights`` of red, green and blue are units of 1/256, ``table`` has 1024 luma steps."""
    height, width = out.shape
    total = 0
    red, green, blue = np.uint32(weights[0]), np.uint32(weights[1]), np.uint32(weights[2])
    white = np.uint32(65280)
    for k in range(height):
        random = np.uint64(0)
        for i in range(width):
            if i & 7 == 0:
                random = random64(key, k * width + i)
            luma = red * rendered[k, i, 0] + green * rendered[k, i, 1] + blue * rendered[k, i, 2]
            grey = table[(min(luma, white) * 1028) >> 16, random & np.uint64(127)]
            random >>= np.uint64(8)
            out[k, i] = grey
            total += grey
    return total


@cached_njit(nogil=True)
def color_from_table(rendered, table, key, out):
    height, width = out.shape[:2]
    total = 0
    for k in range(height):
        for i in range(width):
            random = random64(key, k * width + i)
            for c in range(3):
                value = table[c, rendered[k, i, c], random & np.uint64(127)]
                random >>= np.uint64(8)
                out[k, i, c] = value
                total += value
    return total


@cached_njit(nogil=True)
def with_dots(rendered, dots, light, weights, response, sigma, normal, key, out):
    """Write grey or colour under the projector's light; ``weights`` is (channels, 3) of red, green and blue."""
    height, width, channels = out.shape
    top = np.float32(STEPS - 1)
    pixels_per_draw = 4 // channels
    total = 0
    for k in range(height):
        random = np.uint64(0)
        for i in range(width):
            if i % pixels_per_draw == 0:
                random = random64(key, k * width + i)
            lit = light[dots[k, i]]
            for c in range(channels):
                value = (
                    rendered[k, i, 0] * weights[c, 0]
                    + rendered[k, i, 1] * weights[c, 1]
                    + rendered[k, i, 2] * weights[c, 2]
                )
                step = int(min(value * lit, top))
                noisy = response[step] + sigma[step] * normal[random & np.uint64(4095)]
                random >>= np.uint64(16)
                level = int(min(max(noisy, np.float32(0.0)), np.float32(255.0)))
                out[k, i, c] = level
                total += level
    return total
