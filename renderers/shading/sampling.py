"""Texture sampling, eight pixels at a time: wrap modes, bilinear and trilinear filters (OpenGL 4.6, 8.14)."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at, i32_at, i64_at
from renderers.shading.layout import (
    A_GRADIENT0,
    A_UV0,
    G_PIXELS,
    S_BYTE_VALUES,
    S_TEXTURE_FLOATS,
    S_TEXTURES,
    STRIDE,
)
from renderers.shading.texture_table import (
    MIPS_NEAREST,
    MIPS_NONE,
    TF_COLUMNS,
    TI_COLUMNS,
    TI_LEVEL,
    TI_LEVELS,
    TI_MAG_LINEAR,
    TI_MIN_LINEAR,
    TI_MIPS,
    TI_SRGB,
    TI_UV_SET,
    TI_WRAP_S,
    TI_WRAP_T,
    WRAP_CLAMP,
    WRAP_MIRROR,
    WRAP_REPEAT,
)
from renderers.shading.vec3 import store3

_MAX_COORDINATE: Final = np.float32(1e9)
"""Larger coordinates and NaN become 0: float32 has no fractions left there."""
_UNIT: Final = np.float32(1.0 / 255.0)
_NO_LEVEL: Final = 1 << 20
_LARGE: Final = 1 << 17
"""Texels of an image beyond which texels are prefetched: half a megabyte, more than the second-level cache has."""


@inlined
def _texel_position(coordinate, wrap, size):
    """Coordinates in texels: within a texel of the first repetition, or of the first two for MIRRORED_REPEAT."""
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
    """Texels 0 .. size - 1 of indices next to a ``_texel_position``."""
    zero, count = vec.i32(0), vec.i32(size)
    if wrap == WRAP_REPEAT:
        index = vec.select(index < zero, index + count, index)
        index = vec.select(index >= count, index - count, index)
    elif wrap == WRAP_MIRROR:
        # Index -1 mirrors to texel 0, and index 2 size is texel 0 of the next period: clamped below.
        index = vec.select(index < count, index, vec.i32(2 * size - 1) - index)
    return vec.minimum(vec.maximum(index, zero), count - vec.i32(1))


@inlined
def _channels(texel, srgb, values):
    """RGB, linear if ``srgb``, else 0 .. 255; and alpha, 0 .. 255."""
    byte = vec.i32(255)
    r, g, b = texel & byte, (texel >> vec.i32(8)) & byte, (texel >> vec.i32(16)) & byte
    alpha = vec.to_f32((texel >> vec.i32(24)) & byte)
    if srgb:
        return vec.gather(values, r), vec.gather(values, g), vec.gather(values, b), alpha
    return vec.to_f32(r), vec.to_f32(g), vec.to_f32(b), alpha


@inlined
def _scaled(rgba, srgb):
    unit = vec.f32(_UNIT)
    if srgb:
        return rgba[0], rgba[1], rgba[2], rgba[3] * unit
    return rgba[0] * unit, rgba[1] * unit, rgba[2] * unit, rgba[3] * unit


@inlined
def _lerp(a, b, c, d, fx, fy):
    """Bilinear; exact where all four are equal."""
    above, below = a + fx * (b - a), c + fx * (d - c)
    return above + fy * (below - above)


@inlined
def _nearest(texels, stride, width, height, wrap_s, wrap_t, srgb, values, u, v):
    """RGBA of the texels that (u, v) lie in."""
    i = _wrap(vec.to_i32(vec.floor(_texel_position(u, wrap_s, width))), wrap_s, width)
    j = _wrap(vec.to_i32(vec.floor(_texel_position(v, wrap_t, height))), wrap_t, height)
    return _scaled(_channels(vec.gather(texels, j * vec.i32(stride) + i), srgb, values), srgb)


@device_function
def _gather_wrapped(texels, stride, width, height, wrap_s, wrap_t, i, j):
    """Four texels of eight positions, some of them across a border of the image."""
    one, stride = vec.i32(1), vec.i32(stride)
    i0, i1 = _wrap(i, wrap_s, width), _wrap(i + one, wrap_s, width)
    j0, j1 = _wrap(j, wrap_t, height) * stride, _wrap(j + one, wrap_t, height) * stride
    return (
        vec.gather(texels, j0 + i0),
        vec.gather(texels, j0 + i1),
        vec.gather(texels, j1 + i0),
        vec.gather(texels, j1 + i1),
    )


@inlined
def _locate(u, v, width, height, wrap_s, wrap_t):
    """Return column and row, before wrapping, of the upper left of the four texels around (u, v), and the weights of
    the right and the lower ones."""
    half = vec.f32(0.5)
    x, y = _texel_position(u, wrap_s, width) - half, _texel_position(v, wrap_t, height) - half
    x0, y0 = vec.floor(x), vec.floor(y)
    return vec.to_i32(x0), vec.to_i32(y0), x - x0, y - y0


@inlined
def _mix(texels, stride, width, height, wrap_s, wrap_t, srgb, values, i, j, fx, fy):
    """Return RGBA between four texels, from the result of ``_locate``."""
    zero, last, lowest = vec.i32(0), vec.i32(width - 1), vec.i32(height - 1)
    if vec.movemask((i >= zero) & (j >= zero) & (i < last) & (j < lowest)) == 255:  # nearly always
        a, b, c, d = vec.gather_2x2(texels, j * vec.i32(stride) + i, stride)
    else:
        a, b, c, d = _gather_wrapped(texels, stride, width, height, wrap_s, wrap_t, i, j)
    a, b = _channels(a, srgb, values), _channels(b, srgb, values)
    c, d = _channels(c, srgb, values), _channels(d, srgb, values)
    rgba = (
        _lerp(a[0], b[0], c[0], d[0], fx, fy),
        _lerp(a[1], b[1], c[1], d[1], fx, fy),
        _lerp(a[2], b[2], c[2], d[2], fx, fy),
        _lerp(a[3], b[3], c[3], d[3], fx, fy),
    )
    return _scaled(rgba, srgb)


@device_function
def _sample_level(integers, values, level, linear, u, v):
    """RGBA of one mip level."""
    texels = i32_at(integers[TI_LEVEL + 4 * level])
    width, height = integers[TI_LEVEL + 4 * level + 1], integers[TI_LEVEL + 4 * level + 2]
    stride = integers[TI_LEVEL + 4 * level + 3]
    wrap_s, wrap_t, srgb = integers[TI_WRAP_S], integers[TI_WRAP_T], integers[TI_SRGB] != 0
    if linear:
        i, j, fx, fy = _locate(u, v, width, height, wrap_s, wrap_t)
        return _mix(texels, stride, width, height, wrap_s, wrap_t, srgb, values, i, j, fx, fy)
    return _nearest(texels, stride, width, height, wrap_s, wrap_t, srgb, values, u, v)


@inlined
def _select4(mask, a, b):
    return (
        vec.select(mask, a[0], b[0]),
        vec.select(mask, a[1], b[1]),
        vec.select(mask, a[2], b[2]),
        vec.select(mask, a[3], b[3]),
    )


@inlined
def _lerp4(a, b, part):
    return (
        a[0] + part * (b[0] - a[0]),
        a[1] + part * (b[1] - a[1]),
        a[2] + part * (b[2] - a[2]),
        a[3] + part * (b[3] - a[3]),
    )


@device_function
def _sample_mipmapped(integers, values, u, v, footprint):
    """RGBA from the mip levels that the sampler selects.

    Args:
        footprint: square of the longer side of the pixel's footprint, texels of the first level.
    """
    last, mips = integers[TI_LEVELS] - 1, integers[TI_MIPS]
    mag_linear, min_linear = integers[TI_MAG_LINEAR] != 0, integers[TI_MIN_LINEAR] != 0
    # Between a linear magnifying and a nearest minifying filter, the border is at half a level.
    minified = footprint > vec.f32(2.0 if mag_linear and not min_linear and mips != MIPS_NONE else 1.0)
    if vec.movemask(minified) == 0:
        return _sample_level(integers, values, np.int64(0), mag_linear, u, v)
    zero, half = vec.f32(0.0), vec.f32(0.5)
    level, part = vec.i32(0), zero
    if mips != MIPS_NONE:
        detail = vec.minimum(_half_log2(footprint), vec.f32(last))
        if mips == MIPS_NEAREST:
            level = vec.minimum(vec.to_i32(vec.ceil(detail + half)) - vec.i32(1), vec.i32(last))
        else:
            level = vec.to_i32(detail)
            part = detail - vec.to_f32(level)
    none = vec.i32(_NO_LEVEL)
    level = vec.select(minified, level, none)
    result = zero, zero, zero, zero
    if vec.movemask(minified) != 255:
        result = _sample_level(integers, values, np.int64(0), mag_linear, u, v)
    lowest = vec.minimum_of(level)
    while lowest != _NO_LEVEL:
        here = level == vec.i32(lowest)
        found = _sample_level(integers, values, lowest, min_linear, u, v)
        if vec.movemask(here & (part > zero)) != 0:
            found = _lerp4(found, _sample_level(integers, values, min(lowest + 1, last), min_linear, u, v), part)
        result = _select4(here, found, result)
        level = vec.select(here, none, level)
        lowest = vec.minimum_of(level)
    return result


@inlined
def _divide_large(x, whole, factor, half_octaves):
    large = x >= vec.f32(factor)
    return (
        vec.select(large, x * vec.f32(1.0 / factor), x),
        vec.select(large, whole + vec.f32(half_octaves), whole),
    )


@inlined
def _half_log2(x):
    """``log2(x) / 2`` for x >= 1, within 1e-6; at least 31 from 2^63 on and for NaN.

    Divides until x < 2, then the series of artanh: the last bit of the C library's ``log`` differs between machines.
    """
    whole = vec.f32(0.0)
    x, whole = _divide_large(x, whole, 2.0**32, 16.0)
    x, whole = _divide_large(x, whole, 2.0**16, 8.0)
    x, whole = _divide_large(x, whole, 2.0**8, 4.0)
    x, whole = _divide_large(x, whole, 2.0**4, 2.0)
    x, whole = _divide_large(x, whole, 2.0**2, 1.0)
    x, whole = _divide_large(x, whole, 2.0, 0.5)
    t = (x - vec.f32(1.0)) / (x + vec.f32(1.0))
    t2 = t * t
    series = vec.f32(1.0 / 9.0) + t2 * vec.f32(1.0 / 11.0)
    series = vec.f32(0.2) + t2 * (vec.f32(1.0 / 7.0) + t2 * series)
    series = t * (vec.f32(1.0) + t2 * (vec.f32(1.0 / 3.0) + t2 * series))
    return whole + series * vec.f32(1.4426950408889634)


@inlined
def _footprint(floats, pixels, at, width, height):
    """Square of the longer side of eight pixels' footprints, texels; from the rows of gradients at ``at``."""
    a, b, d, e = vec.f32(floats[0]), vec.f32(floats[1]), vec.f32(floats[3]), vec.f32(floats[4])
    ux, vx = vec.load(pixels, at), vec.load(pixels, at + STRIDE)
    uy, vy = vec.load(pixels, at + 2 * STRIDE), vec.load(pixels, at + 3 * STRIDE)
    sx, tx = (a * ux + b * vx) * vec.f32(width), (d * ux + e * vx) * vec.f32(height)
    sy, ty = (a * uy + b * vy) * vec.f32(width), (d * uy + e * vy) * vec.f32(height)
    return vec.maximum(sx * sx + tx * tx, sy * sy + ty * ty)


@device_function
def sample(job, segment, row, begin, end, out, alpha):
    """Write a texture's RGB and, if ``alpha``, alpha, 0 .. 1, to the four rows from A_ row ``out`` on.

    Texel centres are at ((i + 0.5) / width, (j + 0.5) / height). Mip levels need the rows of gradients.

    Args:
        row: row of the texture table.
        begin, end: values of the rows.
    """
    integers = i64_at(job[S_TEXTURES] + 8 * TI_COLUMNS * row)
    floats = f32_at(job[S_TEXTURE_FLOATS] + 4 * TF_COLUMNS * row)
    values, pixels = f32_at(job[S_BYTE_VALUES]), f32_at(segment[G_PIXELS])
    coordinates = (A_UV0 + 2 * integers[TI_UV_SET]) * STRIDE
    gradients = (A_GRADIENT0 + 4 * integers[TI_UV_SET]) * STRIDE
    a, b, c = vec.f32(floats[0]), vec.f32(floats[1]), vec.f32(floats[2])
    d, e, f = vec.f32(floats[3]), vec.f32(floats[4]), vec.f32(floats[5])
    texels, width, height = i32_at(integers[TI_LEVEL]), integers[TI_LEVEL + 1], integers[TI_LEVEL + 2]
    stride = integers[TI_LEVEL + 3]
    wrap_s, wrap_t, srgb = integers[TI_WRAP_S], integers[TI_WRAP_T], integers[TI_SRGB] != 0
    linear = integers[TI_MAG_LINEAR] != 0
    mipmapped = integers[TI_MIPS] != MIPS_NONE or integers[TI_MAG_LINEAR] != integers[TI_MIN_LINEAR]
    integer_pixels, at = i32_at(segment[G_PIXELS]), out * STRIDE
    if linear and not mipmapped:
        # Two passes: a processor waits less for texels that were prefetched many pixels before they are read.
        prefetches = width * height > _LARGE
        for x in range(begin, end, vec.LANES):
            u, v = vec.load(pixels, coordinates + x), vec.load(pixels, coordinates + STRIDE + x)
            u, v = a * u + b * v + c, d * u + e * v + f
            i, j, fx, fy = _locate(u, v, width, height, wrap_s, wrap_t)
            vec.store(integer_pixels, at + x, i)
            vec.store(integer_pixels, at + STRIDE + x, j)
            vec.store(pixels, at + 2 * STRIDE + x, fx)
            vec.store(pixels, at + 3 * STRIDE + x, fy)
            if prefetches:
                vec.prefetch_pair_rows(texels, j * vec.i32(stride) + i, stride)
        for x in range(begin, end, vec.LANES):
            i, j = vec.load(integer_pixels, at + x), vec.load(integer_pixels, at + STRIDE + x)
            fx, fy = vec.load(pixels, at + 2 * STRIDE + x), vec.load(pixels, at + 3 * STRIDE + x)
            rgba = _mix(texels, stride, width, height, wrap_s, wrap_t, srgb, values, i, j, fx, fy)
            store3(pixels, at + x, STRIDE, rgba)
            if alpha:
                vec.store(pixels, at + 3 * STRIDE + x, rgba[3])
        return
    for x in range(begin, end, vec.LANES):
        u, v = vec.load(pixels, coordinates + x), vec.load(pixels, coordinates + STRIDE + x)
        u, v = a * u + b * v + c, d * u + e * v + f
        if mipmapped:
            footprint = _footprint(floats, pixels, gradients + x, width, height)
            rgba = _sample_mipmapped(integers, values, u, v, footprint)
        else:
            rgba = _nearest(texels, stride, width, height, wrap_s, wrap_t, srgb, values, u, v)
        store3(pixels, at + x, STRIDE, rgba)
        if alpha:
            vec.store(pixels, at + 3 * STRIDE + x, rgba[3])
