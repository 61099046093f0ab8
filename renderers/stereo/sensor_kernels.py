"""The loops of ``sensor``: a rendered picture to an image, with noise."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler.cache_locator import cached_njit
from renderers.stereo.noise import KERNELS_VERSION, random64

_VERSION = KERNELS_VERSION
STEPS: Final = 4096
"""Of the display-encoded value in the response curve."""


@cached_njit(nogil=True)
def grey_by_table(picture, table, weights, key, out):
    """One table look-up a pixel: weights of red, green and blue in 1/256, luma in 1024 steps."""
    height, width = out.shape
    total = 0
    red, green, blue = np.uint32(weights[0]), np.uint32(weights[1]), np.uint32(weights[2])
    white = np.uint32(65280)
    for k in range(height):
        random = np.uint64(0)
        for i in range(width):
            if i & 7 == 0:
                random = random64(key, k * width + i)
            luma = red * picture[k, i, 0] + green * picture[k, i, 1] + blue * picture[k, i, 2]
            grey = table[(min(luma, white) * 1028) >> 16, random & np.uint64(127)]
            random >>= np.uint64(8)
            out[k, i] = grey
            total += grey
    return total


@cached_njit(nogil=True)
def color_by_table(picture, table, key, out):
    height, width = out.shape[:2]
    total = 0
    for k in range(height):
        for i in range(width):
            random = random64(key, k * width + i)
            for c in range(3):
                value = table[c, picture[k, i, c], random & np.uint64(127)]
                random >>= np.uint64(8)
                out[k, i, c] = value
                total += value
    return total


@cached_njit(nogil=True)
def grey_with_dots(picture, dots, light, weights, response, sigma, normal, key, out):
    height, width = out.shape
    top = np.float32(STEPS - 1)
    red, green, blue = weights[0], weights[1], weights[2]
    total = 0
    for k in range(height):
        random = np.uint64(0)
        for i in range(width):
            if i & 3 == 0:
                random = random64(key, k * width + i)
            v = picture[k, i, 0] * red + picture[k, i, 1] * green + picture[k, i, 2] * blue
            step = int(min(v * light[dots[k, i]], top))
            g = response[step] + sigma[step] * normal[random & np.uint64(4095)]
            random >>= np.uint64(16)
            grey = int(min(max(g, np.float32(0.0)), np.float32(255.0)))
            out[k, i] = grey
            total += grey
    return total


@cached_njit(nogil=True)
def color_with_dots(picture, dots, light, weights, response, sigma, normal, key, out):
    height, width = out.shape[:2]
    top = np.float32(STEPS - 1)
    total = 0
    for k in range(height):
        for i in range(width):
            random = random64(key, k * width + i)
            lit = light[dots[k, i]]
            for c in range(3):
                step = int(min(picture[k, i, c] * weights[c] * lit, top))
                g = response[step] + sigma[step] * normal[random & np.uint64(4095)]
                random >>= np.uint64(16)
                value = int(min(max(g, np.float32(0.0)), np.float32(255.0)))
                out[k, i, c] = value
                total += value
    return total
