"""Textures averaged over each pixel's area, as a sensor does, eight pixels at a time.

A pixel's area is a parallelogram of texture coordinates. It is covered with a grid of samples of one mip level.
"""

from __future__ import annotations

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.shading.texels import level_size, locate, read_texels

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


@inlined
def squared_sides(gradient, width, height):
    """Return the squares of both sides of eight pixels' footprints, texels of levels of this size, f32x8."""
    du_dx, dv_dx, du_dy, dv_dy = gradient
    ds_dx, dt_dx = du_dx * width, dv_dx * height
    ds_dy, dt_dy = du_dy * width, dv_dy * height
    return ds_dx * ds_dx + dt_dx * dt_dx, ds_dy * ds_dy + dt_dy * dt_dy


@inlined
def _samples_along(squared_side):
    """Return the number of samples at most ``_SAMPLE_SPACING`` apart, f32x8, up to one more than the permitted one."""
    most = (_MAX_SAMPLES_PER_AXIS + 1) * _SAMPLE_SPACING
    side = vec.sqrt(vec.minimum(vec.maximum(squared_side, vec.f32(0.0)), vec.f32(most * most)))
    return vec.maximum(vec.ceil(side * vec.f32(1.0 / _SAMPLE_SPACING)), vec.f32(1.0))


@inlined
def _area_grids(texture, gradient):
    """Return the grids for the footprints of eight pixels: mip level, columns and rows, i32x8 each.

    The level is the finest one whose texels the permitted number of samples covers.
    """
    fewest = vec.f32(1.0 if texture.mag_linear != 0 or texture.min_linear != 0 else _NEAREST_SAMPLES)
    most, most_per_axis, limit = vec.f32(_MAX_SAMPLES), vec.f32(_MAX_SAMPLES_PER_AXIS), vec.f32(_NEAREST_SAMPLES)
    last, none = texture.last_level, vec.i32(_NO_LEVEL)
    levels, all_columns, all_rows = none, limit, limit
    for k in range(last + 1):
        width, height = max(texture.width >> k, 1), max(texture.height >> k, 1)
        across, down = squared_sides(gradient, vec.f32(width), vec.f32(height))
        columns, rows = _samples_along(across), _samples_along(down)
        is_covered = (columns <= most_per_axis) & (rows <= most_per_axis) & (columns * rows <= most)
        is_new = is_covered & (levels == none)
        levels = vec.select(is_new, vec.i32(k), levels)
        all_columns, all_rows = vec.select(is_new, columns, all_columns), vec.select(is_new, rows, all_rows)
        if vec.movemask(levels == none) == 0:
            break
    levels = vec.select(levels == none, vec.i32(last), levels)
    return levels, vec.to_i32(vec.maximum(all_columns, fewest)), vec.to_i32(vec.maximum(all_rows, fewest))


@inlined
def _spread(squared_side, count, edge_width):
    """Return factors of the distances of ``count`` samples that keep edges as wide as the footprint makes them.

    The variance of a footprint of side L is L² / 12, that of n samples L² (1 - 1 / n²) / 12. Bilinear interpolation
    adds 1 / 12 to edges between texels, and the mean of the texels of a mip level another 1 / 12: samples are that much
    closer together. n samples of the first level, one texel apart, are exact.

    Args:
        count: f32x8.
        edge_width: f32x8, variance of an edge of the level, units of 1/12 squared texel.
    """
    one = vec.f32(1.0)
    squared_count = count * count
    share = one - edge_width / vec.maximum(squared_side, edge_width)
    return vec.sqrt(share * squared_count / vec.maximum(squared_count - one, one))


@inlined
def sample_area(texture, levels, pixels, x, u, v, gradient):
    """Return RGBA averaged over the footprints of the pixels x .. x + 7, parallelograms of texture coordinates."""
    du_dx, dv_dx, du_dy, dv_dy = gradient
    zero, half, one = vec.f32(0.0), vec.f32(0.5), vec.f32(1.0)
    is_linear = texture.mag_linear != 0 or texture.min_linear != 0
    filter_half = vec.f32(0.5 if is_linear else 0.0)
    level, columns, rows = _area_grids(texture, gradient)
    column_count, row_count = vec.to_f32(columns), vec.to_f32(rows)
    spread_x, spread_y = one, one
    if is_linear:
        width, height = level_size(texture.width, level), level_size(texture.height, level)
        across, down = squared_sides(gradient, vec.to_f32(width), vec.to_f32(height))
        edge_width = vec.select(level == vec.i32(0), one, vec.f32(2.0))
        spread_x, spread_y = _spread(across, column_count, edge_width), _spread(down, row_count, edge_width)
    r, g, b, alpha = zero, zero, zero, zero
    # Each pixel has a grid of its own, and takes no part in the samples beyond it.
    for row in range(vec.maximum_of(rows)):
        down = (vec.f32(row + 0.5) / row_count - half) * spread_y
        row_u, row_v = u + down * du_dy, v + down * dv_dy
        for column in range(vec.maximum_of(columns)):
            across = (vec.f32(column + 0.5) / column_count - half) * spread_x
            locate(levels, pixels, x, level, filter_half, row_u + across * du_dx, row_v + across * dv_dx)
            rgba = read_texels(levels, pixels, x)
            is_sampled = (vec.i32(row) < rows) & (vec.i32(column) < columns)
            r, g = r + vec.select(is_sampled, rgba[0], zero), g + vec.select(is_sampled, rgba[1], zero)
            b, alpha = b + vec.select(is_sampled, rgba[2], zero), alpha + vec.select(is_sampled, rgba[3], zero)
    share = one / (column_count * row_count)
    return r * share, g * share, b * share, alpha * share
