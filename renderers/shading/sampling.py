"""Texture sampling: fills rows of PIXELS from a texture, with OpenGL's filters or, with SHADING_JOB's ``area_filter``,
averaged over each pixel's area.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import advance
from renderers.shading.area_filter import sample_area, squared_sides
from renderers.shading.layout import STRIDE
from renderers.shading.mip_levels import mip_levels
from renderers.shading.texels import load_levels, locate, read_texels
from renderers.shading.texture_table import MIPS_NONE
from renderers.shading.vec3 import load3, store3

_MIN_PREFETCHED_TEXELS: Final = 1 << 17
"""Number of texels from which an image is prefetched: half a megabyte, more than a second-level cache holds.
Frames with a texture of 2048 x 2048 take 16 % less time, those with mip levels 8 %."""


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
    across, down = squared_sides(_transformed_gradient(uv_transform, uv_gradient, x), vec.f32(width), vec.f32(height))
    return vec.maximum(across, down)


@inlined
def _store_texel(rows, x, rgba, alpha):
    """Store RGB, and A only if ``alpha``, in four rows of PIXELS."""
    store3(rows, x, STRIDE, rgba)
    if alpha:
        vec.store(rows, 3 * STRIDE + x, rgba[3])


@inlined
def _sample_areas(texture, levels, uv_transform, uv, uv_gradient, pixels, count, rows, alpha):
    """``sample``, averaged over each pixel's area."""
    for x in range(0, count, vec.LANES):
        u, v = _transformed_uv(uv_transform, uv, x)
        gradient = _transformed_gradient(uv_transform, uv_gradient, x)
        _store_texel(rows, x, sample_area(texture, levels, pixels, x, u, v, gradient), alpha)


@inlined
def _select_levels(texture, uv_transform, uv, uv_gradient, pixels, count):
    """Fill ``level``, ``next_level_weight`` and ``sample_uv``; return True if any pixel is between two levels."""
    depends_on_scale = texture.mips != MIPS_NONE or texture.mag_linear != texture.min_linear
    is_between, width, height = False, texture.width, texture.height
    for x in range(0, count, vec.LANES):
        u, v = _transformed_uv(uv_transform, uv, x)
        level, weight = vec.i32(0), vec.f32(0.0)
        if depends_on_scale:
            level, weight = mip_levels(texture, _footprint(uv_transform, uv_gradient, x, width, height))
            is_between = is_between or vec.movemask(weight > vec.f32(0.0)) != 0
        vec.store(pixels.level, x, level)
        vec.store(pixels.next_level_weight, x, weight)
        vec.store(pixels.sample_uv, x, u)
        vec.store(pixels.sample_uv, STRIDE + x, v)
    return is_between


@inlined
def _sample_levels(texture, levels, pixels, count, rows, alpha, is_between):
    """``sample`` with OpenGL's filters, for the levels and coordinates of ``_select_levels``.

    The first step reads each pixel's level, the second the next one and mixes it in.
    """
    zero, last = vec.i32(0), vec.i32(levels.last)
    mag_half, min_half = vec.f32(0.5 * texture.mag_linear), vec.f32(0.5 * texture.min_linear)
    prefetches = levels.width * levels.height > _MIN_PREFETCHED_TEXELS
    for step in range(2 if is_between else 1):
        for x in range(0, count, vec.LANES):
            level = vec.load(pixels.level, x)
            half = vec.select(level < zero, mag_half, min_half)
            level = vec.minimum(vec.maximum(level, zero) + vec.i32(step), last)
            u, v = vec.load(pixels.sample_uv, x), vec.load(pixels.sample_uv, STRIDE + x)
            locate(levels, pixels, x, level, half, u, v)
            if prefetches:
                for k in range(0, 2 * STRIDE, STRIDE):
                    vec.prefetch(levels.texels, np.int64(pixels.texel_offsets[k + x]))
                    vec.prefetch(levels.texels, np.int64(pixels.texel_offsets[k + x + 3]))
                    vec.prefetch(levels.texels, np.int64(pixels.texel_offsets[k + x + 5]))
                    vec.prefetch(levels.texels, np.int64(pixels.texel_offsets[k + x + 7]))
        for x in range(0, count, vec.LANES):
            rgba = read_texels(levels, pixels, x)
            if step == 1:
                rgba = _between(rows, x, rgba, vec.load(pixels.next_level_weight, x))
            _store_texel(rows, x, rgba, alpha)


@inlined
def _between(rows, x, rgba, weight):
    """Return RGBA between that in four rows of PIXELS (weight 0) and ``rgba`` (weight 1)."""
    r, g, b = load3(rows, x, STRIDE)
    a = vec.load(rows, 3 * STRIDE + x)
    return (
        r + weight * (rgba[0] - r),
        g + weight * (rgba[1] - g),
        b + weight * (rgba[2] - b),
        a + weight * (rgba[3] - a),
    )


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
    levels = load_levels(texture, job.linear_from_byte)
    uv = advance(pixels.uv, 2 * STRIDE * texture.uv_set)
    uv_gradient = advance(pixels.uv_gradient, 4 * STRIDE * texture.uv_set)
    uv_transform = _load_uv_transform(texture)
    if job.area_filter != 0 and segment.material.has_gradients != 0:
        _sample_areas(texture, levels, uv_transform, uv, uv_gradient, pixels, count, rows, alpha)
    else:
        is_between = _select_levels(texture, uv_transform, uv, uv_gradient, pixels, count)
        _sample_levels(texture, levels, pixels, count, rows, alpha, is_between)
