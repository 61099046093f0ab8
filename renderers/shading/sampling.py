"""Texture sampling, eight pixels at a time: wrap modes, bilinear and trilinear filters (OpenGL 4.6, 8.14).

With SHADING_JOB's ``area_filter``, textures are averaged over each pixel's footprint instead.

The arguments ``sampler``, ``level`` and ``uv_transform`` are the tuples that ``_load_sampler``, ``_load_level`` and
``_load_uv_transform`` return. They are loaded into local variables, since compiled kernels would load the fields of a
struct again after every store.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import address, as_i32, f32_at
from renderers.shading.layout import STRIDE
from renderers.shading.texture_table import MIPS_NEAREST, MIPS_NONE, WRAP_CLAMP, WRAP_MIRROR, WRAP_REPEAT
from renderers.shading.vec3 import store3

_MAX_COORDINATE: Final = np.float32(1e9)
"""Larger coordinates and NaN become 0, since float32 has no fractions of such numbers."""
_INV_255: Final = np.float32(1.0 / 255.0)
_NO_LEVEL: Final = 1 << 20
"""Greater than every index of a mip level."""
_MAX_SAMPLES: Final = 12
"""Maximum number of samples in a pixel's footprint. More would cover finer mip levels, which makes edges sharper."""
_MAX_SAMPLES_PER_AXIS: Final = 8
"""Maximum number of samples along one side of a footprint: the highest anisotropy that is filtered without blur."""
_SAMPLE_SPACING: Final = 1.3
"""Maximum distance of samples, texels. Each covers two texels with a tent, so their sum has small ripples."""
_NEAREST_SAMPLES: Final = 3
"""Minimum number of samples per axis of textures whose filter is the nearest texel."""
_MIN_PREFETCHED_TEXELS: Final = 1 << 17
"""Number of texels from which an image is prefetched: half a megabyte, more than a second-level cache holds."""


@inlined
def _load_sampler(texture, linear_from_byte):
    """Return wrap_s, wrap_t, srgb (bool) and ``color.LINEAR_FROM_BYTE``."""
    return texture.wrap_s, texture.wrap_t, texture.srgb != 0, linear_from_byte


@inlined
def _load_level(texture, k):
    """Return texels, width, height and stride of a mip level."""
    level = texture.levels[k]
    return level.texels, level.width, level.height, level.stride


@inlined
def _load_uv_transform(texture):
    """Return the six values of a TEXTURE's uv_transform, f32x8 each."""
    m = texture.uv_transform
    return vec.f32(m[0]), vec.f32(m[1]), vec.f32(m[2]), vec.f32(m[3]), vec.f32(m[4]), vec.f32(m[5])


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
def _nearest(level, sampler, u, v):
    """Return RGBA of the texels that contain (u, v)."""
    texels, width, height, stride = level
    wrap_s, wrap_t, _, _ = sampler
    i = _wrap(vec.to_i32(vec.floor(_texel_position(u, wrap_s, width))), wrap_s, width)
    j = _wrap(vec.to_i32(vec.floor(_texel_position(v, wrap_t, height))), wrap_t, height)
    return _to_unit(_channels(vec.gather(texels, j * vec.i32(stride) + i), sampler), sampler)


@device_function
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
def _locate(level, sampler, u, v):
    """Return the arguments of ``_interpolate`` for the texture coordinates (u, v).

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
def _interpolate(level, sampler, i, j, tx, ty):
    """Return RGBA interpolated between four texels. The last four arguments are from ``_locate``."""
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


@device_function
def _sample_level(texture, sampler, k, linear, u, v):
    """Return RGBA of mip level ``k``; ``linear``: interpolate, else the nearest texel."""
    level = _load_level(texture, k)
    if linear:
        i, j, tx, ty = _locate(level, sampler, u, v)
        return _interpolate(level, sampler, i, j, tx, ty)
    return _nearest(level, sampler, u, v)


@inlined
def _select4(mask, a, b):
    return (
        vec.select(mask, a[0], b[0]),
        vec.select(mask, a[1], b[1]),
        vec.select(mask, a[2], b[2]),
        vec.select(mask, a[3], b[3]),
    )


@inlined
def _lerp4(a, b, t):
    return (
        a[0] + t * (b[0] - a[0]),
        a[1] + t * (b[1] - a[1]),
        a[2] + t * (b[2] - a[2]),
        a[3] + t * (b[3] - a[3]),
    )


@device_function
def _sample_between(texture, sampler, k, t, u, v):
    """Return RGBA of a minified texture, interpolated between the mip levels ``k`` and ``k + 1``.

    Args:
        t: f32x8, weight of level ``k + 1``.
    """
    min_linear = texture.min_linear != 0
    rgba = _sample_level(texture, sampler, k, min_linear, u, v)
    if vec.movemask(t > vec.f32(0.0)) != 0:
        next_level = min(k + 1, texture.level_count - 1)
        rgba = _lerp4(rgba, _sample_level(texture, sampler, next_level, min_linear, u, v), t)
    return rgba


@inlined
def _mip_levels(texture, footprint):
    """Return the mip levels that the texture's sampler selects for eight pixels.

    Args:
        footprint: square of the longer side of the pixel's footprint, texels of the first level.

    Returns:
        i32x8, ``_NO_LEVEL`` for magnified pixels; f32x8, weight of the next level.
    """
    last, mips = texture.level_count - 1, texture.mips
    # With a linear magnifying and a nearest minifying filter, minification begins at half a level (OpenGL 4.6, 8.14).
    begins_late = texture.mag_linear != 0 and texture.min_linear == 0 and mips != MIPS_NONE
    is_minified = footprint > vec.f32(2.0 if begins_late else 1.0)
    zero = vec.f32(0.0)
    levels, t = vec.i32(0), zero
    if mips != MIPS_NONE:
        detail = vec.minimum(_half_log2(footprint), vec.f32(last))
        if mips == MIPS_NEAREST:
            levels = vec.minimum(vec.to_i32(vec.ceil(detail + vec.f32(0.5))) - vec.i32(1), vec.i32(last))
        else:
            levels = vec.to_i32(detail)
            t = detail - vec.to_f32(levels)
    return vec.select(is_minified, levels, vec.i32(_NO_LEVEL)), vec.select(is_minified, t, zero)


@device_function
def _sample_mipmapped(texture, sampler, u, v, levels, t):
    """Return RGBA from mip levels; ``levels`` and ``t`` are from ``_mip_levels``."""
    no_level = vec.i32(_NO_LEVEL)
    k = vec.minimum_of(levels)
    if k == _NO_LEVEL:
        return _sample_level(texture, sampler, np.int64(0), texture.mag_linear != 0, u, v)
    if vec.movemask(levels == vec.i32(k)) == 255:  # nearly always
        return _sample_between(texture, sampler, k, t, u, v)
    zero = vec.f32(0.0)
    rgba = zero, zero, zero, zero
    if vec.movemask(levels == no_level) != 0:
        rgba = _sample_level(texture, sampler, np.int64(0), texture.mag_linear != 0, u, v)
    while k != _NO_LEVEL:
        is_level = levels == vec.i32(k)
        rgba = _select4(is_level, _sample_between(texture, sampler, k, t, u, v), rgba)
        levels = vec.select(is_level, no_level, levels)
        k = vec.minimum_of(levels)
    return rgba


@inlined
def _half_log2(x):
    """Return ``log2(x) / 2`` for x >= 1, within 1e-6; 64 or more for infinity and NaN.

    The sum of the exponent and, for the fraction, the series of artanh. The C library's ``log`` is not used, since its
    last bit differs between machines.
    """
    bits = vec.float_bits(x)
    exponent = vec.to_f32((bits >> vec.i32(23)) - vec.i32(127))
    fraction = vec.to_f32(bits & vec.i32(0x7FFFFF)) * vec.f32(1.0 / (1 << 23))
    t = fraction / (fraction + vec.f32(2.0))
    t2 = t * t
    series = vec.f32(1.0 / 9.0) + t2 * vec.f32(1.0 / 11.0)
    series = vec.f32(0.2) + t2 * (vec.f32(1.0 / 7.0) + t2 * series)
    series = t * (vec.f32(1.0) + t2 * (vec.f32(1.0 / 3.0) + t2 * series))
    return vec.f32(0.5) * exponent + series * vec.f32(1.4426950408889634)


@inlined
def _transformed_gradient(uv_transform, uv_gradient, x):
    """Return the sides of eight pixels' footprints as texture coordinates: du/dx, dv/dx, du/dy, dv/dy.

    Args:
        uv_gradient: pointer to the four rows of PIXELS for the texture's set of coordinates.
    """
    a, b, _, d, e, _ = uv_transform
    du_dx, dv_dx = vec.load(uv_gradient, x), vec.load(uv_gradient, x + STRIDE)
    du_dy, dv_dy = vec.load(uv_gradient, x + 2 * STRIDE), vec.load(uv_gradient, x + 3 * STRIDE)
    return a * du_dx + b * dv_dx, d * du_dx + e * dv_dx, a * du_dy + b * dv_dy, d * du_dy + e * dv_dy


@inlined
def _squared_sides(gradient, width, height):
    """Return the squares of both sides of eight pixels' footprints, texels of a level of this size."""
    du_dx, dv_dx, du_dy, dv_dy = gradient
    ds_dx, dt_dx = du_dx * vec.f32(width), dv_dx * vec.f32(height)
    ds_dy, dt_dy = du_dy * vec.f32(width), dv_dy * vec.f32(height)
    return ds_dx * ds_dx + dt_dx * dt_dx, ds_dy * ds_dy + dt_dy * dt_dy


@inlined
def _footprint(uv_transform, uv_gradient, x, width, height):
    """Return the square of the longer side of eight pixels' footprints, in texels of the first level."""
    across, down = _squared_sides(_transformed_gradient(uv_transform, uv_gradient, x), width, height)
    return vec.maximum(across, down)


@inlined
def _samples_along(squared_side):
    """Return the number of samples at most ``_SAMPLE_SPACING`` apart, f32x8, up to one more than the permitted one."""
    most = (_MAX_SAMPLES_PER_AXIS + 1) * _SAMPLE_SPACING
    side = vec.sqrt(vec.minimum(vec.maximum(squared_side, vec.f32(0.0)), vec.f32(most * most)))
    return vec.maximum(vec.ceil(side * vec.f32(1.0 / _SAMPLE_SPACING)), vec.f32(1.0))


@inlined
def _area_grids(texture, gradient):
    """Return the samples for the footprints of eight pixels, i32x8: mip level, columns and rows, 4 bits each but the
    first.

    The level is the finest one whose texels the permitted number of samples covers. It depends on the pixel only, so
    that an image does not depend on which pixels are sampled together.
    """
    fewest = vec.f32(1.0 if texture.mag_linear != 0 or texture.min_linear != 0 else _NEAREST_SAMPLES)
    most, most_per_axis, none = vec.f32(_MAX_SAMPLES), vec.f32(_MAX_SAMPLES_PER_AXIS), vec.i32(_NO_LEVEL)
    grids = none
    for k in range(texture.level_count):
        _, width, height, _ = _load_level(texture, k)
        across, down = _squared_sides(gradient, width, height)
        columns, rows = _samples_along(across), _samples_along(down)
        is_covered = (columns <= most_per_axis) & (rows <= most_per_axis) & (columns * rows <= most)
        if k == texture.level_count - 1:
            limit = vec.f32(_NEAREST_SAMPLES)
            columns, rows = vec.select(is_covered, columns, limit), vec.select(is_covered, rows, limit)
            is_covered = rows == rows
        columns, rows = vec.to_i32(vec.maximum(columns, fewest)), vec.to_i32(vec.maximum(rows, fewest))
        grid = vec.i32(k << 8) + (columns << vec.i32(4)) + rows
        grids = vec.select(is_covered & (grids == none), grid, grids)
        if vec.movemask(grids == none) == 0:
            break
    return grids


@device_function
def _sample_grid(texture, sampler, grid, u, v, gradient):
    """Return the mean RGBA of the samples of one of ``_area_grids`` in the footprints of eight pixels."""
    du_dx, dv_dx, du_dy, dv_dy = gradient
    k, columns, rows = np.int64(grid >> 8), np.int64(grid >> 4) & 15, np.int64(grid) & 15
    linear = texture.mag_linear != 0 or texture.min_linear != 0
    if columns * rows == 1:
        return _sample_level(texture, sampler, k, linear, u, v)
    half, zero = np.float32(0.5), vec.f32(0.0)
    r, g, b, alpha = zero, zero, zero, zero
    for row in range(rows):
        down = vec.f32((np.float32(row) + half) / np.float32(rows) - half)
        row_u, row_v = u + down * du_dy, v + down * dv_dy
        for column in range(columns):
            across = vec.f32((np.float32(column) + half) / np.float32(columns) - half)
            rgba = _sample_level(texture, sampler, k, linear, row_u + across * du_dx, row_v + across * dv_dx)
            r, g, b, alpha = r + rgba[0], g + rgba[1], b + rgba[2], alpha + rgba[3]
    share = vec.f32(np.float32(1.0) / np.float32(columns * rows))
    return r * share, g * share, b * share, alpha * share


@device_function
def _sample_area(texture, sampler, u, v, gradient):
    """Return RGBA averaged over the footprints of eight pixels, parallelograms of texture coordinates."""
    grids = _area_grids(texture, gradient)
    grid = vec.minimum_of(grids)
    rgba = _sample_grid(texture, sampler, grid, u, v, gradient)
    while True:
        grids = vec.select(grids == vec.i32(grid), vec.i32(_NO_LEVEL), grids)
        grid = vec.minimum_of(grids)
        if grid == _NO_LEVEL:
            return rgba
        rgba = _select4(grids == vec.i32(grid), _sample_grid(texture, sampler, grid, u, v, gradient), rgba)


@inlined
def _transformed_uv(uv_transform, uv, x):
    """Return (u, v) of eight pixels, transformed; ``uv``: pointer to the two rows of a set in PIXELS."""
    a, b, c, d, e, f = uv_transform
    u, v = vec.load(uv, x), vec.load(uv, STRIDE + x)
    return a * u + b * v + c, d * u + e * v + f


@inlined
def _store_texel(rows, x, rgba, alpha):
    """Store RGB, and A only if ``alpha``, in four rows of PIXELS."""
    store3(rows, x, STRIDE, rgba)
    if alpha:
        vec.store(rows, 3 * STRIDE + x, rgba[3])


@device_function
def sample(segment, index, count, rows, alpha):
    """Sample a texture at the first ``count`` pixels, 0 .. 1 per channel.

    Texel centres are at ((i + 0.5) / width, (j + 0.5) / height). Mip levels and areas need the rows ``uv_gradient``.

    Args:
        index: index of the texture in the job's table.
        rows: pointer to four rows of PIXELS that are filled.
        alpha: True: fill the fourth row, too. Otherwise it is undefined.
    """
    job, pixels = segment.job, segment.pixels
    texture = job.textures[index]
    sampler, level = _load_sampler(texture, job.linear_from_byte), _load_level(texture, np.int64(0))
    texels, width, height, stride = level
    uv = f32_at(address(pixels.uv) + 4 * 2 * STRIDE * texture.uv_set)
    uv_gradient = f32_at(address(pixels.uv_gradient) + 4 * 4 * STRIDE * texture.uv_set)
    uv_transform = _load_uv_transform(texture)
    if job.area_filter != 0 and segment.material.has_gradients != 0:
        for x in range(0, count, vec.LANES):
            u, v = _transformed_uv(uv_transform, uv, x)
            gradient = _transformed_gradient(uv_transform, uv_gradient, x)
            _store_texel(rows, x, _sample_area(texture, sampler, u, v, gradient), alpha)
        return
    is_minified = False
    if texture.mips != MIPS_NONE or texture.mag_linear != texture.min_linear:
        for x in range(0, count, vec.LANES):
            footprint = _footprint(uv_transform, uv_gradient, x, width, height)
            vec.store(rows, x, footprint)
            is_minified = is_minified or vec.movemask(footprint > vec.f32(1.0)) != 0
    if is_minified:
        integer_rows = as_i32(rows)
        for x in range(0, count, vec.LANES):
            levels, t = _mip_levels(texture, vec.load(rows, x))
            vec.store(integer_rows, x, levels)
            vec.store(rows, STRIDE + x, t)
        for x in range(0, count, vec.LANES):
            u, v = _transformed_uv(uv_transform, uv, x)
            levels, t = vec.load(integer_rows, x), vec.load(rows, STRIDE + x)
            _store_texel(rows, x, _sample_mipmapped(texture, sampler, u, v, levels, t), alpha)
    elif texture.mag_linear == 0:
        for x in range(0, count, vec.LANES):
            u, v = _transformed_uv(uv_transform, uv, x)
            _store_texel(rows, x, _nearest(level, sampler, u, v), alpha)
    else:
        # Two passes, so that texels are prefetched long before they are read. Mip levels are small enough without.
        prefetches = width * height > _MIN_PREFETCHED_TEXELS
        integer_rows = as_i32(rows)
        for x in range(0, count, vec.LANES):
            u, v = _transformed_uv(uv_transform, uv, x)
            i, j, tx, ty = _locate(level, sampler, u, v)
            vec.store(integer_rows, x, i)
            vec.store(integer_rows, STRIDE + x, j)
            vec.store(rows, 2 * STRIDE + x, tx)
            vec.store(rows, 3 * STRIDE + x, ty)
            if prefetches:
                vec.prefetch_pair_rows(texels, j * vec.i32(stride) + i, stride)
        for x in range(0, count, vec.LANES):
            i, j = vec.load(integer_rows, x), vec.load(integer_rows, STRIDE + x)
            tx, ty = vec.load(rows, 2 * STRIDE + x), vec.load(rows, 3 * STRIDE + x)
            _store_texel(rows, x, _interpolate(level, sampler, i, j, tx, ty), alpha)
