"""Normals for meshes that come without, or with bad ones."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

# Arrays of meshes are read-only; writable ones are accepted where read-only ones are declared.
_POSITIONS = numba.types.Array(numba.float32, 2, "C", readonly=True)
_TRIANGLES = numba.types.Array(numba.uint32, 2, "C", readonly=True)


@numba.njit(numba.void(_POSITIONS, _TRIANGLES, numba.float32[:, ::1]), nogil=True, cache=True, fastmath=False)
def _accumulate(positions: NDArray[np.float32], triangles: NDArray[np.uint32], normals: NDArray[np.float32]) -> None:
    """Adds each triangle's cross product to its three vertices, then normalises; (0, 0, 1) where nothing was added."""
    sums = np.zeros(positions.shape, np.float64)
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, az = np.float64(positions[a, 0]), np.float64(positions[a, 1]), np.float64(positions[a, 2])
        ux, uy, uz = positions[b, 0] - ax, positions[b, 1] - ay, positions[b, 2] - az
        vx, vy, vz = positions[c, 0] - ax, positions[c, 1] - ay, positions[c, 2] - az
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        sums[a, 0] += nx
        sums[a, 1] += ny
        sums[a, 2] += nz
        sums[b, 0] += nx
        sums[b, 1] += ny
        sums[b, 2] += nz
        sums[c, 0] += nx
        sums[c, 1] += ny
        sums[c, 2] += nz
    for i in range(positions.shape[0]):
        length = np.sqrt(sums[i, 0] * sums[i, 0] + sums[i, 1] * sums[i, 1] + sums[i, 2] * sums[i, 2])
        if length > 0.0 and length < np.inf:
            normals[i, 0] = np.float32(sums[i, 0] / length)
            normals[i, 1] = np.float32(sums[i, 1] / length)
            normals[i, 2] = np.float32(sums[i, 2] / length)
        else:
            normals[i, 0] = np.float32(0.0)
            normals[i, 1] = np.float32(0.0)
            normals[i, 2] = np.float32(1.0)


def vertex_normals(positions: NDArray[np.float32], triangles: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Normals as RenderEngineVtk shows them: cross products, hence weighted by area, summed per vertex *index*.

    Vertices at the same place stay apart, so boxes of 24 vertices stay flat.

    Args:
        positions: (N, 3) float32, finite, C-contiguous.
        triangles: (M, 3) uint32, C-contiguous, every value < N (not checked).

    Returns:
        (N, 3) float32, unit length; (0, 0, 1) for vertices of no triangle with an area.
    """
    normals = np.empty(positions.shape, np.float32)
    _accumulate(positions, triangles, normals)
    return normals


def unit_rows(vectors: NDArray[np.float32], tolerance: float = 1e-3) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The rows at unit length (unchanged if all of them are within ``tolerance``), and which rows have no direction.

    Args:
        vectors: (N, 3) float32.

    Returns:
        (N, 3) float32 and (N,) bool: True where the row is zero or not finite; such rows are as they were.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        squares = np.einsum("ij,ij->i", vectors, vectors)
        if bool((np.abs(squares - 1.0) <= 2.0 * tolerance).all()):
            return vectors, np.zeros(len(vectors), np.bool_)
        wide = vectors.astype(np.float64)
        lengths = np.sqrt(np.einsum("ij,ij->i", wide, wide))
        bad = ~(np.isfinite(lengths) & (lengths > 0.0))
        lengths[bad] = 1.0
        return (wide / lengths[:, None]).astype(np.float32), bad
