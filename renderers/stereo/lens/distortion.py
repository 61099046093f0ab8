"""Images before rectification: lens distortion, and a camera that is turned against the other one.

The model is OpenCV's, which calibration programs estimate. A point at (x, y) on the plane at distance 1 appears at
(x, y) (1 + k1 r² + k2 r⁴ + k3 r⁶) + (2 p1 x y + p2 (r² + 2 x²), p1 (r² + 2 y²) + 2 p2 x y).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.stereo.model import Intrinsics

MAX_ENLARGEMENT: Final = 2.0
"""Maximum width and height of the image to render for a distorted one, relative to that one."""
_MAX_RESIDUAL: Final = 0.01
"""Maximum error of the inverse of the distortion, pixels."""
_ITERATIONS: Final = 50
"""Maximum number of steps of the inverse. Lenses of cameras need about ten."""
_CHECKED: Final = 65
"""Columns and rows of points at which a distortion is checked."""
_BORDER: Final = 2
"""Pixels to render around the part of the image that is needed, for the interpolation."""


@dataclass(frozen=True, slots=True)
class Distortion:
    """Lenses and alignment of a stereo camera before rectification."""

    coefficients: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 of both lenses."""
    right_rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector of the right camera's frame in the rectified one, radians."""


def raw_pose(X_world_camera: NDArray[np.float64], distortion: Distortion, *, right: bool) -> NDArray[np.float64]:
    """Return the pose of a camera before rectification, (4, 4) float64, for its rectified pose."""
    pose = X_world_camera.copy()
    if right:
        pose[:3, :3] @= cv2.Rodrigues(np.array(distortion.right_rotation))[0]
    return pose


def check_distortion(distortion: Distortion, k: Intrinsics) -> None:
    """Check that an image can be distorted.

    Raises:
        ValueError: the distortion has no inverse inside the image, or it needs too large an image.
    """
    steps = np.arange(_CHECKED) / (_CHECKED - 1.0)
    _undistorted(distortion, k, steps * k.width, steps * k.height)


def distorted_image(
    render: Callable[[Camera], NDArray[np.uint8]], camera: Camera, k: Intrinsics, distortion: Distortion
) -> NDArray[np.uint8]:
    """Return the image of a camera with a real lens, (H, W, 3) uint8.

    Args:
        render: returns the (h, w, 3) uint8 image of a pinhole camera.
        camera: the camera without distortion; its pose and clipping planes count.
        k: intrinsics of the image.
        distortion: lens.
    """
    x, y = _undistorted(distortion, k, np.arange(k.width) + 0.5, np.arange(k.height) + 0.5)
    left, top = math.floor(float(x.min())) - _BORDER, math.floor(float(y.min())) - _BORDER
    width, height = math.ceil(float(x.max())) + _BORDER - left, math.ceil(float(y.max())) + _BORDER - top
    f = k.focal_length
    pinhole = Camera(width, height, f, f, k.cx - left, k.cy - top, camera.near, camera.far, camera.X_world_camera)
    # The centre of OpenCV's first pixel is at 0, ours at 0.5.
    columns, rows = (x - left - 0.5).astype(np.float32), (y - top - 0.5).astype(np.float32)
    return np.asarray(cv2.remap(render(pinhole), columns, rows, cv2.INTER_LINEAR), np.uint8)


def _undistorted(
    distortion: Distortion, k: Intrinsics, columns: NDArray[np.floating], rows: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the points of a grid would be in an image without distortion, two (R, C) float64, pixels.

    Args:
        distortion: lens.
        k: intrinsics of the image.
        columns: (C,) float64, x of the points in the distorted image, pixels.
        rows: (R,) float64, y of the points, pixels.

    Raises:
        ValueError: as ``check_distortion``.
    """
    seen_x, seen_y = np.meshgrid((columns - k.cx) / k.focal_length, (rows - k.cy) / k.focal_length)
    x, y = seen_x, seen_y
    with np.errstate(all="ignore"):  # a distortion without inverse diverges
        for _ in range(_ITERATIONS):
            radial, tangential_x, tangential_y = _terms(distortion, x, y)
            error = max(
                np.abs(x * radial + tangential_x - seen_x).max(), np.abs(y * radial + tangential_y - seen_y).max()
            )
            if not error * k.focal_length > _MAX_RESIDUAL:
                break
            x, y = (seen_x - tangential_x) / radial, (seen_y - tangential_y) / radial
    if not error * k.focal_length <= _MAX_RESIDUAL:  # also NaN
        raise ValueError("the distortion has no inverse inside the image")
    x, y = x * k.focal_length + k.cx, y * k.focal_length + k.cy
    if np.ptp(x) > MAX_ENLARGEMENT * k.width or np.ptp(y) > MAX_ENLARGEMENT * k.height:
        raise ValueError(f"the undistorted image is more than {MAX_ENLARGEMENT:g} times as wide or high")
    return x, y


def _terms(
    distortion: Distortion, x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the radial factor and the tangential shifts along x and y at points on the plane at distance 1."""
    k1, k2, p1, p2, k3 = distortion.coefficients
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return radial, 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
