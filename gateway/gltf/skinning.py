"""Linear blend skinning: moves the vertices of a mesh with the joints that they are bound to."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import address_of, f32_at, stack_array, u16_at
from renderers.stop import current_stop

_MATRIX_NUMBERS: Final = 12
"""Numbers of a joint matrix, (3, 4)."""
_matrix: Final = stack_array(types.float32, _MATRIX_NUMBERS)
_VERTICES_PER_STOP_CHECK: Final = 1 << 14


def skin_vertices(
    positions: NDArray[np.float32],
    normals: NDArray[np.float32] | None,
    tangents: NDArray[np.float32] | None,
    joints: NDArray[np.uint16],
    weights: NDArray[np.float32],
    joint_matrices: NDArray[np.float32],
) -> None:
    """Multiply each vertex, in place, by the weighted mean of its joints' matrices.

    Directions are multiplied by the linear part of the mean, which is exact unless a joint scales its axes differently;
    their lengths may change. Vertices without weights follow their first joint. Arrays are C-contiguous.

    Args:
        positions: (N, 3) float32.
        normals: (N, 3) float32.
        tangents: (N, 4) float32; the last component stays.
        joints: (N, K) uint16, indices of matrices (not checked).
        weights: (N, K) float32.
        joint_matrices: (number of joints, 3, 4) float32.
    """
    stop = current_stop()
    _skin_vertices(
        *(len(positions), joints.shape[1], address_of(positions, np.float32), address_of(normals, np.float32)),
        *(address_of(tangents, np.float32), address_of(joints, np.uint16), address_of(weights, np.float32)),
        *(address_of(joint_matrices, np.float32), stop.address),
    )
    stop.check()


@kernel("void(int64, int64, int64, int64, int64, int64, int64, int64, int64)")
def _skin_vertices(
    count, joint_count, positions_at, normals_at, tangents_at, joints_at, weights_at, joint_matrices_at, stop_at
):
    """Write the result of ``skin_vertices``.

    Args:
        count: N.
        joint_count: K, joints of a vertex.
        positions_at, joints_at, weights_at, joint_matrices_at: addresses of the arguments of ``skin_vertices``.
        normals_at, tangents_at: the same; 0 for none.
        stop_at: address of a ``StopFlag``; the result is incomplete once it is set.
    """
    joints, weights, matrices = u16_at(joints_at), f32_at(weights_at), f32_at(joint_matrices_at)
    mean = _matrix()
    for vertex in range(count):
        if vertex % _VERTICES_PER_STOP_CHECK == 0 and is_set(stop_at):
            return
        first = vertex * joint_count
        total = np.float32(0.0)
        for k in range(first, first + joint_count):
            total += weights[k]
        for i in range(_MATRIX_NUMBERS):
            mean[i] = 0.0
        for k in range(first, first + joint_count):
            if 0.0 < total < np.inf:
                weight = weights[k] / total
            else:
                weight = np.float32(1.0) if k == first else np.float32(0.0)
            if weight != 0.0:
                matrix = _MATRIX_NUMBERS * np.int64(joints[k])
                for i in range(_MATRIX_NUMBERS):
                    mean[i] += weight * matrices[matrix + i]
        for vectors_at, size, w in ((positions_at, 3, 1), (normals_at, 3, 0), (tangents_at, 4, 0)):
            if vectors_at != 0:
                vectors = f32_at(vectors_at)
                v = vertex * size
                x, y, z = vectors[v], vectors[v + 1], vectors[v + 2]
                for row in range(3):
                    m = 4 * row
                    vectors[v + row] = mean[m] * x + mean[m + 1] * y + mean[m + 2] * z + w * mean[m + 3]
