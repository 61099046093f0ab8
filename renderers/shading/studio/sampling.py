"""Reading textures, eight pixels at a time: wrap modes, bilinear and trilinear filters (OpenGL 4.6, 8.14), colour
space."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import i32_at
from renderers.shading.studio.mipmaps import (
    TI_LEVEL,
    TI_LEVELS,
    TI_MAG_LINEAR,
    TI_MIN_LINEAR,
    TI_MIPS,
    TI_SRGB,
    TI_WRAP_S,
    TI_WRAP_T,
)

_LARGEST: Final = np.float32(1e9)
_UNIT: Final = np.float32(1.0 / 255.0)
_NO_LEVEL: Final = 1 << 20


@inlined
def _place(coordinate, wrap, size):
    """Where coordinates lie among ``size`` texels, within a texel of the first image, or of the first two for
    MIRRORED_REPEAT; 0 for what is no number or has no fractions."""
    coordinate = vec.select(vec.absolute(coordinate) < vec.f32(_LARGEST), coordinate, vec.f32(0.0))
    if wrap == 0:
        coordinate = coordinate - vec.floor(coordinate)
    elif wrap == 1:
        coordinate = vec.least(vec.most(coordinate, vec.f32(-1.0)), vec.f32(2.0))
    else:
        coordinate = coordinate - vec.f32(2.0) * vec.floor(vec.f32(0.5) * coordinate)
    return coordinate * vec.f32(size)


@inlined
def _wrapped(index, wrap, size):
    """The texels 0 .. size - 1 that indices next to a ``_place`` mean (``WRAPS``)."""
    zero, count = vec.i32(0), vec.i32(size)
    if wrap == 0:
        index = vec.select(index < zero, index + count, index)
        index = vec.select(index >= count, index - count, index)
    elif wrap == 2:
        # One below 0 is the first image mirrored, one beyond the second is the first again: both the texel 0.
        index = vec.select(index < count, index, vec.i32(2 * size - 1) - index)
    return vec.least(vec.most(index, zero), count - vec.i32(1))


@inlined
def _alpha(texel):
    return vec.to_f32((texel >> vec.i32(24)) & vec.i32(255))


@inlined
def _colors(texel, decoded, values):
    """Linear if ``decoded``, else 0 .. 255."""
    byte = vec.i32(255)
    r, g, b = texel & byte, (texel >> vec.i32(8)) & byte, (texel >> vec.i32(16)) & byte
    if decoded:
        return vec.gather(values, r), vec.gather(values, g), vec.gather(values, b)
    return vec.to_f32(r), vec.to_f32(g), vec.to_f32(b)


@inlined
def _between(a, b, c, d, fx, fy):
    """Bilinear; exact where all four are equal."""
    above, below = a + fx * (b - a), c + fx * (d - c)
    return above + fy * (below - above)


@inner
def _level(integers, values, level, linear, u, v):
    """RGBA of one level."""
    address, width = integers[TI_LEVEL + 3 * level], integers[TI_LEVEL + 3 * level + 1]
    height = integers[TI_LEVEL + 3 * level + 2]
    wrap_s, wrap_t, decoded = integers[TI_WRAP_S], integers[TI_WRAP_T], integers[TI_SRGB] != 0
    x, y = _place(u, wrap_s, width), _place(v, wrap_t, height)
    unit, line = vec.f32(_UNIT), vec.i32(width)
    texels = i32_at(address)
    if not linear:
        i = _wrapped(vec.to_i32(vec.floor(x)), wrap_s, width)
        at = _wrapped(vec.to_i32(vec.floor(y)), wrap_t, height) * line + i
        texel = vec.gather(texels, at)
        alpha = _alpha(texel) * unit
        if decoded:
            unit = vec.f32(1.0)
        r, g, b = _colors(texel, decoded, values)
        return r * unit, g * unit, b * unit, alpha
    half, one = vec.f32(0.5), vec.i32(1)
    x, y = x - half, y - half
    x0, y0 = vec.floor(x), vec.floor(y)
    fx, fy = x - x0, y - y0
    i, j = vec.to_i32(x0), vec.to_i32(y0)
    i0, i1 = _wrapped(i, wrap_s, width), _wrapped(i + one, wrap_s, width)
    j0, j1 = _wrapped(j, wrap_t, height) * line, _wrapped(j + one, wrap_t, height) * line
    a, b, c, d = j0 + i0, j0 + i1, j1 + i0, j1 + i1
    if vec.bits(i1 == i0 + one) == 255:  # nearly always: neighbours are loaded together
        ta, tb = vec.gather_pairs(texels, a)
        tc, td = vec.gather_pairs(texels, c)
    else:
        ta, tb, tc, td = vec.gather(texels, a), vec.gather(texels, b), vec.gather(texels, c), vec.gather(texels, d)
    alpha = _between(_alpha(ta), _alpha(tb), _alpha(tc), _alpha(td), fx, fy) * unit
    if decoded:
        unit = vec.f32(1.0)
    ar, ag, ab = _colors(ta, decoded, values)
    br, bg, bb = _colors(tb, decoded, values)
    cr, cg, cb = _colors(tc, decoded, values)
    dr, dg, db = _colors(td, decoded, values)
    return (
        _between(ar, br, cr, dr, fx, fy) * unit,
        _between(ag, bg, cg, dg, fx, fy) * unit,
        _between(ab, bb, cb, db, fx, fy) * unit,
        alpha,
    )


@inlined
def _chosen(mask, a, b):
    return (
        vec.select(mask, a[0], b[0]),
        vec.select(mask, a[1], b[1]),
        vec.select(mask, a[2], b[2]),
        vec.select(mask, a[3], b[3]),
    )


@inlined
def _faded(a, b, part):
    return (
        a[0] + part * (b[0] - a[0]),
        a[1] + part * (b[1] - a[1]),
        a[2] + part * (b[2] - a[2]),
        a[3] + part * (b[3] - a[3]),
    )


@inner
def sample(integers, floats, values, u, v, ux, vx, uy, vy):
    """RGBA of a texture, four f32x8.

    Args:
        integers, floats: pointers to the texture's rows in the tables of ``MipTable``; values: to ``BYTE_VALUES``.
        u, v: texture coordinates; texel centres are at (i + 0.5) / width, (j + 0.5) / height.
        ux, vx, uy, vy: their derivatives by the pixel's column and row.
    """
    a, b, c = vec.f32(floats[0]), vec.f32(floats[1]), vec.f32(floats[2])
    d, e, f = vec.f32(floats[3]), vec.f32(floats[4]), vec.f32(floats[5])
    u, v = a * u + b * v + c, d * u + e * v + f
    last, mips = integers[TI_LEVELS] - 1, integers[TI_MIPS]
    large, small = integers[TI_MAG_LINEAR] != 0, integers[TI_MIN_LINEAR] != 0
    if last == 0:
        mips = np.int64(0)
    if mips == 0 and large == small:
        return _level(integers, values, np.int64(0), large, u, v)
    width, height = vec.f32(integers[TI_LEVEL + 1]), vec.f32(integers[TI_LEVEL + 2])
    sx, tx = (a * ux + b * vx) * width, (d * ux + e * vx) * height
    sy, ty = (a * uy + b * vy) * width, (d * uy + e * vy) * height
    # Level of detail: log2 of the longer side of the pixel's footprint in texels.
    footprint = vec.most(sx * sx + tx * tx, sy * sy + ty * ty)
    # Where a magnifying linear filter meets a minifying one that is not, the border lies at half a level.
    shrunk = footprint > vec.f32(2.0 if large and not small and mips != 0 else 1.0)
    if vec.bits(shrunk) == 0:
        return _level(integers, values, np.int64(0), large, u, v)
    zero, half = vec.f32(0.0), vec.f32(0.5)
    level, part = vec.i32(0), zero
    if mips != 0:
        detail = vec.least(_half_log2(footprint), vec.f32(last))
        if mips == 1:
            level = vec.least(vec.to_i32(vec.ceil(detail + half)) - vec.i32(1), vec.i32(last))
        else:
            level = vec.to_i32(detail)
            part = detail - vec.to_f32(level)
    none = vec.i32(_NO_LEVEL)
    level = vec.select(shrunk, level, none)
    result = zero, zero, zero, zero
    if vec.bits(shrunk) != 255:
        result = _level(integers, values, np.int64(0), large, u, v)
    lowest = vec.least_of(level)
    while lowest != _NO_LEVEL:
        here = level == vec.i32(lowest)
        found = _level(integers, values, lowest, small, u, v)
        if vec.bits(here & (part > zero)) != 0:
            found = _faded(found, _level(integers, values, min(lowest + 1, last), small, u, v), part)
        result = _chosen(here, found, result)
        level = vec.select(here, none, level)
        lowest = vec.least_of(level)
    return result


@inlined
def _reduced(x, whole, factor, half_octaves):
    large = x >= vec.f32(factor)
    return (
        vec.select(large, x * vec.f32(1.0 / factor), x),
        vec.select(large, whole + vec.f32(half_octaves), whole),
    )


@inlined
def _half_log2(x):
    """``log2(x) / 2`` for x >= 1, within 1e-6: divides until x < 2, then the series of artanh. No ``log`` of the C
    library, whose last bit is not the same everywhere. 31 at least from 2^63 on, or not a number."""
    whole = vec.f32(0.0)
    x, whole = _reduced(x, whole, 2.0**32, 16.0)
    x, whole = _reduced(x, whole, 2.0**16, 8.0)
    x, whole = _reduced(x, whole, 2.0**8, 4.0)
    x, whole = _reduced(x, whole, 2.0**4, 2.0)
    x, whole = _reduced(x, whole, 2.0**2, 1.0)
    x, whole = _reduced(x, whole, 2.0, 0.5)
    t = (x - vec.f32(1.0)) / (x + vec.f32(1.0))
    t2 = t * t
    series = vec.f32(1.0 / 9.0) + t2 * vec.f32(1.0 / 11.0)
    series = vec.f32(0.2) + t2 * (vec.f32(1.0 / 7.0) + t2 * series)
    series = t * (vec.f32(1.0) + t2 * (vec.f32(1.0 / 3.0) + t2 * series))
    return whole + series * vec.f32(1.4426950408889634)
