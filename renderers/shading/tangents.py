"""Tangents for meshes that carry a normal map but no tangents."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


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
    """
    # What is not a number, or beyond float32's use, makes its triangles unusable, not their neighbours.
    corner = _finite(positions)[triangles]
    at = _finite(uv)[triangles]
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

    normal = np.cross(e1, e2)
    count = len(positions)
    u_sum, v_sum, n_sum = (np.zeros((count, 3)) for _ in range(3))
    for values, total in ((weighted(along_u), u_sum), (weighted(along_v), v_sum), (normal, n_sum)):
        for axis in range(3):
            # bincount adds in a fixed order, unlike a threaded sum.
            each = np.repeat(values[:, axis], 3)
            total[:, axis] = np.bincount(triangles.reshape(-1), weights=each, minlength=count)
    length = np.linalg.norm(u_sum, axis=1, keepdims=True)
    result = np.zeros((count, 4), dtype=np.float32)
    result[:, :3] = np.where(length > 0.0, u_sum / np.where(length > 0.0, length, 1.0), 0.0)
    # glTF 3.7.2.1: bitangent = cross(normal, tangent) * w. With v downwards in the picture and upwards in tangent
    # space (glTF 3.9.3: +Y is up), the bitangent points against the direction of growing v.
    facing = np.einsum("ij,ij->i", np.cross(n_sum, u_sum), v_sum)
    result[:, 3] = np.where(facing > 0.0, -1.0, 1.0)
    return result
