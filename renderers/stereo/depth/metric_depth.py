"""Depth images in millimetres: from disparity, and aligned to the colour camera."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import Array1, Array2
from renderers.stereo.lens.color_camera import ColorCamera
from renderers.stereo.model import DISPARITY_SCALE, Intrinsics

_MAX_MILLIMETRES: Final = 65535
_ROUNDING: Final = 1e-6
"""Tolerance of pixel coordinates, pixels: above their rounding errors."""
_MAX_SIDE: Final = 64.0
"""Maximum width and height of a depth pixel in the colour image, pixels. Larger ones, which are close to the colour
camera, are left out: this limits the time."""


def millimetres_from_disparity(disparity: NDArray[np.uint16], focal_times_baseline: float) -> NDArray[np.uint16]:
    """Return depth along the optical axis, (H, W) uint16, millimetres; 0: invalid, or beyond 65.535 m."""
    by_disparity = np.zeros(65536, np.uint16)
    depth = np.rint(1000.0 * focal_times_baseline / DISPARITY_SCALE / np.arange(1, 65536))
    by_disparity[1:] = np.where(depth <= _MAX_MILLIMETRES, depth, 0)
    return by_disparity[disparity]


def align_depth(depth: NDArray[np.uint16], k: Intrinsics, camera: ColorCamera) -> NDArray[np.uint16]:
    """Return a depth image as seen by the colour camera, (H, W) uint16 of its size, millimetres, 0: invalid.

    Every depth pixel covers the rectangle around its projected corners. Where several overlap, the nearest is kept.

    Args:
        depth: (h, w), millimetres, 0: invalid.
        k: intrinsics of ``depth``, whose camera has the left optical frame.
    """
    target = camera.intrinsics
    X_color_left = np.linalg.inv(camera.X_left_color)
    matrix = target.matrix @ X_color_left[:3, :3] @ np.linalg.inv(k.matrix)
    offset = 1000.0 * target.matrix @ X_color_left[:3, 3]
    aligned = np.zeros((target.height, target.width), np.uint16)
    _splat(depth, np.ascontiguousarray(matrix), np.ascontiguousarray(offset), aligned)
    return aligned


@kernel
def _splat(
    depth: Array2[np.uint16], matrix: Array2[np.float64], offset: Array1[np.float64], aligned: Array2[np.uint16]
) -> None:
    """Write the nearest depth at every pixel of the colour camera; ``aligned`` is 0 at first.

    The product of ``matrix``, (3, 3), with (column, row, 1) times depth, plus ``offset``, are homogeneous pixel
    coordinates in the colour camera, of which the last is the depth there, millimetres.
    """
    height, width = aligned.shape
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            z = float(depth[row, column])
            if z == 0.0:
                continue
            left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
            in_front = True
            for corner in range(4):
                u, v = column + float(corner & 1), row + float(corner >> 1)
                w = (matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2]) * z + offset[2]
                if w < 1.0:
                    in_front = False
                    break
                x = ((matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2]) * z + offset[0]) / w
                y = ((matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2]) * z + offset[1]) / w
                left, right = min(left, x), max(right, x)
                top, bottom = min(top, y), max(bottom, y)
            if not in_front or right - left > _MAX_SIDE or bottom - top > _MAX_SIDE or right <= 0.0 or bottom <= 0.0:
                continue
            # A corner on the border of two pixels must not reach into the second by a rounding error.
            left, top, right, bottom = left + _ROUNDING, top + _ROUNDING, right - _ROUNDING, bottom - _ROUNDING
            u, v = column + 0.5, row + 0.5
            millimetres = int((matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2]) * z + offset[2] + 0.5)
            if millimetres > _MAX_MILLIMETRES:
                continue
            for target_row in range(max(int(top), 0), min(int(np.ceil(bottom)), height)):
                for target_column in range(max(int(left), 0), min(int(np.ceil(right)), width)):
                    nearest = aligned[target_row, target_column]
                    if nearest == 0 or millimetres < nearest:
                        aligned[target_row, target_column] = millimetres
