"""Random-dot projector: its light at every pixel of a camera image.

The pattern is a texture on the projector's image plane, so both cameras see a dot at the same place on a surface. The
dots give the matcher texture on blank walls. The projector is half-way between the cameras with the same orientation.
Objects cast shadows in its light.

There are two patterns: square dots, and realistic ones (``projector_pattern``).

The projector is a point: its light falls with the cosine and the square of the distance. Polished metal returns little
of it to the cameras.
"""

from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import WeakCache
from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F32, F64, Array1, Array2, f32, i32, u16, u32, u64
from renderers.drawlist import Image, Instance
from renderers.shading.camera_light import MAX_FALLOFF, REFERENCE_DISTANCE
from renderers.stereo.light.projector_pattern import TEXELS_PER_CELL, soft_pattern_levels

CELL: Final = 1.5 / 552.0
"""Width of a cell of the pattern, a dot or a gap, divided by the focal length. With the 4 mm lens, it is 1.5 pixels in
an image 640 pixels wide."""
_PERIOD: Final = 1024
"""Period of the pattern, cells: 2.8 focal lengths, far beyond any disparity."""
_MIN_CELL_PIXELS: Final = 1.5
"""Minimum width of a cell, pixels. For smaller cells, a coarser level of the pattern is used, because aliasing would
differ between the two cameras."""
SHADOW_BIAS: Final = 0.02
"""Relative depth bias against self-shadowing, about the change of a slanted surface's depth over the three pixels that
are compared."""
FULL_LIGHT: Final = 255
"""Value of a full dot on a surface that faces the projector at ``REFERENCE_DISTANCE``."""
_AVERAGED_TEXELS: Final = 256
"""Minimum number of texels along a texture's shorter side from which its means are computed."""
_cached_means: WeakCache[Image, tuple[float, float]] = WeakCache("metal_means")
"""Results of ``_metal_means``."""
_ALL_RETURNED: Final = np.zeros((1, 1), np.int32), np.ones(1, np.float32)
"""Kernel arguments for ``returned`` of None."""
_FULL_SHARE: Final = np.ones((1, 1), np.float32)
"""Kernel argument for ``lamp_share`` of None."""


@cache
def _pattern_levels() -> tuple[NDArray[np.uint8], ...]:
    """Return the pattern as a mip chain from (1024, 1024) uint8 on: fine dots over dots of four times their size."""
    random = np.random.Generator(np.random.Philox(160))
    fine = random.random((_PERIOD, _PERIOD)) < 0.45
    coarse = np.kron(random.random((_PERIOD // 4, _PERIOD // 4)) < 0.4, np.ones((4, 4), np.bool_))
    level = np.where(coarse, 160.0, 0.0) + np.where(fine, 95.0, 0.0)
    levels = []
    while level.shape[0] >= 16:
        levels.append(np.round(level).astype(np.uint8))
        level = (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2]) / 4
    return tuple(levels)


def projected_dots(
    depth: NDArray[np.float32],
    focal_length: float,
    cx: float,
    cy: float,
    offset: float,
    projector_depth: NDArray[np.float32],
    *,
    lamp_share: NDArray[np.float32] | None = None,
    soft: bool = False,
    right: bool = False,
    point_samples: bool = False,
    returned: tuple[NDArray[np.int32], NDArray[np.float32]] | None = None,
) -> NDArray[np.uint16]:
    """Return the light of the projector at every pixel, (H, W) uint16; 0 in shadow and on the background.

    It is relative to all other light, if ``lamp_share`` is. A full dot has the value ``FULL_LIGHT`` on a surface that
    faces the projector at ``REFERENCE_DISTANCE``, and up to ``MAX_FALLOFF`` times that on nearer ones.

    Args:
        focal_length: focal length of camera and projector, pixels.
        offset: x of the camera in the projector's frame, metres.
        projector_depth: (H, W), depth seen from the projector with the camera's intrinsics, for shadows. Points outside
            this image are lit: the projector's field of view is wider than the camera's.
        lamp_share: (H, W or more), cosine of the projector's light divided by all other light; None: 1.
        soft, right: as for ``pattern_at``.
        point_samples: sample the finest pattern at any resolution, so that the values have the distribution of a
            full-resolution image's, for metering.
        returned: (H, W) instances and (I,) ``returned_shares`` of them; None: they return all light.
    """
    pattern, cells_per_pixel = pattern_at(focal_length, soft=soft, right=right, finest=point_samples)
    light = np.empty(depth.shape, np.uint16)
    ids, shares = returned or _ALL_RETURNED
    _project(
        depth, _FULL_SHARE if lamp_share is None else lamp_share, projector_depth, pattern, cells_per_pixel,
        float(focal_length), float(cx), float(cy), float(offset), ids, shares, light,
    )  # fmt: skip
    return light


def pattern_at(
    focal_length: float, *, soft: bool, right: bool, finest: bool = False
) -> tuple[NDArray[np.uint8], float]:
    """Return the level of the pattern for an image, (N, N) uint8, and its cells per pixel.

    Args:
        soft: realistic dots (``projector_pattern``).
        right: speckle as the right camera sees it; without ``soft`` both cameras see the same.
        finest: the finest level, however small its cells are.
    """
    level, cell_pixels = 0, CELL * focal_length
    levels = soft_pattern_levels(right=right) if soft else _pattern_levels()
    if soft:
        cell_pixels /= TEXELS_PER_CELL
    min_cell_pixels = 0.0 if finest else _MIN_CELL_PIXELS / (TEXELS_PER_CELL if soft else 1)
    while cell_pixels < min_cell_pixels and level < len(levels) - 1:
        level, cell_pixels = level + 1, cell_pixels * 2
    return levels[level], 1.0 / cell_pixels


def returned_shares(instances: Sequence[Instance]) -> NDArray[np.float32]:
    """Return the share of the projector's light that each instance returns to the cameras, by instance id, float32.

    Metal has no diffuse reflection: its highlight, whose width grows with the square of the roughness, misses the
    cameras. A textured material returns the mean of its texels' shares everywhere.
    """
    shares = np.ones(max((instance.instance_id for instance in instances), default=0) + 2, np.float32)
    for instance in instances:
        material, texture = instance.material, instance.material.metallic_roughness_texture
        metal, rough_metal = (1.0, 1.0) if texture is None else _metal_means(texture.image)
        shares[instance.instance_id] = 1.0 - material.metallic * (metal - rough_metal * material.roughness**2)
    return shares


def _metal_means(image: Image) -> tuple[float, float]:
    """Return the means of a metallic-roughness texture: of metalness, and of metalness times squared roughness."""
    means = _cached_means.get(image)
    if means is None:
        pixels = image.decode()
        step = max(1, min(pixels.shape[:2]) // _AVERAGED_TEXELS)
        roughness, metal = (pixels[::step, ::step, channel] / 255.0 for channel in (1, 2))
        means = float(metal.mean()), float((metal * roughness**2).mean())
        _cached_means.put(image, means, 2 * 8)
    return means


@device_function
def _interpolate_rows(upper: Array1[np.uint8], lower: Array1[np.uint8], fraction: F32, row: Array1[np.float32]) -> None:
    """Write the values between two rows of the pattern to ``row``, (N + 1,), the first cell repeated."""
    for i in range(len(upper)):
        row[i] = f32(upper[i]) * (f32(1.0) - fraction) + f32(lower[i]) * fraction
    row[len(upper)] = row[0]


@kernel
def _project(
    depth: Array2[np.float32],
    lamp_share: Array2[np.float32],
    projector_depth: Array2[np.float32],
    pattern: Array2[np.uint8],
    cells_per_pixel: F64,
    focal_length: F64,
    cx: F64,
    cy: F64,
    offset: F64,
    ids: Array2[np.int32],
    shares: Array1[np.float32],
    light: Array2[np.uint16],
) -> None:
    """Write the light at every pixel: the pattern, interpolated bilinearly, except in shadow.

    Arguments that are not listed are those of ``projected_dots``.

    Args:
        lamp_share: (H, W or more), or (1, 1): 1.
        pattern: (N, N), one level of the pattern; N is a power of two.
        cells_per_pixel: cells of this level per pixel of the image.
        ids: (H, W), instance at every pixel, or (1, 1): ``shares`` is not used.
        shares: (I,), share of the light that each instance returns.
    """
    height, width = depth.shape
    period = pattern.shape[0]
    reference, has_ids, has_share = f32(REFERENCE_DISTANCE**2), ids.shape[0] == height, lamp_share.shape[0] == height
    scale, disparity_factor = f32(cells_per_pixel), f32(offset * focal_length)
    inv_focal, x_offset, max_z = f32(1.0 / focal_length), f32(offset), f32(1e6)
    shadow_factor = f32(1.0 - SHADOW_BIAS)
    center, cell_mask = f32(period // 2), u32(period - 1)
    one, half = f32(1.0), f32(0.5)
    # The pattern at one row of the image, its first cell repeated; and values of the row's pixels. The loops that read
    # no tables compile to vector instructions.
    pattern_row = np.empty(period + 1, np.float32)
    cells, fractions = np.empty(width, np.uint32), np.empty(width, np.float32)
    fades, projector_columns = np.empty(width, np.float32), np.empty(width, np.int32)
    for row in range(height):
        v, ray_y = (f32(row + 0.5) - f32(cy)) * scale + center, (f32(row + 0.5) - f32(cy)) * inv_focal
        cell_v = int(np.floor(v))
        upper, lower = pattern[cell_v & (period - 1)], pattern[(cell_v + 1) & (period - 1)]
        _interpolate_rows(upper, lower, v - f32(cell_v), pattern_row)
        for column in range(width):
            z = depth[row, column]  # +inf on the background, where all light fades
            disparity = disparity_factor / z
            u = (f32(column) + half - f32(cx) + disparity) * scale + center
            cell_u = np.floor(u)
            cells[column], fractions[column] = u32(i32(cell_u)) & cell_mask, u - cell_u
            z = min(z, max_z)
            # From the surface to the projector, in the camera's frame, metres.
            to_x, to_y = -(f32(column) + half - f32(cx)) * inv_focal * z - x_offset, -ray_y * z
            distance_squared = to_x * to_x + to_y * to_y + z * z
            fades[column] = min(reference / distance_squared, f32(MAX_FALLOFF))
            projector_columns[column] = i32(np.floor(f32(column) + half + disparity))
        if has_share:
            for column in range(width):
                fades[column] *= lamp_share[row, column]
        if has_ids:
            for column in range(width):
                fades[column] *= shares[max(ids[row, column], 0)]
        for column in range(width):
            cell, fraction = u64(cells[column]), fractions[column]
            value = pattern_row[cell] * (one - fraction) + pattern_row[cell + u64(1)] * fraction
            x = projector_columns[column]
            if 1 <= x <= width - 2:
                # The point is in shadow if all three pixels around it in the projector's image are nearer.
                farthest = max(projector_depth[row, x - 1], projector_depth[row, x], projector_depth[row, x + 1])
                if farthest < depth[row, column] * shadow_factor:
                    value = f32(0.0)
            light[row, column] = u16(i32(min(value * fades[column] + half, f32(65535.0))))
