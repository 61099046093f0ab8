"""Textures averaged over each pixel's area, as a sensor does, eight pixels at a time.

A pixel's area is a parallelogram of texture coordinates. It is covered with a grid of samples of one mip level.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.shading.texels import load_level, sample_level, select4

_NO_GRID: Final = 1 << 20
"""Greater than every value of ``_area_grids``."""
_MAX_SAMPLES: Final = 12
"""Maximum number of samples in a pixel's footprint. More would cover finer mip levels, which makes edges sharper."""
_MAX_SAMPLES_PER_AXIS: Final = 8
"""Maximum number of samples along one side of a footprint: the highest anisotropy that is filtered without blur."""
_SAMPLE_SPACING: Final = 1.3
"""Maximum distance of samples, texels. Each covers two texels with a tent, so their sum has small ripples."""
_NEAREST_SAMPLES: Final = 3
"""Minimum number of samples per axis of textures whose filter is the nearest texel."""


@inlined
def squared_sides(gradient, width, height):
    """Return the squares of both sides of eight pixels' footprints, texels of a level of this size."""
    du_dx, dv_dx, du_dy, dv_dy = gradient
    ds_dx, dt_dx = du_dx * vec.f32(width), dv_dx * vec.f32(height)
    ds_dy, dt_dy = du_dy * vec.f32(width), dv_dy * vec.f32(height)
    return ds_dx * ds_dx + dt_dx * dt_dx, ds_dy * ds_dy + dt_dy * dt_dy


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
    most, most_per_axis, none = vec.f32(_MAX_SAMPLES), vec.f32(_MAX_SAMPLES_PER_AXIS), vec.i32(_NO_GRID)
    grids = none
    for k in range(texture.level_count):
        _, width, height, _ = load_level(texture, k)
        across, down = squared_sides(gradient, width, height)
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


@inlined
def _spread(squared_side, count, edge_width):
    """Return the factor of the distances of ``count`` samples with which edges are as wide as the footprint makes them.

    The variance of a footprint of side L is L² / 12, that of n samples L² (1 - 1 / n²) / 12. Bilinear interpolation
    adds 1 / 12 to edges between texels, and the mean of the texels of a mip level another 1 / 12: samples are that much
    closer together. n samples of the first level, one texel apart, are exact.

    Args:
        edge_width: variance of an edge of the level, units of 1/12 squared texel.
    """
    share = vec.f32(1.0) - vec.f32(edge_width) / vec.maximum(squared_side, vec.f32(edge_width))
    return vec.sqrt(share * vec.f32(np.float32(count * count) / np.float32(max(count * count - 1, 1))))


@inlined
def _sample_grid(texture, sampler, grid, u, v, gradient):
    """Return the mean RGBA of the samples of one of ``_area_grids`` in the footprints of eight pixels."""
    du_dx, dv_dx, du_dy, dv_dy = gradient
    k, columns, rows = np.int64(grid >> 8), np.int64(grid >> 4) & 15, np.int64(grid) & 15
    linear = texture.mag_linear != 0 or texture.min_linear != 0
    if columns * rows == 1:
        return sample_level(texture, sampler, k, linear, u, v)
    half, zero = np.float32(0.5), vec.f32(0.0)
    r, g, b, alpha = zero, zero, zero, zero
    spread_x, spread_y = vec.f32(1.0), vec.f32(1.0)
    if linear:
        _, width, height, _ = load_level(texture, k)
        across, down = squared_sides(gradient, width, height)
        edge_width = np.float32(1.0 if k == 0 else 2.0)
        spread_x, spread_y = _spread(across, columns, edge_width), _spread(down, rows, edge_width)
    for row in range(rows):
        down = vec.f32((np.float32(row) + half) / np.float32(rows) - half) * spread_y
        row_u, row_v = u + down * du_dy, v + down * dv_dy
        for column in range(columns):
            across = vec.f32((np.float32(column) + half) / np.float32(columns) - half) * spread_x
            rgba = sample_level(texture, sampler, k, linear, row_u + across * du_dx, row_v + across * dv_dx)
            r, g, b, alpha = r + rgba[0], g + rgba[1], b + rgba[2], alpha + rgba[3]
    share = vec.f32(np.float32(1.0) / np.float32(columns * rows))
    return r * share, g * share, b * share, alpha * share


@inlined
def sample_area(texture, sampler, u, v, gradient):
    """Return RGBA averaged over the footprints of eight pixels, parallelograms of texture coordinates."""
    grids = _area_grids(texture, gradient)
    grid = vec.minimum_of(grids)
    rgba = _sample_grid(texture, sampler, grid, u, v, gradient)
    while True:
        grids = vec.select(grids == vec.i32(grid), vec.i32(_NO_GRID), grids)
        grid = vec.minimum_of(grids)
        if grid == _NO_GRID:
            return rgba
        rgba = select4(grids == vec.i32(grid), _sample_grid(texture, sampler, grid, u, v, gradient), rgba)
