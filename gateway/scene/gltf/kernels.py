"""The compiled loops of the reader. Nothing is compiled at import: ``warm_up`` does it, or loads it from the cache."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

_BLOCK: Final = np.uint64(4096)
"""Bytes that are compared before a difference is looked for."""

# Arrays of meshes are read-only, and Numba compiles again for writable ones: callers pass read-only views.
_BYTES: Final = types.Array(types.uint8, 1, "C", readonly=True)
_POSITIONS: Final = types.Array(types.float32, 2, "C", readonly=True)
_TRIANGLES: Final = types.Array(types.uint32, 2, "C", readonly=True)
_NORMALS: Final = types.Array(types.float32, 2, "C")


@numba.njit(nogil=True, cache=True, fastmath=False)
def equal_arrays(x: NDArray[np.uint8], y: NDArray[np.uint8]) -> bool:
    """Whether two arrays of one length agree.

    In blocks, so that a difference ends the work early. Indices are unsigned and the difference stays 8 bits wide: only
    then does LLVM use vectors, which makes it 20 times as fast.
    """
    n = np.uint64(len(x))
    whole = n // _BLOCK
    for block in range(np.uint64(0), whole):
        begin = np.uint64(block) * _BLOCK
        difference = np.uint8(0)
        for i in range(np.uint64(0), _BLOCK):
            at = begin + np.uint64(i)
            difference = np.uint8(difference | np.uint8(x[at] ^ y[at]))
        if difference != 0:
            return False
    for last in range(whole * _BLOCK, n):  # noqa: SIM110 - compiled, where all() is none
        if x[last] != y[last]:
            return False
    return True


@numba.njit(nogil=True, cache=True, fastmath=False)
def sum_normals(positions: NDArray[np.float32], triangles: NDArray[np.uint32], normals: NDArray[np.float32]) -> None:
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


def warm_up() -> None:
    """Compiles the kernels, or loads them from Numba's cache. Takes a few seconds of one core when that is empty."""
    equal_arrays.compile((_BYTES, _BYTES))
    sum_normals.compile((_POSITIONS, _TRIANGLES, _NORMALS))
