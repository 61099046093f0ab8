"""Reading a texture at a coordinate: wrap, filter, colour space."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from renderers.shading.texture_table import (
    TI_LEVEL,
    TI_MAG_LINEAR,
    TI_WRAP_S,
    TI_WRAP_T,
    WRAP_CLAMP,
    WRAP_REPEAT,
)
from tests.renderers.shading.scalar.memory import load_f32, load_i64, load_u8

_LARGEST = 1e9
_TI_ADDRESS, _TI_WIDTH, _TI_HEIGHT, _TI_STRIDE = range(TI_LEVEL, TI_LEVEL + 4)
AS_STORED = 0
SRGB = 1


def _byte_values() -> NDArray[np.float32]:
    stored = np.arange(256) / 255.0
    # IEC 61966-2-1, the piecewise sRGB transfer function.
    linear = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    return np.stack((stored, linear)).astype(np.float32)


LINEAR_FROM_BYTE = _byte_values()
"""(2, 256) float32: what a byte means, by colour space (``AS_STORED``, ``SRGB``). Alpha is always as stored.
Texels are converted before they are filtered, as the glTF specification asks."""


@njit(nogil=True, error_model="numpy")
def _wrapped(index: int, size: int, wrap: int) -> int:
    """The texel that an index outside 0 .. size - 1 means; ``index`` is within a few periods."""
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
def _bounded(coordinate: float, wrap: int) -> float:
    """The same place near the origin, so that it can become an integer. NaN, and what is so large that float32 has no
    fractions left for it long since, becomes 0."""
    if not (abs(coordinate) < _LARGEST):
        return 0.0
    if wrap == WRAP_CLAMP:
        return min(max(coordinate, -1.0), 2.0)
    if -1.0 <= coordinate < 3.0:
        return coordinate
    return coordinate - 2.0 * math.floor(0.5 * coordinate)  # two images: the period of MIRRORED_REPEAT


@njit(nogil=True, error_model="numpy")
def sample(integers, floats, values, space, u, v):
    """RGBA of a texture at (u, v), float32 each.

    Args:
        integers, floats: addresses of the texture's rows in the tables of ``TextureTable``.
        values: address of ``LINEAR_FROM_BYTE``.
        space: ``AS_STORED`` or ``SRGB``, for the three colour channels.
        u, v: float64 texture coordinates; texel centres are at (i + 0.5) / width, (j + 0.5) / height.
    """
    tu = load_f32(floats, 0) * u + load_f32(floats, 1) * v + load_f32(floats, 2)
    v = load_f32(floats, 3) * u + load_f32(floats, 4) * v + load_f32(floats, 5)
    u = tu
    address = load_i64(integers, _TI_ADDRESS)
    width, height = load_i64(integers, _TI_WIDTH), load_i64(integers, _TI_HEIGHT)
    wrap_s, wrap_t = load_i64(integers, TI_WRAP_S), load_i64(integers, TI_WRAP_T)
    x = _bounded(u, wrap_s) * width
    y = _bounded(v, wrap_t) * height
    if load_i64(integers, TI_MAG_LINEAR) == 0:
        i = _wrapped(math.floor(x), width, wrap_s)
        j = _wrapped(math.floor(y), height, wrap_t)
        at = (j * load_i64(integers, _TI_STRIDE) + i) * 4
        return (
            load_f32(values, space * 256 + load_u8(address, at)),
            load_f32(values, space * 256 + load_u8(address, at + 1)),
            load_f32(values, space * 256 + load_u8(address, at + 2)),
            load_f32(values, load_u8(address, at + 3)),
        )
    x -= 0.5
    y -= 0.5
    x0, y0 = math.floor(x), math.floor(y)  # integers, as in Python
    fx, fy = np.float32(x - x0), np.float32(y - y0)
    i0 = _wrapped(x0, width, wrap_s)
    i1 = _wrapped(x0 + 1, width, wrap_s)
    stride = load_i64(integers, _TI_STRIDE)
    j0 = _wrapped(y0, height, wrap_t) * stride
    j1 = _wrapped(y0 + 1, height, wrap_t) * stride
    a, b, c, d = (j0 + i0) * 4, (j0 + i1) * 4, (j1 + i0) * 4, (j1 + i1) * 4
    one = np.float32(1.0)
    wa, wb, wc, wd = (one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy
    red = (
        load_f32(values, space * 256 + load_u8(address, a)) * wa
        + load_f32(values, space * 256 + load_u8(address, b)) * wb
        + load_f32(values, space * 256 + load_u8(address, c)) * wc
        + load_f32(values, space * 256 + load_u8(address, d)) * wd
    )
    green = (
        load_f32(values, space * 256 + load_u8(address, a + 1)) * wa
        + load_f32(values, space * 256 + load_u8(address, b + 1)) * wb
        + load_f32(values, space * 256 + load_u8(address, c + 1)) * wc
        + load_f32(values, space * 256 + load_u8(address, d + 1)) * wd
    )
    blue = (
        load_f32(values, space * 256 + load_u8(address, a + 2)) * wa
        + load_f32(values, space * 256 + load_u8(address, b + 2)) * wb
        + load_f32(values, space * 256 + load_u8(address, c + 2)) * wc
        + load_f32(values, space * 256 + load_u8(address, d + 2)) * wd
    )
    alpha = (
        load_f32(values, load_u8(address, a + 3)) * wa
        + load_f32(values, load_u8(address, b + 3)) * wb
        + load_f32(values, load_u8(address, c + 3)) * wc
        + load_f32(values, load_u8(address, d + 3)) * wd
    )
    return red, green, blue, alpha
