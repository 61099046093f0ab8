"""Motion blur: poses during the exposure, and the mean light of images that are rendered at them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

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
    height, width = others[0].shape[:2]
    part, count = image[row : row + height, column : column + width], len(others) + 1
    sums = cv2.LUT(part, light_of_level)
    for other in others:
        cv2.add(sums, cv2.LUT(other, light_of_level), dst=sums)
    part[:] = level_of_light[(sums + count // 2) // count]


@cache
def _light_tables() -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """Return the light of each level, (256,) int32, and the level of each light, (65536,) uint8; 65535 is white."""
    light = np.rint(65535.0 * (np.arange(256) / 255.0) ** DISPLAY_GAMMA).astype(np.int32)
    borders = 65535.0 * ((np.arange(1, 256) - 0.5) / 255.0) ** DISPLAY_GAMMA
    levels = np.searchsorted(borders, np.arange(65536), side="right").astype(np.uint8)
    levels[light] = np.arange(256)  # levels 0 and 1 both have the light 0 in 16 bits
    levels[0] = 0
    return light, levels
