"""Reading textures: wrap modes, bilinear and trilinear filters (OpenGL 4.6, 8.14), colour space."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from renderers.pointers import u8_at
from renderers.studio.mips import (
    TI_LEVEL,
    TI_LEVELS,
    TI_MAG_LINEAR,
    TI_MIN_LINEAR,
    TI_MIPS,
    TI_SRGB,
    TI_WRAP_S,
    TI_WRAP_T,
)

_LARGEST: Final = 1e9


def _byte_values() -> NDArray[np.float32]:
    stored = np.arange(256) / 255.0
    linear = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    return np.concatenate((stored, linear)).astype(np.float32)


BYTE_VALUES: Final = _byte_values()
"""(512,) float32: what a byte means as stored, then as sRGB. Texels are converted before they are filtered."""


@njit(nogil=True, error_model="numpy")
def _wrapped(index, size, wrap):  # type: ignore[no-untyped-def]
    """The texel that an index outside 0 .. size - 1 means (``WRAPS``)."""
    if 0 <= index < size:
        return index
    if wrap == 0:
        return index % size
    if wrap == 1:
        return min(max(index, 0), size - 1)
    index = index % (2 * size)
    return index if index < size else 2 * size - 1 - index


@njit(nogil=True, error_model="numpy")
def _near(coordinate, wrap):  # type: ignore[no-untyped-def]
    """The same place near the origin, so that it can become an integer; 0 for what is no number or has no fractions."""
    if not (abs(coordinate) < _LARGEST):
        return 0.0
    if wrap == 1:
        return min(max(coordinate, -1.0), 2.0)
    return coordinate - 2.0 * math.floor(0.5 * coordinate)


@njit(nogil=True, error_model="numpy")
def _level(integers, values, level, linear, u, v):  # type: ignore[no-untyped-def]
    """RGBA of one level."""
    texels, width = u8_at(integers[TI_LEVEL + 3 * level]), integers[TI_LEVEL + 3 * level + 1]
    height = integers[TI_LEVEL + 3 * level + 2]
    wrap_s, wrap_t, space = integers[TI_WRAP_S], integers[TI_WRAP_T], 256 * integers[TI_SRGB]
    x, y = u * width, v * height
    if not linear:
        at = 4 * (_wrapped(math.floor(y), height, wrap_t) * width + _wrapped(math.floor(x), width, wrap_s))
        return (
            np.float64(values[space + texels[at + 0]]),
            np.float64(values[space + texels[at + 1]]),
            np.float64(values[space + texels[at + 2]]),
            np.float64(values[texels[at + 3]]),
        )
    x -= 0.5
    y -= 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    i, j = int(x0), int(y0)
    i0, i1 = _wrapped(i, width, wrap_s), _wrapped(i + 1, width, wrap_s)
    j0, j1 = _wrapped(j, height, wrap_t) * width, _wrapped(j + 1, height, wrap_t) * width
    a, b, c, d = 4 * (j0 + i0), 4 * (j0 + i1), 4 * (j1 + i0), 4 * (j1 + i1)
    wb, wc, wd = fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy
    wa = (1.0 - fx) * (1.0 - fy)
    return (
        _four(values, texels, space, a, b, c, d, wa, wb, wc, wd),
        _four(values, texels, space, a + 1, b + 1, c + 1, d + 1, wa, wb, wc, wd),
        _four(values, texels, space, a + 2, b + 2, c + 2, d + 2, wa, wb, wc, wd),
        _four(values, texels, 0, a + 3, b + 3, c + 3, d + 3, wa, wb, wc, wd),
    )


@njit(nogil=True, error_model="numpy")
def _four(values, texels, space, a, b, c, d, wa, wb, wc, wd):  # type: ignore[no-untyped-def]
    """One channel between four texels."""
    return (
        values[space + texels[a]] * wa
        + values[space + texels[b]] * wb
        + values[space + texels[c]] * wc
        + values[space + texels[d]] * wd
    )


@njit(nogil=True, error_model="numpy")
def sample(integers, floats, values, u, v, ux, vx, uy, vy):  # type: ignore[no-untyped-def]
    """RGBA of a texture, float64 each.

    Args:
        integers, floats: pointers to the texture's rows in the tables of ``MipTable``; values: to ``BYTE_VALUES``.
        u, v: texture coordinates; texel centres are at (i + 0.5) / width, (j + 0.5) / height.
        ux, vx, uy, vy: their derivatives by the pixel's column and row.
    """
    a, b, d, e = floats[0], floats[1], floats[3], floats[4]
    u, v = a * u + b * v + floats[2], d * u + e * v + floats[5]
    u, v = _near(u, integers[TI_WRAP_S]), _near(v, integers[TI_WRAP_T])
    width, height = integers[TI_LEVEL + 1], integers[TI_LEVEL + 2]
    sx, tx = (a * ux + b * vx) * width, (d * ux + e * vx) * height
    sy, ty = (a * uy + b * vy) * width, (d * uy + e * vy) * height
    # Level of detail: log2 of the longer side of the pixel's footprint in texels.
    footprint = max(sx * sx + tx * tx, sy * sy + ty * ty)
    mips = integers[TI_MIPS]
    # Where a magnifying linear filter meets a minifying one that is not, the border lies at half a level.
    border = 2.0 if integers[TI_MAG_LINEAR] != 0 and integers[TI_MIN_LINEAR] == 0 and mips != 0 else 1.0
    if not (footprint > border):
        return _level(integers, values, 0, integers[TI_MAG_LINEAR] != 0, u, v)
    linear = integers[TI_MIN_LINEAR] != 0
    last = integers[TI_LEVELS] - 1
    if mips == 0 or last == 0:
        return _level(integers, values, 0, linear, u, v)
    detail = min(_half_log2(footprint), np.float64(last))
    if mips == 1:
        return _level(integers, values, min(math.ceil(detail + 0.5) - 1, last), linear, u, v)
    low = int(detail)
    part = detail - low
    r, g, blue, alpha = _level(integers, values, low, linear, u, v)
    if part > 0.0:
        r1, g1, b1, a1 = _level(integers, values, low + 1, linear, u, v)
        r, g, blue, alpha = (
            r + part * (r1 - r),
            g + part * (g1 - g),
            blue + part * (b1 - blue),
            alpha + part * (a1 - alpha),
        )
    return r, g, blue, alpha


@njit(nogil=True, error_model="numpy")
def _half_log2(x):  # type: ignore[no-untyped-def]
    """``log2(x) / 2`` for x >= 1, within 1e-6: halves until x < 2, then the series of artanh. No ``log`` of the C
    library, whose last bit is not the same everywhere."""
    whole = 0.0
    while x >= 65536.0 and whole < 512.0:
        x *= 1.0 / 65536.0
        whole += 8.0
    while x >= 2.0 and whole < 512.0:
        x *= 0.5
        whole += 0.5
    t = (x - 1.0) / (x + 1.0)
    t2 = t * t
    series = t * (1.0 + t2 * (1.0 / 3.0 + t2 * (0.2 + t2 * (1.0 / 7.0 + t2 * (1.0 / 9.0 + t2 / 11.0)))))
    return whole + series * 1.4426950408889634
