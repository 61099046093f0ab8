"""Texture sampling at one coordinate: wrap, filter, colour space."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from renderers.compiler.pointers import address, u8_at
from renderers.shading.texture_table import WRAP_CLAMP, WRAP_REPEAT

_MAX_COORDINATE = 1e9
AS_STORED = 0
SRGB = 1


def _value_from_byte() -> NDArray[np.float32]:
    stored = np.arange(256) / 255.0
    # IEC 61966-2-1, the piecewise sRGB transfer function.
    linear = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    return np.stack((stored, linear)).astype(np.float32)


VALUE_FROM_BYTE = _value_from_byte()
"""(2, 256) float32, value of each byte by colour space (``AS_STORED``, ``SRGB``). Alpha is always as stored. Texels are
converted before filtering, as required by glTF 2.0."""


@njit(nogil=True, error_model="numpy")
def _wrap(index: int, size: int, wrap: int) -> int:
    """Return the texel 0 .. size - 1 of any index."""
    if wrap == WRAP_REPEAT:
        index = index % size
        return index + size if index < 0 else index
    if wrap == WRAP_CLAMP:
        return min(max(index, 0), size - 1)
    index = index % (2 * size)
    if index < 0:
        index += 2 * size
    return index if index < size else 2 * size - 1 - index


@njit(nogil=True, error_model="numpy")
def _near_origin(coordinate: float, wrap: int) -> float:
    """Return an equivalent coordinate that fits an integer; 0 for NaN and where float32 has no fractions left."""
    if not (abs(coordinate) < _MAX_COORDINATE):
        return 0.0
    if wrap == WRAP_CLAMP:
        return min(max(coordinate, -1.0), 2.0)
    if -1.0 <= coordinate < 3.0:
        return coordinate
    return coordinate - 2.0 * math.floor(0.5 * coordinate)  # two images: the period of MIRRORED_REPEAT


@njit(nogil=True, error_model="numpy")
def sample(texture, value_from_byte, space, u, v):
    """Return RGBA of a texture at (u, v), float32 each.

    Args:
        texture: a TEXTURE.
        value_from_byte: pointer to ``VALUE_FROM_BYTE``.
        space: ``AS_STORED`` or ``SRGB``, for the three colour channels.
        u, v: float64; texel centres are at (i + 0.5) / width, (j + 0.5) / height.
    """
    m, level = texture.uv_transform, texture.levels[0]
    u, v = m[0] * u + m[1] * v + m[2], m[3] * u + m[4] * v + m[5]
    texels, width, height, stride = u8_at(address(level.texels)), level.width, level.height, level.stride
    wrap_s, wrap_t = texture.wrap_s, texture.wrap_t
    x, y = _near_origin(u, wrap_s) * width, _near_origin(v, wrap_t) * height
    if texture.mag_linear == 0:
        texel = 4 * (_wrap(math.floor(y), height, wrap_t) * stride + _wrap(math.floor(x), width, wrap_s))
        return (
            value_from_byte[256 * space + texels[texel]],
            value_from_byte[256 * space + texels[texel + 1]],
            value_from_byte[256 * space + texels[texel + 2]],
            value_from_byte[texels[texel + 3]],
        )
    x -= 0.5
    y -= 0.5
    left, upper = math.floor(x), math.floor(y)  # integers, as in Python
    fx, fy = np.float32(x - left), np.float32(y - upper)
    columns = _wrap(left, width, wrap_s), _wrap(left + 1, width, wrap_s)
    rows = _wrap(upper, height, wrap_t), _wrap(upper + 1, height, wrap_t)
    red = green = blue = alpha = np.float32(0.0)
    for j in range(2):
        for i in range(2):
            weight = (fx if i else np.float32(1.0) - fx) * (fy if j else np.float32(1.0) - fy)
            texel = 4 * (rows[j] * stride + columns[i])
            red += value_from_byte[256 * space + texels[texel]] * weight
            green += value_from_byte[256 * space + texels[texel + 1]] * weight
            blue += value_from_byte[256 * space + texels[texel + 2]] * weight
            alpha += value_from_byte[texels[texel + 3]] * weight
    return red, green, blue, alpha
