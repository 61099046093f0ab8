"""Textures averaged over each pixel's area, as a sensor does, eight pixels at a time.

A pixel's footprint is a parallelogram of texture coordinates, with the sides (du/dx, dv/dx) and (du/dy, dv/dy). It is
covered with a grid of samples of one mip level, whose columns are along the first side and whose rows along the
second::

     (u, v) in the middle     . . . .
                               . . . .      here 4 columns, 2 rows

``gradient`` is (du/dx, dv/dx, du/dy, dv/dy), f32x8 each, texture coordinates per pixel of the image.
"""

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import I64
from renderers.compiler.simd import F32x8, F32x8x2, F32x8x4, I32x8x3
from renderers.shading.layout import PartPixels, ShadingTexture
from renderers.shading.texels import TextureFields, level_size, locate, located_rows, read_texels, wrapped

_NO_LEVEL: Final = -1
_MAX_SAMPLES: Final = 12
"""Maximum number of samples in a pixel's footprint. More would read finer mip levels: sharper edges, for
more time."""
_MAX_SAMPLES_PER_AXIS: Final = 8
"""Maximum number of samples along one side of a footprint: the highest anisotropy that is filtered without blur."""
_SAMPLE_SPACING: Final = 1.3
"""Maximum distance of samples, texels. Each covers two texels with a tent, so their sum has small ripples."""
_MIN_NEAREST_SAMPLES: Final = 3
"""Minimum number of samples per axis of textures whose filter is the nearest texel."""
_COARSEST_SAMPLES: Final = 3
"""Number of samples per axis of footprints that are too large for every level; they are taken from the last one."""


@inlined
def squared_sides(gradient: F32x8x4, width: F32x8, height: F32x8) -> F32x8x2:
    """Return the squares of both sides of eight pixels' footprints, texels of a level of this size."""
    du_dx, dv_dx, du_dy, dv_dy = gradient
    ds_dx, dt_dx = du_dx * width, dv_dx * height
    ds_dy, dt_dy = du_dy * width, dv_dy * height
    return ds_dx * ds_dx + dt_dx * dt_dx, ds_dy * ds_dy + dt_dy * dt_dy


@inlined
def _samples_along(squared_side: F32x8) -> F32x8:
    """Return the number of samples at most ``_SAMPLE_SPACING`` apart; where too many, one more than permitted."""
    # Limited to the side that gives one sample more than permitted, since it may be infinite.
    longest = (_MAX_SAMPLES_PER_AXIS + 1) * _SAMPLE_SPACING
    squared_side = vec.maximum(squared_side, vec.f32(0.0))  # NaN: 0
    side = vec.sqrt(vec.minimum(squared_side, vec.f32(longest * longest)))
    return vec.maximum(vec.ceil(side * vec.f32(1.0 / _SAMPLE_SPACING)), vec.f32(1.0))


@inlined
def _area_grids(texture: ShadingTexture, gradient: F32x8x4, is_linear: bool) -> I32x8x3:
    """Return the grids for the footprints of eight pixels: mip level, columns and rows.

    The level is the finest one whose texels the permitted number of samples covers.
    """
    max_samples, max_per_axis = vec.f32(_MAX_SAMPLES), vec.f32(_MAX_SAMPLES_PER_AXIS)
    level, no_level, last_level = vec.i32(_NO_LEVEL), vec.i32(_NO_LEVEL), texture.last_level
    columns, rows = vec.f32(_COARSEST_SAMPLES), vec.f32(_COARSEST_SAMPLES)
    for k in range(last_level + 1):
        width, height = max(texture.width >> k, 1), max(texture.height >> k, 1)
        squared_across, squared_down = squared_sides(gradient, vec.f32(width), vec.f32(height))
        level_columns, level_rows = _samples_along(squared_across), _samples_along(squared_down)
        is_covered = (level_columns <= max_per_axis) & (level_rows <= max_per_axis)
        is_covered = is_covered & (level_columns * level_rows <= max_samples)
        is_first = is_covered & (level == no_level)
        level = vec.select(is_first, vec.i32(k), level)
        columns, rows = vec.select(is_first, level_columns, columns), vec.select(is_first, level_rows, rows)
        if vec.movemask(level == no_level) == 0:
            break
    level = vec.select(level == no_level, vec.i32(last_level), level)
    min_per_axis = vec.f32(1 if is_linear else _MIN_NEAREST_SAMPLES)
    return level, vec.to_i32(vec.maximum(columns, min_per_axis)), vec.to_i32(vec.maximum(rows, min_per_axis))


@inlined
def _sample_spread(squared_side: F32x8, count: F32x8, edge_variance: F32x8) -> F32x8:
    """Return factors of the distances of ``count`` samples that keep edges as wide as the footprint makes them.

    The variance of a footprint of side L is L² / 12, and that of n samples evenly in it L² (1 - 1/n²) / 12. Bilinear
    interpolation adds edge_variance / 12. The factor ``spread`` of the samples' distances, below or above 1, makes the
    sum that of the footprint; times 12::

        spread² L² (1 - 1/n²) + edge_variance = L²
        spread² = (1 - edge_variance / L²) n² / (n² - 1)

    n samples of level 0, one texel apart (L = n, edge_variance = 1), have the spread 1.

    Args:
        squared_side: L², squared texels of the level.
        count: n.
        edge_variance: units of 1/12 squared texel.
    """
    one = vec.f32(1.0)
    squared_count = count * count
    kept = one - edge_variance / vec.maximum(squared_side, edge_variance)
    return vec.sqrt(kept * squared_count / vec.maximum(squared_count - one, one))


@inlined
def is_within_texel(texture: ShadingTexture, gradient: F32x8x4) -> bool:
    """Return True if one bilinear sample of level 0 covers the footprint of each of eight pixels.

    Magnified textures, with ``sample_area`` alone, take 30 % longer.
    """
    squared_across, squared_down = squared_sides(gradient, vec.f32(texture.width), vec.f32(texture.height))
    limit = vec.f32(_SAMPLE_SPACING * _SAMPLE_SPACING)
    is_linear = texture.mag_linear != 0 or texture.min_linear != 0
    return is_linear and vec.movemask((squared_across > limit) | (squared_down > limit)) == 0


@inlined
def sample_area(
    texture: ShadingTexture,
    fields: TextureFields,
    pixels: PartPixels,
    pixel: I64,
    u: F32x8,
    v: F32x8,
    gradient: F32x8x4,
    with_alpha: bool,
) -> F32x8x4:
    """Return RGBA, 0 .. 1, averaged over the footprints of eight pixels, whose centres have the coordinates (u, v).

    The pixels' rows of texels are overwritten. Without ``with_alpha``, A is 1, and not read.
    """
    du_dx, dv_dx, du_dy, dv_dy = gradient
    zero, half, one = vec.f32(0.0), vec.f32(0.5), vec.f32(1.0)
    is_linear = texture.mag_linear != 0 or texture.min_linear != 0
    # The same for ``locate``, in all lanes.
    linear_lanes = vec.i32(texture.mag_linear | texture.min_linear) != vec.i32(0)
    level, columns, rows = _area_grids(texture, gradient, is_linear)
    column_count, row_count = vec.to_f32(columns), vec.to_f32(rows)
    spread_x, spread_y = one, one
    if is_linear:
        width, height = level_size(texture.width, level), level_size(texture.height, level)
        squared_across, squared_down = squared_sides(gradient, vec.to_f32(width), vec.to_f32(height))
        # Bilinear interpolation: 1; the mean of the texels of a mip level: 1 more.
        edge_variance = vec.select(level == vec.i32(0), one, vec.f32(2.0))
        spread_x = _sample_spread(squared_across, column_count, edge_variance)
        spread_y = _sample_spread(squared_down, row_count, edge_variance)
    r, g, b, a = zero, zero, zero, zero
    # Each sample is located and read in the same rows.
    offsets, weights = located_rows(pixels, 0)
    # Each pixel has a grid of its own, and takes no part in the samples beyond it.
    for row in range(vec.maximum_of(rows)):
        offset_y = (vec.f32(row + 0.5) / row_count - half) * spread_y  # from the pixel's centre, pixels
        row_u, row_v = u + offset_y * du_dy, v + offset_y * dv_dy
        for column in range(vec.maximum_of(columns)):
            offset_x = (vec.f32(column + 0.5) / column_count - half) * spread_x
            sample_u = wrapped(row_u + offset_x * du_dx, fields.wrap_s)
            sample_v = wrapped(row_v + offset_x * dv_dx, fields.wrap_t)
            locate(fields, offsets, weights, pixel, level, linear_lanes, sample_u, sample_v)
            rgba = read_texels(fields, offsets, weights, pixel, with_alpha)
            is_sampled = (vec.i32(row) < rows) & (vec.i32(column) < columns)
            r, g = r + vec.select(is_sampled, rgba[0], zero), g + vec.select(is_sampled, rgba[1], zero)
            b, a = b + vec.select(is_sampled, rgba[2], zero), a + vec.select(is_sampled, rgba[3], zero)
    sample_weight = one / (column_count * row_count)
    return r * sample_weight, g * sample_weight, b * sample_weight, a * sample_weight
