"""Silhouettes of triangle meshes by casting a ray through each pixel (Möller and Trumbore, 1997), with NumPy alone."""

import numpy as np
from numpy.typing import NDArray

BLOCK = 200_000
"""Number of pairs of rays and triangles at a time."""


def cast(
    points: NDArray[np.float64], triangles: NDArray[np.integer], K: NDArray[np.float64], width: int, height: int
) -> NDArray[np.float64]:
    """Return the depth of a mesh, (H, W), inf where it is not seen.

    Args:
        points: (N, 3) in the optical frame.
        triangles: (M, 3).
        K: (3, 3), of pixels whose centres have whole coordinates, as OpenCV counts them.
    """
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    rays = np.stack((columns, rows, np.ones_like(rows)), axis=-1).reshape(-1, 3) @ np.linalg.inv(K).T
    a, b, c = points[triangles].transpose(1, 0, 2)
    depth = np.full(len(rays), np.inf)
    ab, ac = b - a, c - a
    q = np.cross(-a, ab)
    for begin in range(0, len(rays), step := max(1, BLOCK // len(triangles))):
        ray = rays[begin : begin + step, None]
        p = np.cross(ray, ac)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / (p * ab).sum(axis=-1)
            u = (p * -a).sum(axis=-1) * inverse
            v = (ray * q).sum(axis=-1) * inverse
            t = (ac * q).sum(axis=-1) * inverse
            hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)
        depth[begin : begin + step] = np.where(hit, t, np.inf).min(axis=1)
    return depth.reshape(height, width)
