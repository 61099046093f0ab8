"""Vertex normals: computed for primitives without stored normals, and scaled to unit length."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pending import wait_until_compiled
from renderers.compiler.pointers import address_of, f32_at, f64_at, u32_at
from renderers.stop import check_stop, current_stop

_ROWS_PER_STOP_CHECK: Final = 1 << 18
"""Vectors that NumPy processes between two checks of the ``StopFlag``."""
_KERNEL_STEPS_PER_STOP_CHECK: Final = 1 << 16
"""Triangles or vertices that the kernel processes between two checks of the ``StopFlag``."""
_UNIT_TOLERANCE: Final = 1e-3
"""Maximum deviation of a vector's length from 1 at which the vector is left as it is."""


def vertex_normals(positions: NDArray[np.float32], triangles: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return vertex normals as RenderEngineVtk computes them.

    A vertex normal is the sum of the cross products of the vertex's triangles, so large triangles have more weight.
    Vertices with different indices at the same position are separate: a box of 24 vertices keeps flat faces.

    Args:
        positions: (N, 3) float32, finite, C-contiguous.
        triangles: (M, 3) uint32, C-contiguous, every value < N (not checked).

    Returns:
        (N, 3) float32, unit length; (0, 0, 1) for vertices without a triangle of positive area.
    """
    wait_until_compiled("formats")
    normals, sums = np.empty(positions.shape, np.float32), np.zeros(positions.shape, np.float64)
    stop = current_stop()
    _write_vertex_normals(
        *(address_of(positions, np.float32), len(positions), address_of(triangles, np.uint32), len(triangles)),
        *(address_of(sums, np.float64), address_of(normals, np.float32), stop.address),
    )
    stop.check()
    return normals


@kernel("void(int64, int64, int64, int64, int64, int64, int64)")
def _write_vertex_normals(positions_at, vertex_count, triangles_at, triangle_count, sums_at, normals_at, stop_at):
    """Write the result of ``vertex_normals``.

    A triangle a, b, c adds u x v to the sums of its vertices, with u = b - a and v = c - a. Sums are float64, in the
    order of the triangles.

    Args:
        positions_at, triangles_at: addresses of the arguments of ``vertex_normals``.
        sums_at: address of scratch memory: (vertex_count, 3) float64, zeros.
        normals_at: address of the result, (vertex_count, 3) float32.
        stop_at: address of a ``StopFlag``; the result is incomplete once it is set.
    """
    positions, triangles = f32_at(positions_at), u32_at(triangles_at)
    sums, normals = f64_at(sums_at), f32_at(normals_at)
    for triangle in range(triangle_count):
        if triangle % _KERNEL_STEPS_PER_STOP_CHECK == 0 and is_set(stop_at):
            return
        a, b, c = (
            3 * np.int64(triangles[3 * triangle]),
            3 * np.int64(triangles[3 * triangle + 1]),
            3 * np.int64(triangles[3 * triangle + 2]),
        )
        x, y, z = np.float64(positions[a]), np.float64(positions[a + 1]), np.float64(positions[a + 2])
        ux, uy, uz = positions[b] - x, positions[b + 1] - y, positions[b + 2] - z
        vx, vy, vz = positions[c] - x, positions[c + 1] - y, positions[c + 2] - z
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for corner in (a, b, c):
            sums[corner] += nx
            sums[corner + 1] += ny
            sums[corner + 2] += nz
    for vertex in range(vertex_count):
        if vertex % _KERNEL_STEPS_PER_STOP_CHECK == 0 and is_set(stop_at):
            return
        k = 3 * vertex
        x, y, z = sums[k], sums[k + 1], sums[k + 2]
        length = math.sqrt(x * x + y * y + z * z)
        if 0.0 < length < np.inf:
            scale = 1.0 / length
            normals[k], normals[k + 1], normals[k + 2] = x * scale, y * scale, z * scale
        else:
            normals[k], normals[k + 1], normals[k + 2] = 0.0, 0.0, 1.0


def unit_rows(vectors: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Scale rows to unit length; return them as they are if all lengths are 1 within 0.1 %.

    Args:
        vectors: (N, 3) float32.

    Returns:
        (N, 3) float32, and (N,) bool: True for rows without a direction (zero or not finite), which are not scaled.
    """
    invalid = np.zeros(len(vectors), np.bool_)
    block_size = _ROWS_PER_STOP_CHECK
    blocks = [slice(begin, begin + block_size) for begin in range(0, len(vectors), block_size)]
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
