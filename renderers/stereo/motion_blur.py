"""Motion blur: mean of the light of several images of a rectangle, and poses between two frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo.exposure import DISPLAY_GAMMA

_RIGID: Final = 1e-6
"""Maximum deviation of a rotation's product with its transpose from the identity."""


def pose_at(
    X_world_before: NDArray[np.float64], X_world_now: NDArray[np.float64], interval: float
) -> NDArray[np.float64]:
    """Return the pose ``interval`` after ``X_world_now``, in units of the time since ``X_world_before``.

    The origin moves along a line, and the frame turns about it at constant rates. Frames that also change their scale
    are interpolated linearly.

    Args:
        X_world_before: (4, 4) float64, earlier pose.
        X_world_now: (4, 4) float64, pose one unit later.
        interval: may be negative.
    """
    result = X_world_now + interval * (X_world_now - X_world_before)
    before, now = X_world_before[:3, :3], X_world_now[:3, :3]
    if np.array_equal(before, now) or np.linalg.det(before) == 0.0:
        return result
    turn = now @ np.linalg.inv(before)
    if np.abs(turn @ turn.T - np.eye(3)).max() > _RIGID:
        return result
    # Rotation vector times the sine of its angle.
    axis = 0.5 * np.array((turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]))
    sine = math.sqrt(float(axis @ axis))
    if sine < 1e-12:
        return result
    angle = interval * math.atan2(sine, 0.5 * (float(np.trace(turn)) - 1.0))
    x, y, z = axis / sine
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    partial_turn = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    result[:3, :3] = partial_turn @ now
    return result


def write_mean_light(image: NDArray[np.uint8], column: int, row: int, others: Sequence[NDArray[np.uint8]]) -> None:
    """Replace a rectangle of an image by the mean of its light and that of other images of the rectangle.

    Args:
        image: (H, W, 3) uint8, C-contiguous.
        column: left column of the rectangle.
        row: upper row of the rectangle.
        others: (h, w, 3) uint8 each, C-contiguous; at least one, at most 64.
    """
    wait_until_compiled("stereo")
    light_of_level, level_of_light = _tables()
    sums = np.zeros(others[0].shape, np.uint32)
    for other in others:
        add_light(other, light_of_level, sums)
    write_mean(sums, len(others) + 1, light_of_level, level_of_light, row, column, image)


@cache
def _tables() -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
    """Return the light of each level, (256,) uint32, 65535 is white, and the level of each light, (65536,) uint8."""
    light = np.rint(65535.0 * (np.arange(256) / 255.0) ** DISPLAY_GAMMA).astype(np.uint32)
    borders = 65535.0 * ((np.arange(1, 256) - 0.5) / 255.0) ** DISPLAY_GAMMA
    levels = np.searchsorted(borders, np.arange(65536), side="right").astype(np.uint8)
    levels[light] = np.arange(256)  # the two darkest levels have no light in 16 bits
    levels[0] = 0
    return light, levels


@kernel("void(uint8[:,:,::1], uint32[::1], uint32[:,:,::1])")
def add_light(image, light_of_level, sums):
    """Add the light of an image to sums.

    Args:
        image: (h, w, 3) uint8.
        light_of_level: (256,) uint32.
        sums: (h, w, 3) uint32, changed.
    """
    height, width = image.shape[:2]
    for row in range(height):
        for column in range(width):
            for channel in range(3):
                sums[row, column, channel] += light_of_level[image[row, column, channel]]


@kernel("void(uint32[:,:,::1], int64, uint32[::1], uint8[::1], int64, int64, uint8[:,:,::1])")
def write_mean(sums, count, light_of_level, level_of_light, first_row, first_column, image):
    """Write the mean of the light of an image's rectangle and of sums.

    Args:
        sums: (h, w, 3) uint32, sums of the light of ``count`` - 1 images.
        count: number of images, this one included.
        light_of_level: (256,) uint32.
        level_of_light: (65536,) uint8.
        first_row: upper row of the rectangle.
        first_column: left column of the rectangle.
        image: (H, W, 3) uint8, changed.
    """
    height, width = sums.shape[:2]
    divisor, half = np.uint32(count), np.uint32(count // 2)
    for row in range(height):
        for column in range(width):
            for channel in range(3):
                old = light_of_level[image[first_row + row, first_column + column, channel]]
                mean = (sums[row, column, channel] + old + half) // divisor
                image[first_row + row, first_column + column, channel] = level_of_light[mean]
