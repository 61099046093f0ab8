"""Tangents for meshes that carry a normal map but no tangents."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.stop import check_stop

_BLOCK: Final = 1 << 16
"""Triangles or vertices worked on at a time, between two looks at the ``StopFlag``."""


def _finite(values: NDArray[np.float32]) -> NDArray[np.float64]:
    """As float64, 0 for what is not within +-1e18 (whose products float64 holds)."""
    wide = values.astype(np.float64)
    return np.where(np.abs(wide) < 1e18, wide, 0.0)


def vertex_tangents(
    positions: NDArray[np.float32], uv: NDArray[np.float32], triangles: NDArray[np.uint32]
) -> NDArray[np.float32]:
    """(N, 4) float32: the direction of growing u at each vertex, and the bitangent's handedness.

    The triangles' tangents (Lengyel, "Computing Tangent Space Basis Vectors for an Arbitrary Mesh") are summed over
    the triangles that share a vertex, weighted by area; vertices on seams are separate ones in glTF. A vertex without
    a usable triangle gets zeros, and the kernels then leave its normal as it is. Not orthogonal to the normals: the
    kernels do that per pixel.

    Args:
        positions: (N, 3) float32.
        uv: (N, 2) float32, v downwards as in glTF.
        triangles: (M, 3) uint32.

    Raises:
        Exception: the current ``StopFlag`` was set.
    """
    count = len(positions)
    sums = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    for first in range(0, len(triangles), _BLOCK):
        check_stop()
        some = triangles[first : first + _BLOCK]
        # What is not a number, or beyond float32's use, makes its triangles unusable, not their neighbours.
        for values, total in zip(_weighted(_finite(positions[some]), _finite(uv[some])), sums, strict=True):
            for axis in range(3):
                np.add.at(total[:, axis], some.reshape(-1), np.repeat(values[:, axis], 3))  # in a fixed order
    result = np.zeros((count, 4), dtype=np.float32)
    for first in range(0, count, _BLOCK):
        check_stop()
        u, v, n = (total[first : first + _BLOCK] for total in sums)
        out = result[first : first + _BLOCK]
        length = np.linalg.norm(u, axis=1, keepdims=True)
        out[:, :3] = np.where(length > 0.0, u / np.where(length > 0.0, length, 1.0), 0.0)
        # glTF 3.7.2.1: bitangent = cross(normal, tangent) * w. With v downwards in the picture and upwards in tangent
        # space (glTF 3.9.3: +Y is up), the bitangent points against the direction of growing v.
        facing = np.einsum("ij,ij->i", np.cross(n, u), v)
        out[:, 3] = np.where(facing > 0.0, -1.0, 1.0)
    return result


def _weighted(corner: NDArray[np.float64], at: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Directions of growing u and v and the normals of triangles, (M, 3) each, all as long as the area is large.

    Args:
        corner: (M, 3, 3), positions. at: (M, 3, 2), texture coordinates.
    """
    e1, e2 = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    d1, d2 = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
    determinant = d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1]
    sign = np.sign(determinant)[:, None]
    along_u = sign * (e1 * d2[:, 1:] - e2 * d1[:, 1:])
    along_v = sign * (e2 * d1[:, :1] - e1 * d2[:, :1])
    area = np.linalg.norm(np.cross(e1, e2), axis=1, keepdims=True)

    def weighted(v: NDArray[np.float64]) -> NDArray[np.float64]:
        length = np.linalg.norm(v, axis=1, keepdims=True)
        return np.where(length > 0.0, v / np.where(length > 0.0, length, 1.0) * area, 0.0)

    return weighted(along_u), weighted(along_v), np.cross(e1, e2)
