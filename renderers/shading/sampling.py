"""Texture sampling: fills rows of PIXELS from a texture, with OpenGL's filters or, with SHADING_JOB's ``area_filter``,
averaged over each pixel's area.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import advance, as_i32
from renderers.shading.area_filter import sample_area, squared_sides
from renderers.shading.layout import STRIDE
from renderers.shading.mip_levels import mip_levels, sample_mipmapped
from renderers.shading.texels import interpolate_texels, load_level, load_sampler, locate, nearest
from renderers.shading.texture_table import MIPS_NONE
from renderers.shading.vec3 import store3

_MIN_PREFETCHED_TEXELS: Final = 1 << 17
"""Number of texels from which an image is prefetched: half a megabyte, more than a second-level cache holds."""


@inlined
def _load_uv_transform(texture):
    """Return the six values of a TEXTURE's uv_transform, f32x8 each."""
    m = texture.uv_transform
    return vec.f32(m[0]), vec.f32(m[1]), vec.f32(m[2]), vec.f32(m[3]), vec.f32(m[4]), vec.f32(m[5])


@inlined
def _transformed_uv(uv_transform, uv, x):
    """Return (u, v) of eight pixels, transformed; ``uv``: pointer to the two rows of a set in PIXELS."""
    a, b, c, d, e, f = uv_transform
    u, v = vec.load(uv, x), vec.load(uv, STRIDE + x)
    return a * u + b * v + c, d * u + e * v + f


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
def _footprint(uv_transform, uv_gradient, x, width, height):
    """Return the square of the longer side of eight pixels' footprints, in texels of the first level."""
    across, down = squared_sides(_transformed_gradient(uv_transform, uv_gradient, x), width, height)
    return vec.maximum(across, down)


@inlined
def _store_texel(rows, x, rgba, alpha):
    """Store RGB, and A only if ``alpha``, in four rows of PIXELS."""
    store3(rows, x, STRIDE, rgba)
    if alpha:
        vec.store(rows, 3 * STRIDE + x, rgba[3])


@inlined
def _sample_areas(texture, sampler, uv_transform, uv, uv_gradient, count, rows, alpha):
    """``sample``, averaged over each pixel's area."""
    for x in range(0, count, vec.LANES):
        u, v = _transformed_uv(uv_transform, uv, x)
        gradient = _transformed_gradient(uv_transform, uv_gradient, x)
        _store_texel(rows, x, sample_area(texture, sampler, u, v, gradient), alpha)


@inlined
def _store_footprints(texture, uv_transform, uv_gradient, count, rows):
    """Store ``_footprint`` in the first row if the filter depends on it; return True if any pixel is minified."""
    is_minified = False
    if texture.mips != MIPS_NONE or texture.mag_linear != texture.min_linear:
        _, width, height, _ = load_level(texture, np.int64(0))
        for x in range(0, count, vec.LANES):
            footprint = _footprint(uv_transform, uv_gradient, x, width, height)
            vec.store(rows, x, footprint)
            is_minified = is_minified or vec.movemask(footprint > vec.f32(1.0)) != 0
    return is_minified


@inlined
def _sample_minified(texture, sampler, uv_transform, uv, count, rows, alpha):
    """``sample`` from mip levels, for the footprints that ``_store_footprints`` has stored."""
    integer_rows = as_i32(rows)
    for x in range(0, count, vec.LANES):
        levels, t = mip_levels(texture, vec.load(rows, x))
        vec.store(integer_rows, x, levels)
        vec.store(rows, STRIDE + x, t)
    for x in range(0, count, vec.LANES):
        u, v = _transformed_uv(uv_transform, uv, x)
        levels, t = vec.load(integer_rows, x), vec.load(rows, STRIDE + x)
        _store_texel(rows, x, sample_mipmapped(texture, sampler, u, v, levels, t), alpha)


@inlined
def _sample_bilinear(texture, sampler, uv_transform, uv, count, rows, alpha):
    """``sample`` by interpolation in the first level.

    Two passes, so that texels are prefetched long before they are read. Mip levels are small enough without.
    """
    level = load_level(texture, np.int64(0))
    texels, width, height, stride = level
    prefetches = width * height > _MIN_PREFETCHED_TEXELS
    integer_rows = as_i32(rows)
    for x in range(0, count, vec.LANES):
        u, v = _transformed_uv(uv_transform, uv, x)
        i, j, tx, ty = locate(level, sampler, u, v)
        vec.store(integer_rows, x, i)
        vec.store(integer_rows, STRIDE + x, j)
        vec.store(rows, 2 * STRIDE + x, tx)
        vec.store(rows, 3 * STRIDE + x, ty)
        if prefetches:
            vec.prefetch_pair_rows(texels, j * vec.i32(stride) + i, stride)
    for x in range(0, count, vec.LANES):
        i, j = vec.load(integer_rows, x), vec.load(integer_rows, STRIDE + x)
        tx, ty = vec.load(rows, 2 * STRIDE + x), vec.load(rows, 3 * STRIDE + x)
        _store_texel(rows, x, interpolate_texels(level, sampler, i, j, tx, ty), alpha)


@device_function
def sample(segment, index, count, rows, alpha):
    """Sample a texture at the first ``count`` pixels, 0 .. 1 per channel.

    Texel centres are at ((i + 0.5) / width, (j + 0.5) / height). Mip levels and areas need the rows ``uv_gradient``.

    Args:
        index: index of the texture in the job's table.
        rows: pointer to four rows of PIXELS that are filled, and hold intermediate values before.
        alpha: True: fill the fourth row, too. Otherwise it is undefined.
    """
    job, pixels = segment.job, segment.pixels
    texture = job.textures[index]
    sampler = load_sampler(texture, job.linear_from_byte)
    uv = advance(pixels.uv, 2 * STRIDE * texture.uv_set)
    uv_gradient = advance(pixels.uv_gradient, 4 * STRIDE * texture.uv_set)
    uv_transform = _load_uv_transform(texture)
    if job.area_filter != 0 and segment.material.has_gradients != 0:
        _sample_areas(texture, sampler, uv_transform, uv, uv_gradient, count, rows, alpha)
    elif _store_footprints(texture, uv_transform, uv_gradient, count, rows):
        _sample_minified(texture, sampler, uv_transform, uv, count, rows, alpha)
    elif texture.mag_linear == 0:
        level = load_level(texture, np.int64(0))
        for x in range(0, count, vec.LANES):
            u, v = _transformed_uv(uv_transform, uv, x)
            _store_texel(rows, x, nearest(level, sampler, u, v), alpha)
    else:
        _sample_bilinear(texture, sampler, uv_transform, uv, count, rows, alpha)
