"""Analytic depth images of a plane and a sphere, from a camera at any x of the left camera's frame."""

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.model import Intrinsics


def rays(k: Intrinsics) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(H, W) float64 each: x and y of the ray of every pixel's centre at depth 1."""
    x = (np.arange(k.width) + 0.5 - k.cx) / k.focal_length
    y = (np.arange(k.height) + 0.5 - k.cy) / k.focal_length
    return np.broadcast_to(x, (k.height, k.width)), np.broadcast_to(y[:, None], (k.height, k.width))


def plane(
    k: Intrinsics, offset: float, depth: float, slope_x: float = 0.0, slope_y: float = 0.0
) -> NDArray[np.float32]:
    """Return the depth of the plane z = depth + slope_x x + slope_y y from a camera at x = offset."""
    rx, ry = rays(k)
    with np.errstate(divide="ignore"):
        z = (depth + slope_x * offset) / (1.0 - slope_x * rx - slope_y * ry)
    return np.where(z > 0, z, np.inf).astype(np.float32)


def sphere(k: Intrinsics, offset: float, center: tuple[float, float, float], radius: float) -> NDArray[np.float32]:
    """Return the depth of a sphere from a camera at x = offset; +inf: background."""
    rx, ry = rays(k)
    cx, cy, cz = center[0] - offset, center[1], center[2]
    a = rx**2 + ry**2 + 1.0
    b = rx * cx + ry * cy + cz
    root = b**2 - a * (cx**2 + cy**2 + cz**2 - radius**2)
    with np.errstate(invalid="ignore"):
        z = np.where(root >= 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    return z.astype(np.float32)
