"""Reading a texture at eight coordinates: wrap, filter, colour space."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, i32_at, i64_at
from renderers.shading.layout import A_UV0, S_BYTE_VALUES, S_TEXTURE_FLOATS, S_TEXTURES
from renderers.shading.textures import (
    TF_COLUMNS,
    TI_ADDRESS,
    TI_COLUMNS,
    TI_HEIGHT,
    TI_LINEAR,
    TI_STRIDE,
    TI_TRANSFORMED,
    TI_UV_SET,
    TI_WIDTH,
    TI_WRAP_S,
    TI_WRAP_T,
    WRAP_CLAMP,
    WRAP_REPEAT,
)

_LARGEST: Final = np.float32(1e9)
"""Coordinates beyond this, and what is not a number, become 0: float32 has no fractions left for them long since."""
FINE_BITS: Final = 15
FINE: Final = 1 << FINE_BITS
"""Parts of a texel where places among them are integers: as many as mixing in 16 bits tells apart."""
AS_STORED: Final = 0
SRGB: Final = 1
_UNIT: Final = np.float32(1.0 / 255.0)


@inlined
def _place(coordinate, wrap, size):
    """f32x8: where a coordinate lies among ``size`` texels, within a texel of the first image, or of the first two for
    MIRRORED_REPEAT. Exact where ``size`` is a power of two."""
    coordinate = vec.select(vec.absolute(coordinate) < vec.f32(_LARGEST), coordinate, vec.f32(0.0))
    if wrap == WRAP_CLAMP:
        coordinate = vec.least(vec.most(coordinate, vec.f32(-1.0)), vec.f32(2.0))
    elif wrap == WRAP_REPEAT:
        coordinate = coordinate - vec.floor(coordinate)
    else:
        coordinate = coordinate - vec.f32(2.0) * vec.floor(vec.f32(0.5) * coordinate)
    return coordinate * vec.f32(size)


@inlined
def _wrapped(index, wrap, size):
    """i32x8: the texels 0 .. size - 1 that indices next to a ``_place`` mean."""
    zero, count = vec.i32(0), vec.i32(size)
    if wrap == WRAP_REPEAT:
        index = vec.select(index < zero, index + count, index)
        index = vec.select(index >= count, index - count, index)
    elif wrap != WRAP_CLAMP:
        index = vec.select(index < count, index, vec.i32(2 * size - 1) - index)
    return vec.least(vec.most(index, zero), count - vec.i32(1))


@inlined
def _channels(texel, space, values):
    """Four f32x8 of eight RGBA texels: 0 .. 255, the colours of ``SRGB`` linear, 0 .. 1."""
    byte, eight = vec.i32(255), vec.i32(8)
    second = texel >> eight
    third = second >> eight
    r, g, b = texel & byte, second & byte, third & byte
    alpha = vec.to_f32((third >> eight) & byte)
    if space == SRGB:
        table = f32_at(values)
        return vec.gather(table, r), vec.gather(table, g), vec.gather(table, b), alpha
    return vec.to_f32(r), vec.to_f32(g), vec.to_f32(b), alpha


@inner
def _far_apart(integers, i, j):
    """Four texels of eight places, of which some lie across the border of the image."""
    width, height = integers[TI_WIDTH], integers[TI_HEIGHT]
    wrap_s, wrap_t = integers[TI_WRAP_S], integers[TI_WRAP_T]
    one, stride, texels = vec.i32(1), vec.i32(integers[TI_STRIDE]), i32_at(integers[TI_ADDRESS])
    i0, i1 = _wrapped(i, wrap_s, width), _wrapped(i + one, wrap_s, width)
    j0, j1 = _wrapped(j, wrap_t, height) * stride, _wrapped(j + one, wrap_t, height) * stride
    return (
        vec.gather(texels, j0 + i0),
        vec.gather(texels, j0 + i1),
        vec.gather(texels, j1 + i0),
        vec.gather(texels, j1 + i1),
    )


@inlined
def nearest(integers, values, space, u, v):
    """RGBA of the texel that (u, v) lies in."""
    width, height = integers[TI_WIDTH], integers[TI_HEIGHT]
    wrap_s, wrap_t = integers[TI_WRAP_S], integers[TI_WRAP_T]
    unit = vec.f32(_UNIT)
    i = _wrapped(vec.to_i32(vec.floor(_place(u, wrap_s, width))), wrap_s, width)
    j = _wrapped(vec.to_i32(vec.floor(_place(v, wrap_t, height))), wrap_t, height)
    at = j * vec.i32(integers[TI_STRIDE]) + i
    r, g, b, alpha = _channels(vec.gather(i32_at(integers[TI_ADDRESS]), at), space, values)
    if space == SRGB:
        return r, g, b, alpha * unit
    return r * unit, g * unit, b * unit, alpha * unit


@inlined
def reduced(integers, u, v):
    """Column and row among the texels' centres, f32x8 each, of coordinates; within a texel of the first image, or of
    the first two for MIRRORED_REPEAT."""
    half = vec.f32(0.5)
    return (
        _place(u, integers[TI_WRAP_S], integers[TI_WIDTH]) - half,
        _place(v, integers[TI_WRAP_T], integers[TI_HEIGHT]) - half,
    )


@inlined
def _footprint(integers, x, y):
    """The column and row of the first of the four texels whose centres are around (x, y), how far behind its centre
    that is (0 .. 1 each), and whether all four lie side by side in the image."""
    zero, one = vec.f32(0.0), vec.i32(1)
    x0, y0 = vec.floor(x), vec.floor(y)
    width, height = vec.to_f32(vec.i32(integers[TI_WIDTH]) - one), vec.to_f32(vec.i32(integers[TI_HEIGHT]) - one)
    inside = (x0 >= zero) & (y0 >= zero) & (x0 < width) & (y0 < height)
    return vec.to_i32(x0), vec.to_i32(y0), x - x0, y - y0, inside


@inlined
def _mixed(four, space, values, fx, fy):
    """Channels between four texels, row by row, at the share ``fx`` of the second column and ``fy`` of the second row;
    scaled as ``_channels`` says."""
    gx, gy = vec.f32(1.0) - fx, vec.f32(1.0) - fy
    wa, wb, wc, wd = gx * gy, fx * gy, gx * fy, fx * fy
    ra, ga, ba, aa = _channels(four[0], space, values)
    rb, gb, bb, ab = _channels(four[1], space, values)
    rc, gc, bc, ac = _channels(four[2], space, values)
    rd, gd, bd, ad = _channels(four[3], space, values)
    return (
        ra * wa + rb * wb + rc * wc + rd * wd,
        ga * wa + gb * wb + gc * wc + gd * wd,
        ba * wa + bb * wb + bc * wc + bd * wd,
        aa * wa + ab * wb + ac * wc + ad * wd,
    )


@inlined
def bilinear(integers, values, space, u, v):
    """RGBA of the four texels whose centres are around (u, v)."""
    x, y = reduced(integers, u, v)
    i, j, fx, fy, inside = _footprint(integers, x, y)
    if vec.bits(inside) == 255:  # nearly always: neighbours are loaded together
        at = j * vec.i32(integers[TI_STRIDE]) + i
        four = vec.gather_squares(i32_at(integers[TI_ADDRESS]), at, integers[TI_STRIDE])
    else:
        four = _far_apart(integers, i, j)
    r, g, b, alpha = _mixed(four, space, values, fx, fy)
    unit = vec.f32(_UNIT)
    if space == SRGB:
        return r, g, b, alpha * unit
    return r * unit, g * unit, b * unit, alpha * unit


@inlined
def locate(integers, x, y):
    """The number of the first of the four texels around a place in parts of a texel (``FINE``), and whether the four
    do not lie side by side in the image: the number is anything where they do not."""
    bits = vec.i32(FINE_BITS)
    i, j = x >> bits, y >> bits
    right, lower = vec.i32(integers[TI_WIDTH] - 2) - i, vec.i32(integers[TI_HEIGHT] - 2) - j
    return j * vec.i32(integers[TI_STRIDE]) + i, (i | j | right | lower) < vec.i32(0)


@inlined
def parts(x):
    """What ``locate`` takes, of a column or row among the texels' centres (f32x8)."""
    return vec.to_i32(x * vec.f32(FINE))


@inlined
def coordinates_of(integers, x, y):
    """Texture coordinates of a place as ``locate`` takes it."""
    half, one, fine = vec.f32(0.5), vec.f32(1.0), vec.f32(1.0 / FINE)
    x, y = vec.to_f32(x) * fine, vec.to_f32(y) * fine
    return (x + half) * (one / vec.f32(integers[TI_WIDTH])), (y + half) * (one / vec.f32(integers[TI_HEIGHT]))


@inlined
def at_place(integers, x, y):
    """RGBA as stored, 0 .. 1, of the four texels around a place, in any of an image's repetitions."""
    u, v = coordinates_of(integers, x, y)
    return bilinear(integers, np.int64(0), AS_STORED, u, v)


@inlined
def coordinates(integers, floats, rows, at, stride):
    """Texture coordinates of eight pixels."""
    u, v = vec.load(rows, at), vec.load(rows, at + stride)
    if integers[TI_TRANSFORMED] != 0:
        return (
            vec.f32(floats[0]) * u + vec.f32(floats[1]) * v + vec.f32(floats[2]),
            vec.f32(floats[3]) * u + vec.f32(floats[4]) * v + vec.f32(floats[5]),
        )
    return u, v


@inner
def sample(job, row, space, rows, stride, begin, end, out):
    """Write RGBA of a texture at the pixels ``begin .. end`` to four rows from row ``out`` on.

    Args:
        job: S_TEXTURES, S_TEXTURE_FLOATS and S_BYTE_VALUES are read. row: the texture's row in these tables.
        space: ``AS_STORED`` or ``SRGB``, for the three colour channels.
        rows: pointer to rows of ``stride`` float32; coordinates (texel centres are at (i + 0.5) / width,
            (j + 0.5) / height) are in the rows of the texture's set.
    """
    integers = i64_at(job[S_TEXTURES] + 8 * TI_COLUMNS * row)
    floats = f32_at(job[S_TEXTURE_FLOATS] + 4 * TF_COLUMNS * row)
    values = job[S_BYTE_VALUES]
    uv = (A_UV0 + 2 * integers[TI_UV_SET]) * stride
    to = out * stride
    linear = integers[TI_LINEAR] != 0
    if space == SRGB and linear:
        for x in range(begin, end, vec.LANES):
            u, v = coordinates(integers, floats, rows, uv + x, stride)
            _put(rows, to + x, stride, bilinear(integers, values, SRGB, u, v))
    elif space == SRGB:
        for x in range(begin, end, vec.LANES):
            u, v = coordinates(integers, floats, rows, uv + x, stride)
            _put(rows, to + x, stride, nearest(integers, values, SRGB, u, v))
    elif linear:
        for x in range(begin, end, vec.LANES):
            u, v = coordinates(integers, floats, rows, uv + x, stride)
            _put(rows, to + x, stride, bilinear(integers, values, AS_STORED, u, v))
    else:
        for x in range(begin, end, vec.LANES):
            u, v = coordinates(integers, floats, rows, uv + x, stride)
            _put(rows, to + x, stride, nearest(integers, values, AS_STORED, u, v))


@inlined
def _put(rows, at, stride, rgba):
    vec.store(rows, at, rgba[0])
    vec.store(rows, at + stride, rgba[1])
    vec.store(rows, at + 2 * stride, rgba[2])
    vec.store(rows, at + 3 * stride, rgba[3])
