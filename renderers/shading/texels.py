"""Texels of mip levels, eight pixels at a time: wrap modes and bilinear interpolation.

Each pixel reads two pairs of neighbouring texels, ``locate`` stores where they are, ``read_texels`` interpolates
between them. In loops of their own, a processor overlaps the loads of many pixels::

    upper offset ->  [a b]       a + tx (b - a)
                                                > + ty (..)
    lower offset ->  [c d]       c + tx (d - c)
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.shading.layout import STRIDE
from renderers.shading.texture_table import WRAP_CLAMP, WRAP_MIRROR, WRAP_REPEAT
from renderers.shading.textures import MAX_CONFLICT_PADDING

_MAX_COORDINATE: Final = np.float32(1e9)
"""Larger coordinates and NaN become 0, since float32 has no fractions of such numbers."""
_INV_255: Final = np.float32(1.0 / 255.0)


class MipLevels(NamedTuple):
    """Fields of a TEXTURE that sampling reads, as local variables: kernels would load a struct's fields again after
    every store."""

    texels: Any
    offsets: Any
    last: Any
    width: Any
    height: Any
    wrap_s: Any
    wrap_t: Any
    srgb: Any
    """True: colour channels are decoded by ``linear_from_byte``."""
    linear_from_byte: Any
    """``color.LINEAR_FROM_BYTE``."""


@inlined
def load_levels(texture, linear_from_byte):
    """Return the MipLevels of a TEXTURE."""
    return MipLevels(
        texels=texture.texels,
        offsets=texture.level_offsets,
        last=texture.last_level,
        width=texture.width,
        height=texture.height,
        wrap_s=texture.wrap_s,
        wrap_t=texture.wrap_t,
        srgb=texture.srgb != 0,
        linear_from_byte=linear_from_byte,
    )


@inlined
def level_size(size, level):
    """Return width or height of mip levels, i32x8. ``size``: that of the first level; ``level``: i32x8."""
    return vec.maximum(vec.i32(size) >> level, vec.i32(1))


@inlined
def _row_stride(width):
    """``textures.row_stride`` of i32x8."""
    return width + vec.i32(1) + vec.minimum(width >> vec.i32(6), vec.i32(MAX_CONFLICT_PADDING))


@inlined
def _texel_position(coordinate, wrap, size):
    """Return texture coordinates in texels, f32x8.

    With ``WRAP_REPEAT`` they are 0 .. size, with ``WRAP_MIRROR`` 0 .. 2 size, with ``WRAP_CLAMP`` -size .. 2 size.

    Args:
        size: i32x8, width or height of the mip level.
    """
    coordinate = vec.select(vec.absolute(coordinate) < vec.f32(_MAX_COORDINATE), coordinate, vec.f32(0.0))
    if wrap == WRAP_REPEAT:
        coordinate = coordinate - vec.floor(coordinate)
    elif wrap == WRAP_CLAMP:
        coordinate = vec.minimum(vec.maximum(coordinate, vec.f32(-1.0)), vec.f32(2.0))
    else:
        coordinate = coordinate - vec.f32(2.0) * vec.floor(vec.f32(0.5) * coordinate)
    return coordinate * vec.to_f32(size)


@inlined
def _wrapped(index, wrap, size):
    """Return the texels, 0 .. size - 1, at indices that differ from a ``_texel_position`` by at most 1."""
    zero = vec.i32(0)
    if wrap == WRAP_REPEAT:
        index = vec.select(index < zero, index + size, index)
        index = vec.select(index >= size, index - size, index)
    elif wrap == WRAP_MIRROR:
        # Index -1 mirrors to texel 0. Index 2 size is texel 0 of the next period. Both are clamped to 0 below.
        index = vec.select(index < size, index, size + size - vec.i32(1) - index)
    return vec.minimum(vec.maximum(index, zero), size - vec.i32(1))


@inlined
def _wrapped_pair(index, weight, wrap, size):
    """Return the left of two neighbouring texels, and the weight of the right one, given those before wrapping."""
    zero, last = vec.i32(0), size - vec.i32(1)
    if wrap != WRAP_REPEAT:
        if wrap == WRAP_MIRROR:
            is_mirrored = index >= size
            index = vec.select(is_mirrored, last + last - index, index)
            weight = vec.select(is_mirrored, vec.f32(1.0) - weight, weight)
        # Beyond the border, both texels are that of the border.
        weight = vec.select((index >= zero) & (index < last), weight, vec.f32(0.0))
    return _wrapped(index, WRAP_REPEAT if wrap == WRAP_REPEAT else WRAP_CLAMP, size), weight


@inlined
def locate(levels, pixels, x, level, half, u, v):
    """Store ``texel_offsets`` and ``texel_weights`` of the pixels x .. x + 7.

    Args:
        level: i32x8, mip levels.
        half: f32x8, 0.5: interpolate between the four nearest texels; 0: read the texel that contains (u, v).
        u, v: f32x8, texture coordinates.
    """
    width, height, first_texel = vec.i32(levels.width), vec.i32(levels.height), vec.i32(0)
    if levels.last > 0:
        width, height = level_size(levels.width, level), level_size(levels.height, level)
        first_texel = vec.gather(levels.offsets, level)
    column = _texel_position(u, levels.wrap_s, width) - half
    row = _texel_position(v, levels.wrap_t, height) - half
    left, upper = vec.floor(column), vec.floor(row)
    i, j = vec.to_i32(left), vec.to_i32(upper)
    zero, is_linear = vec.f32(0.0), half > vec.f32(0.0)
    i, tx = _wrapped_pair(i, vec.select(is_linear, column - left, zero), levels.wrap_s, width)
    stride = _row_stride(width)
    first = first_texel + i
    vec.store(pixels.texel_offsets, x, first + _wrapped(j, levels.wrap_t, height) * stride)
    vec.store(pixels.texel_offsets, STRIDE + x, first + _wrapped(j + vec.i32(1), levels.wrap_t, height) * stride)
    vec.store(pixels.texel_weights, x, tx)
    vec.store(pixels.texel_weights, STRIDE + x, vec.select(is_linear, row - upper, zero))


@inlined
def _channels(texel, levels):
    """Return RGB, linear 0 .. 1 with ``srgb``, else 0 .. 255; and alpha, 0 .. 255."""
    byte = vec.i32(255)
    r, g, b = texel & byte, (texel >> vec.i32(8)) & byte, (texel >> vec.i32(16)) & byte
    alpha = vec.to_f32((texel >> vec.i32(24)) & byte)
    if levels.srgb:
        linear_from_byte = levels.linear_from_byte
        return vec.gather(linear_from_byte, r), vec.gather(linear_from_byte, g), vec.gather(linear_from_byte, b), alpha
    return vec.to_f32(r), vec.to_f32(g), vec.to_f32(b), alpha


@inlined
def _to_unit(rgba, levels):
    """Return the result of ``_channels`` as 0 .. 1."""
    unit = vec.f32(_INV_255)
    if levels.srgb:
        return rgba[0], rgba[1], rgba[2], rgba[3] * unit
    return rgba[0] * unit, rgba[1] * unit, rgba[2] * unit, rgba[3] * unit


@inlined
def _bilinear(a, b, c, d, tx, ty):
    """Interpolate between four values: a and b above c and d. The result is exact if all are equal.

    Args:
        tx, ty: weights of the right and of the lower values.
    """
    upper, lower = a + tx * (b - a), c + tx * (d - c)
    return upper + ty * (lower - upper)


@inlined
def read_texels(levels, pixels, x):
    """Return RGBA, 0 .. 1, of the pixels x .. x + 7 from the texels that ``locate`` has stored."""
    tx, ty = vec.load(pixels.texel_weights, x), vec.load(pixels.texel_weights, STRIDE + x)
    a, b = vec.load_pairs(levels.texels, pixels.texel_offsets, x)
    c, d = vec.load_pairs(levels.texels, pixels.texel_offsets, STRIDE + x)
    a, b, c, d = _channels(a, levels), _channels(b, levels), _channels(c, levels), _channels(d, levels)
    rgba = (
        _bilinear(a[0], b[0], c[0], d[0], tx, ty),
        _bilinear(a[1], b[1], c[1], d[1], tx, ty),
        _bilinear(a[2], b[2], c[2], d[2], tx, ty),
        _bilinear(a[3], b[3], c[3], d[3], tx, ty),
    )
    return _to_unit(rgba, levels)
