"""Linear blend skinning: moves the vertices of a mesh with the joints that they are bound to."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import address_of, f32_at, u16_at
from renderers.stop import current_stop

_MATRIX_NUMBERS: Final = 12
"""Numbers of a joint matrix, (3, 4)."""
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
    for vertex in range(count):
        if vertex % _VERTICES_PER_STOP_CHECK == 0 and is_set(stop_at):
            return
        first = vertex * joint_count
        total = np.float32(0.0)
        for k in range(first, first + joint_count):
            total += weights[k]
        m00 = m01 = m02 = m03 = m10 = m11 = m12 = m13 = m20 = m21 = m22 = m23 = np.float32(0.0)
        for k in range(first, first + joint_count):
            if 0.0 < total < np.inf:
                weight = weights[k] / total
            else:
                weight = np.float32(1.0) if k == first else np.float32(0.0)
            if weight != 0.0:
                m = _MATRIX_NUMBERS * np.int64(joints[k])
                m00, m01, m02, m03 = (
                    m00 + weight * matrices[m],
                    m01 + weight * matrices[m + 1],
                    m02 + weight * matrices[m + 2],
                    m03 + weight * matrices[m + 3],
                )
                m10, m11, m12, m13 = (
                    m10 + weight * matrices[m + 4],
                    m11 + weight * matrices[m + 5],
                    m12 + weight * matrices[m + 6],
                    m13 + weight * matrices[m + 7],
                )
                m20, m21, m22, m23 = (
                    m20 + weight * matrices[m + 8],
                    m21 + weight * matrices[m + 9],
                    m22 + weight * matrices[m + 10],
                    m23 + weight * matrices[m + 11],
                )
        for vectors_at, size, w in ((positions_at, 3, 1), (normals_at, 3, 0), (tangents_at, 4, 0)):
            if vectors_at != 0:
                vectors = f32_at(vectors_at)
                v = vertex * size
                x, y, z = vectors[v], vectors[v + 1], vectors[v + 2]
                vectors[v] = m00 * x + m01 * y + m02 * z + w * m03
                vectors[v + 1] = m10 * x + m11 * y + m12 * z + w * m13
                vectors[v + 2] = m20 * x + m21 * y + m22 * z + w * m23
