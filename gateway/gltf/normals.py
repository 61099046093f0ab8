"""Vertex normals: computed for primitives without, and scaled to unit length."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numba import types
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.kernel_calls import is_set
from renderers.stop import check_stop, current_stop

_ROWS_PER_STOP_CHECK: Final = 1 << 18
"""Vectors that NumPy processes between two checks of the ``StopFlag``."""
_KERNEL_STEPS_PER_STOP_CHECK: Final = 1 << 16
"""Triangles or vertices that the kernel processes between two checks of the ``StopFlag``."""
_UNIT_TOLERANCE: Final = 1e-3
"""Maximum deviation of a given normal's length from 1 that is left as it is."""


def vertex_normals(positions: NDArray[np.float32], triangles: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return normals like RenderEngineVtk's: cross products, hence weighted by area, summed per vertex *index*.

    Vertices at the same position stay separate, so boxes of 24 vertices stay flat.

    Args:
        positions: (N, 3) float32, finite, C-contiguous.
        triangles: (M, 3) uint32, C-contiguous, every value < N (not checked).

    Returns:
        (N, 3) float32, unit length; (0, 0, 1) for vertices of no triangle with an area.
    """
    normals = np.empty(positions.shape, np.float32)
    stop = current_stop()
    _write_vertex_normals(_read_only(positions), _read_only(triangles), normals, stop.address)
    stop.check()
    return normals


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only array: Numba would compile the kernel again for writable ones."""
    if not array.flags.writeable:
        return array
    view = array.view()
    view.setflags(write=False)
    return view


@cached_njit(nogil=True, error_model="numpy")
def _write_vertex_normals(
    positions: NDArray[np.float32], triangles: NDArray[np.uint32], normals: NDArray[np.float32], stop: int
) -> None:
    """Write the result of ``vertex_normals``.

    A triangle a, b, c adds u x v to the sums of its vertices, with u = b - a and v = c - a. Sums are float64, in the
    order of the triangles.

    Args:
        stop: Address of a ``StopFlag``; the result is incomplete once it is set.
    """
    sums = np.zeros((len(positions), 3), np.float64)
    for triangle in range(len(triangles)):
        if triangle % _KERNEL_STEPS_PER_STOP_CHECK == 0 and is_set(stop):
            return
        a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
        x, y, z = np.float64(positions[a, 0]), np.float64(positions[a, 1]), np.float64(positions[a, 2])
        ux, uy, uz = positions[b, 0] - x, positions[b, 1] - y, positions[b, 2] - z
        vx, vy, vz = positions[c, 0] - x, positions[c, 1] - y, positions[c, 2] - z
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for vertex in (a, b, c):
            sums[vertex, 0] += nx
            sums[vertex, 1] += ny
            sums[vertex, 2] += nz
    for vertex in range(len(positions)):
        if vertex % _KERNEL_STEPS_PER_STOP_CHECK == 0 and is_set(stop):
            return
        x, y, z = sums[vertex, 0], sums[vertex, 1], sums[vertex, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if 0.0 < length < np.inf:
            scale = 1.0 / length
            normals[vertex, 0], normals[vertex, 1], normals[vertex, 2] = x * scale, y * scale, z * scale
        else:
            normals[vertex, 0], normals[vertex, 1], normals[vertex, 2] = 0.0, 0.0, 1.0


def unit_rows(vectors: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Scale rows to unit length, unless all of them have it within 0.1 %.

    Args:
        vectors: (N, 3) float32.

    Returns:
        (N, 3) float32, and (N,) bool: True for rows without a direction (zero or not finite), which stay as they are.
    """
    invalid = np.zeros(len(vectors), np.bool_)
    step = _ROWS_PER_STOP_CHECK
    blocks = [slice(begin, begin + step) for begin in range(0, len(vectors), step)]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        if all(_are_unit_length(vectors[block]) for block in blocks):
            return vectors, invalid
        units = np.empty(vectors.shape, np.float32)
        for block in blocks:
            check_stop()
            float64_vectors = vectors[block].astype(np.float64)
            lengths = np.sqrt(np.einsum("ij,ij->i", float64_vectors, float64_vectors))
            invalid[block] = ~(np.isfinite(lengths) & (lengths > 0.0))
            lengths[invalid[block]] = 1.0
            units[block] = float64_vectors / lengths[:, None]
        return units, invalid


def _are_unit_length(vectors: NDArray[np.float32]) -> bool:
    check_stop()
    x, y, z = vectors.T
    squared_lengths = x * x + y * y + z * z
    return bool((np.abs(squared_lengths - 1.0) <= 2.0 * _UNIT_TOLERANCE).all())


def warm_up() -> None:
    """Compile the kernel, or load it from the kernel cache."""
    positions = types.Array(types.float32, 2, "C", readonly=True)
    triangles = types.Array(types.uint32, 2, "C", readonly=True)
    _write_vertex_normals.compile((positions, triangles, types.float32[:, ::1], types.int64))
