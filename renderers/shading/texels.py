"""Texels of one mip level, eight pixels at a time: wrap modes, the nearest texel, bilinear interpolation.

The arguments ``sampler`` and ``level`` are the tuples that ``load_sampler`` and ``load_level`` return. They are loaded
into local variables, since compiled kernels would load the fields of a struct again after every store.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.shading.texture_table import WRAP_CLAMP, WRAP_MIRROR, WRAP_REPEAT

_MAX_COORDINATE: Final = np.float32(1e9)
"""Larger coordinates and NaN become 0, since float32 has no fractions of such numbers."""
_INV_255: Final = np.float32(1.0 / 255.0)


@inlined
def load_sampler(texture, linear_from_byte):
    """Return wrap_s, wrap_t, srgb (bool) and ``color.LINEAR_FROM_BYTE``."""
    return texture.wrap_s, texture.wrap_t, texture.srgb != 0, linear_from_byte


@inlined
def load_level(texture, k):
    """Return texels, width, height and stride of a mip level."""
    level = texture.levels[k]
    return level.texels, level.width, level.height, level.stride


@inlined
def _texel_position(coordinate, wrap, size):
    """Return texture coordinates in texels, f32x8.

    With ``WRAP_REPEAT`` they are 0 .. size, with ``WRAP_MIRROR`` 0 .. 2 size, with ``WRAP_CLAMP`` -size .. 2 size.

    Args:
        size: width or height of the image, texels.
    """
    coordinate = vec.select(vec.absolute(coordinate) < vec.f32(_MAX_COORDINATE), coordinate, vec.f32(0.0))
    if wrap == WRAP_REPEAT:
        coordinate = coordinate - vec.floor(coordinate)
    elif wrap == WRAP_CLAMP:
        coordinate = vec.minimum(vec.maximum(coordinate, vec.f32(-1.0)), vec.f32(2.0))
    else:
        coordinate = coordinate - vec.f32(2.0) * vec.floor(vec.f32(0.5) * coordinate)
    return coordinate * vec.f32(size)


@inlined
def _wrap(index, wrap, size):
    """Return the texels, 0 .. size - 1, at indices that differ from a ``_texel_position`` by at most 1."""
    zero, count = vec.i32(0), vec.i32(size)
    if wrap == WRAP_REPEAT:
        index = vec.select(index < zero, index + count, index)
        index = vec.select(index >= count, index - count, index)
    elif wrap == WRAP_MIRROR:
        # Index -1 mirrors to texel 0. Index 2 size is texel 0 of the next period. Both are clamped to 0 below.
        index = vec.select(index < count, index, vec.i32(2 * size - 1) - index)
    return vec.minimum(vec.maximum(index, zero), count - vec.i32(1))


@inlined
def _channels(texel, sampler):
    """Return RGB, linear 0 .. 1 with ``srgb``, else 0 .. 255; and alpha, 0 .. 255."""
    _, _, srgb, linear_from_byte = sampler
    byte = vec.i32(255)
    r, g, b = texel & byte, (texel >> vec.i32(8)) & byte, (texel >> vec.i32(16)) & byte
    alpha = vec.to_f32((texel >> vec.i32(24)) & byte)
    if srgb:
        return vec.gather(linear_from_byte, r), vec.gather(linear_from_byte, g), vec.gather(linear_from_byte, b), alpha
    return vec.to_f32(r), vec.to_f32(g), vec.to_f32(b), alpha


@inlined
def _to_unit(rgba, sampler):
    """Return the result of ``_channels`` as 0 .. 1."""
    _, _, srgb, _ = sampler
    unit = vec.f32(_INV_255)
    if srgb:
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
def nearest(level, sampler, u, v):
    """Return RGBA of the texels that contain (u, v)."""
    texels, width, height, stride = level
    wrap_s, wrap_t, _, _ = sampler
    i = _wrap(vec.to_i32(vec.floor(_texel_position(u, wrap_s, width))), wrap_s, width)
    j = _wrap(vec.to_i32(vec.floor(_texel_position(v, wrap_t, height))), wrap_t, height)
    return _to_unit(_channels(vec.gather(texels, j * vec.i32(stride) + i), sampler), sampler)


@inlined
def _gather_wrapped(level, sampler, i, j):
    """Return the texels (i, j), (i + 1, j), (i, j + 1) and (i + 1, j + 1). They may be beyond the image's border."""
    texels, width, height, stride = level
    wrap_s, wrap_t, _, _ = sampler
    one, texels_per_row = vec.i32(1), vec.i32(stride)
    left, right = _wrap(i, wrap_s, width), _wrap(i + one, wrap_s, width)
    upper, lower = _wrap(j, wrap_t, height) * texels_per_row, _wrap(j + one, wrap_t, height) * texels_per_row
    return (
        vec.gather(texels, upper + left),
        vec.gather(texels, upper + right),
        vec.gather(texels, lower + left),
        vec.gather(texels, lower + right),
    )


@inlined
def locate(level, sampler, u, v):
    """Return the arguments of ``interpolate_texels`` for the texture coordinates (u, v).

    Returns:
        Column and row of the upper left of four texels, before wrapping, and the weights of the right and of the lower
        texels.
    """
    _, width, height, _ = level
    wrap_s, wrap_t, _, _ = sampler
    half = vec.f32(0.5)
    x, y = _texel_position(u, wrap_s, width) - half, _texel_position(v, wrap_t, height) - half
    left, upper = vec.floor(x), vec.floor(y)
    return vec.to_i32(left), vec.to_i32(upper), x - left, y - upper


@inlined
def interpolate_texels(level, sampler, i, j, tx, ty):
    """Return RGBA interpolated between four texels. The last four arguments are from ``locate``."""
    texels, width, height, stride = level
    zero, last_column, last_row = vec.i32(0), vec.i32(width - 1), vec.i32(height - 1)
    if vec.movemask((i >= zero) & (j >= zero) & (i < last_column) & (j < last_row)) == 255:  # nearly always
        a, b, c, d = vec.gather_2x2(texels, j * vec.i32(stride) + i, stride)
    else:
        a, b, c, d = _gather_wrapped(level, sampler, i, j)
    a, b, c, d = _channels(a, sampler), _channels(b, sampler), _channels(c, sampler), _channels(d, sampler)
    rgba = (
        _bilinear(a[0], b[0], c[0], d[0], tx, ty),
        _bilinear(a[1], b[1], c[1], d[1], tx, ty),
        _bilinear(a[2], b[2], c[2], d[2], tx, ty),
        _bilinear(a[3], b[3], c[3], d[3], tx, ty),
    )
    return _to_unit(rgba, sampler)


@inlined
def sample_level(texture, sampler, k, linear, u, v):
    """Return RGBA of mip level ``k``; ``linear``: interpolate, else the nearest texel."""
    level = load_level(texture, k)
    if linear:
        i, j, tx, ty = locate(level, sampler, u, v)
        return interpolate_texels(level, sampler, i, j, tx, ty)
    return nearest(level, sampler, u, v)


@inlined
def select4(mask, a, b):
    return (
        vec.select(mask, a[0], b[0]),
        vec.select(mask, a[1], b[1]),
        vec.select(mask, a[2], b[2]),
        vec.select(mask, a[3], b[3]),
    )
