"""Motion blur: poses during the exposure, and the mean light of images that are rendered at them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import I64, Array1, Array3, u32
from renderers.stereo.sensor.exposure import DISPLAY_GAMMA

_ROTATION_TOLERANCE: Final = 1e-6
"""Maximum element of R R^T - I for which a matrix R counts as a rotation."""


def poses_at(X_world_before: NDArray[np.float64], X_world_now: NDArray[np.float64], time: float) -> NDArray[np.float64]:
    """Return the poses at a time, (N, 4, 4) float64, for constant velocity and angular velocity.

    Poses that differ in more than rotation and translation, for example in scale, are interpolated linearly. All poses
    share the NumPy calls: calls for each pose take 20 times as long.

    Args:
        X_world_before: (N, 4, 4) float64, earlier poses.
        X_world_now: (N, 4, 4) float64, later poses.
        time: 0 is the time of the later poses, -1 that of the earlier ones.
    """
    result = X_world_now + time * (X_world_now - X_world_before)
    before, now = X_world_before[:, :3, :3], X_world_now[:, :3, :3]
    turned = np.flatnonzero((before != now).any(axis=(1, 2)) & (np.linalg.det(before) != 0.0))
    rotation = now[turned] @ np.linalg.inv(before[turned])
    error = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    # Twice the axis of the rotation times the sine of its angle, as a cross product matrix.
    cross = rotation - rotation.transpose(0, 2, 1)
    sine = 0.5 * np.sqrt(cross[:, 2, 1] ** 2 + cross[:, 0, 2] ** 2 + cross[:, 1, 0] ** 2)
    is_rotation = (error <= _ROTATION_TOLERANCE) & (sine >= 1e-12)
    turned, rotation, sine = turned[is_rotation], rotation[is_rotation], sine[is_rotation]
    angle = time * np.arctan2(sine, 0.5 * (rotation.trace(axis1=1, axis2=2) - 1.0))[:, None, None]
    cross = cross[is_rotation] / (2.0 * sine[:, None, None])
    partial_rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    result[turned, :3, :3] = partial_rotation @ now[turned]
    return result


def write_mean_light(image: NDArray[np.uint8], column: int, row: int, others: Sequence[NDArray[np.uint8]]) -> None:
    """Replace a rectangle of an image by the mean light of this and other images of the rectangle.

    Args:
        image: (H, W, 3) uint8, C-contiguous.
        column: left column of the rectangle.
        row: upper row of the rectangle.
        others: (h, w, 3) uint8 each, C-contiguous: other images of the rectangle; at least one, at most 64.
    """
    light_of_level, level_of_light = _light_tables()
    sums = np.zeros(others[0].shape, np.uint32)
    for other in others:
        add_light(other, light_of_level, sums)
    write_mean(sums, len(others) + 1, light_of_level, level_of_light, row, column, image)


@cache
def _light_tables() -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
    """Return the light of each level, (256,) uint32, and the level of each light, (65536,) uint8; 65535 is white."""
    light = np.rint(65535.0 * (np.arange(256) / 255.0) ** DISPLAY_GAMMA).astype(np.uint32)
    borders = 65535.0 * ((np.arange(1, 256) - 0.5) / 255.0) ** DISPLAY_GAMMA
    levels = np.searchsorted(borders, np.arange(65536), side="right").astype(np.uint8)
    levels[light] = np.arange(256)  # levels 0 and 1 both have the light 0 in 16 bits
    levels[0] = 0
    return light, levels


@kernel
def add_light(image: Array3[np.uint8], light_of_level: Array1[np.uint32], sums: Array3[np.uint32]) -> None:
    """Add the light of an image to sums of light.

    Args:
        image: (h, w, 3).
        light_of_level: (256,), ``_light_tables``.
        sums: (h, w, 3), changed.
    """
    height, width = image.shape[:2]
    for row in range(height):
        for column in range(width):
            for channel in range(3):
                sums[row, column, channel] += light_of_level[image[row, column, channel]]


@kernel
def write_mean(
    sums: Array3[np.uint32],
    count: I64,
    light_of_level: Array1[np.uint32],
    level_of_light: Array1[np.uint8],
    first_row: I64,
    first_column: I64,
    image: Array3[np.uint8],
) -> None:
    """Write the mean light of a rectangle of an image and of other images.

    Args:
        sums: (h, w, 3), sums of the light of ``count`` - 1 images.
        count: number of images, ``image`` included.
        light_of_level: (256,), ``_light_tables``.
        level_of_light: (65536,), ``_light_tables``.
        first_row: upper row of the rectangle.
        first_column: left column of the rectangle.
        image: (H, W, 3), changed.
    """
    height, width = sums.shape[:2]
    divisor, half = u32(count), u32(count // 2)
    for row in range(height):
        for column in range(width):
            for channel in range(3):
                old = light_of_level[image[first_row + row, first_column + column, channel]]
                mean = (sums[row, column, channel] + old + half) // divisor
                image[first_row + row, first_column + column, channel] = level_of_light[mean]
