"""Tangents for meshes that have none: MikkTSpace, as glTF 2.0 (3.7.2.1) requires.

Sources: M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited" (2008), chapter 5, and the documentation of his
implementation. Corners with the same position, normal and texture coordinates are one vertex. Triangles around a vertex
that share edges and have the same handedness form a group. A corner's tangent is the mean of its group's tangents,
projected into the plane of the normal and weighted by the angle at the corner. A vertex where the handedness changes
has two tangents and is split.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import F64, I64, Address, Array1, Array2, u64
from renderers.drawlist import Mesh, Topology
from renderers.shading.vec3 import dot, minus, times
from renderers.splitmix import GAMMA, mix
from renderers.stop import current_stop

_BLOCK: Final = 1 << 14
"""Number of corners, triangles or vertices between two checks of the ``StopFlag``."""


def with_tangents(mesh: Mesh, uv_set: int) -> Mesh:
    """Return the mesh with tangents for a set of texture coordinates (0 or 1), without unused vertices.

    A mesh that has tangents, or has no texture coordinates or triangles, is returned unchanged. A mesh without normals
    gets those of its faces.
    """
    if mesh.tangents is not None or mesh.topology is not Topology.TRIANGLES:
        return mesh
    if mesh.normals is None:
        mesh = _with_flat_normals(mesh)
    uv = mesh.uv1 if uv_set == 1 else mesh.uv0
    if uv is None or mesh.normals is None:
        return mesh
    tangents = corner_tangents(mesh.positions, mesh.normals, uv, mesh.elements)
    corner_vertex = mesh.elements.reshape(-1).astype(np.intp)
    # Each vertex gets the tangent of its first corner: corners are reversed, since the last assignment counts.
    first_corner = np.full(len(mesh.positions), -1, np.intp)
    first_corner[corner_vertex[::-1]] = np.arange(len(corner_vertex) - 1, -1, -1)
    is_used = first_corner >= 0
    # Corners with a different tangent get vertices of their own.
    split_corners = np.flatnonzero((tangents != tangents[first_corner[corner_vertex]]).any(axis=1))
    indices = (np.cumsum(is_used) - 1)[corner_vertex]
    indices[split_corners] = np.count_nonzero(is_used) + np.arange(len(split_corners))
    source_corner = np.concatenate((first_corner[is_used], split_corners))
    vertex = corner_vertex[source_corner]
    return Mesh(
        mesh.positions[vertex],
        indices.reshape(-1, 3).astype(np.uint32),
        mesh.normals[vertex],
        None if mesh.uv0 is None else mesh.uv0[vertex],
        None if mesh.uv1 is None else mesh.uv1[vertex],
        None if mesh.colors is None else mesh.colors[vertex],
        tangents[source_corner],
    )


def _with_flat_normals(mesh: Mesh) -> Mesh:
    """Return triangles that share no vertices, with the normals of their faces."""
    corner_vertex = mesh.elements.reshape(-1)
    a, b, c = mesh.positions[mesh.elements].astype(np.float64).transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    return Mesh(
        mesh.positions[corner_vertex],
        np.arange(len(corner_vertex), dtype=np.uint32).reshape(-1, 3),
        np.repeat(normals.astype(np.float32), 3, axis=0),
        None if mesh.uv0 is None else mesh.uv0[corner_vertex],
        None if mesh.uv1 is None else mesh.uv1[corner_vertex],
        None if mesh.colors is None else mesh.colors[corner_vertex],
    )


def corner_tangents(
    positions: NDArray[np.float32], normals: NDArray[np.float32], uv: NDArray[np.float32], triangles: NDArray[np.uint32]
) -> NDArray[np.float32]:
    """Return the unit tangent and the bitangent's handedness at every corner of every triangle, (3 M, 4) float32.

    Args:
        positions, normals: (N, 3).
        uv: (N, 2), v downwards as in glTF.
        triangles: (M, 3).

    Raises:
        Exception: the current ``StopFlag`` was set.
    """
    stop = current_stop()
    corner_vertex = triangles.reshape(-1).astype(np.int64)
    rows = np.concatenate((positions, normals, uv), axis=1)
    stop.check()
    # Huge and non-finite values become 0, and so does -0.
    rows = np.where(np.abs(rows) < 1e18, rows, np.float32(0.0)) + np.float32(0.0)
    stop.check()
    p, n, t = (np.ascontiguousarray(part, np.float64) for part in (rows[:, :3], rows[:, 3:6], rows[:, 6:]))
    stop.check()
    first_equal = np.empty(len(rows), np.int64)
    _find_equal_rows(np.ascontiguousarray(rows).view(np.int64), first_equal, _hash_table(len(rows)), stop.address)
    stop.check()
    tangents = np.zeros((len(corner_vertex), 4), np.float32)
    table = _hash_table(len(corner_vertex))
    _compute_tangents(p, n, t, corner_vertex, first_equal[corner_vertex], table, tangents, stop.address)
    stop.check()
    return tangents


def _hash_table(count: int) -> NDArray[np.int64]:
    """Return an empty hash table for ``count`` entries: -1 in at least twice as many slots, a power of two."""
    return np.full(1 << max(2 * count - 1, 1).bit_length(), -1, np.int64)


@kernel
def _find_equal_rows(
    rows: Array2[np.int64], first_equal: Array1[np.int64], table: Array1[np.int64], stop_address: Address
) -> None:
    """Fill ``first_equal`` with the index of the first equal row for every row; ``table``: a ``_hash_table``."""
    mask = u64(table.shape[0] - 1)
    for k in range(rows.shape[0]):
        if k % _BLOCK == 0 and is_set(stop_address):
            return
        key = u64(0)
        for c in range(rows.shape[1]):
            key = mix(key + u64(rows[k, c]) + GAMMA)
        slot = key & mask
        candidate = table[slot]
        while candidate >= 0:
            is_equal = True
            for c in range(rows.shape[1]):
                is_equal &= rows[candidate, c] == rows[k, c]
            if is_equal:
                break
            slot = (slot + u64(1)) & mask
            candidate = table[slot]
        if candidate < 0:
            candidate = table[slot] = k
        first_equal[k] = candidate


@device_function
def _find_group(parent: Array1[np.int64], k: I64) -> I64:
    """Return the root of a union-find tree, and shorten the path to it."""
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@device_function
def _join_groups(parent: Array1[np.int64], j: I64, k: I64) -> None:
    """Join the groups of the corners j and k. The lowest corner of a group is its root."""
    j, k = _find_group(parent, j), _find_group(parent, k)
    if j < k:
        parent[k] = j
    else:
        parent[j] = k


@inlined
def _next_corner(corner: I64) -> I64:
    """Return the next corner of the same triangle: the end of the edge that begins at ``corner``."""
    return corner - corner % 3 + (corner + 1) % 3


@device_function
def _face_tangents(
    p: Array2[np.float64],
    uv: Array2[np.float64],
    corner_vertex: Array1[np.int64],
    tangents: Array2[np.float64],
    handedness: Array1[np.int8],
    stop_address: Address,
) -> None:
    """Fill each triangle's tangent, of any length, and handedness: 1, -1, or 0 if its uv triangle has no area."""
    for face in range(handedness.shape[0]):
        if face % _BLOCK == 0 and is_set(stop_address):
            return
        i, j, k = corner_vertex[3 * face], corner_vertex[3 * face + 1], corner_vertex[3 * face + 2]
        u1, v1 = uv[j, 0] - uv[i, 0], uv[i, 1] - uv[j, 1]  # v upwards
        u2, v2 = uv[k, 0] - uv[i, 0], uv[i, 1] - uv[k, 1]
        area = u1 * v2 - v1 * u2
        if abs(area) > 1e-30:
            handedness[face] = 1 if area > 0.0 else -1
            for c in range(3):
                tangents[face, c] = handedness[face] * (v2 * (p[j, c] - p[i, c]) - v1 * (p[k, c] - p[i, c]))


@device_function
def _group_corners(
    welded: Array1[np.int64],
    handedness: Array1[np.int8],
    table: Array1[np.int64],
    parent: Array1[np.int64],
    stop_address: Address,
) -> None:
    """Join the groups of corners at both ends of every edge that two triangles of one handedness share.

    An edge is identified by the corner that it begins at.

    Args:
        welded: (3 M,) index of the first vertex that equals the corner's vertex.
        parent: (3 M,) union-find trees of corners, updated.
    """
    mask = u64(table.shape[0] - 1)
    # For each pair of vertices, at the slot of its first edge: the last edge that has no neighbour yet; -1: none.
    open_edge = np.full(table.shape[0], -1)
    for edge in range(parent.shape[0]):
        if edge % _BLOCK == 0 and is_set(stop_address):
            return
        edge_end = _next_corner(edge)
        low, high = min(welded[edge], welded[edge_end]), max(welded[edge], welded[edge_end])
        slot = mix(mix(u64(low) + GAMMA) + u64(high)) & mask
        candidate = table[slot]
        while candidate >= 0:
            a, b = welded[candidate], welded[_next_corner(candidate)]
            if min(a, b) == low and max(a, b) == high:
                break
            slot = (slot + u64(1)) & mask
            candidate = table[slot]
        if candidate < 0:
            table[slot] = open_edge[slot] = edge
            continue
        other = open_edge[slot]
        open_edge[slot] = edge
        if other < 0:
            continue
        other_end = _next_corner(other)
        # Neighbours traverse their common edge in opposite directions.
        if (
            welded[other] == welded[edge_end]
            and welded[other_end] == welded[edge]
            and welded[other] != welded[other_end]
        ):
            open_edge[slot] = -1
            hand, other_hand = handedness[edge // 3], handedness[other // 3]
            if other_hand == hand or other_hand == 0 or hand == 0:
                _join_groups(parent, other, edge_end)
                _join_groups(parent, other_end, edge)


@kernel
def _compute_tangents(
    p: Array2[np.float64],
    n: Array2[np.float64],
    uv: Array2[np.float64],
    corner_vertex: Array1[np.int64],
    welded: Array1[np.int64],
    table: Array1[np.int64],
    tangents: Array2[np.float32],
    stop_address: Address,
) -> None:
    """Fill ``tangents``, the result of ``corner_tangents``.

    Args:
        p, n, uv: positions (N, 3), normals (N, 3) and texture coordinates (N, 2) of the vertices.
        corner_vertex: (3 M,) vertex of each corner.
        welded: as in ``_group_corners``.
    """
    corner_count = corner_vertex.shape[0]
    face_tangents, handedness = np.zeros((corner_count // 3, 3)), np.zeros(corner_count // 3, np.int8)
    parent = np.arange(corner_count)
    _face_tangents(p, uv, corner_vertex, face_tangents, handedness, stop_address)
    _group_corners(welded, handedness, table, parent, stop_address)
    group_sum, group_handedness = np.zeros((corner_count, 3)), np.zeros(corner_count, np.int8)
    for corner in range(corner_count):
        if corner % _BLOCK == 0 and is_set(stop_address):
            return
        face = corner // 3
        if handedness[face] == 0:
            continue
        group = _find_group(parent, corner)
        # Triangles without area may have joined groups of both handednesses. The first corner decides.
        if group_handedness[group] == 0:
            group_handedness[group] = handedness[face]
        vertex, next_corner = corner_vertex[corner], _next_corner(corner)
        after, before = corner_vertex[next_corner], corner_vertex[_next_corner(next_corner)]
        normal, point = _row(n, vertex), _row(p, vertex)
        t = _in_plane(normal, _row(face_tangents, face))
        a, b = _in_plane(normal, minus(_row(p, after), point)), _in_plane(normal, minus(_row(p, before), point))
        angle = math.acos(min(max(dot(a, b), -1.0), 1.0))
        for c in range(3):
            group_sum[group, c] += angle * t[c]
    for corner in range(corner_count):
        group = _find_group(parent, corner)
        x, y, z = total = _row(group_sum, group)
        length = math.sqrt(dot(total, total))
        if length > 0.0:
            tangents[corner, 0], tangents[corner, 1], tangents[corner, 2] = x / length, y / length, z / length
        tangents[corner, 3] = -1.0 if group_handedness[group] < 0 else 1.0


@inlined
def _row(vectors: Array2[np.float64], k: I64) -> tuple[F64, F64, F64]:
    """Return vector ``k`` of (N, 3)."""
    return vectors[k, 0], vectors[k, 1], vectors[k, 2]


@device_function
def _in_plane(normal: tuple[F64, F64, F64], v: tuple[F64, F64, F64]) -> tuple[F64, F64, F64]:
    """Return the unit vector along a vector's projection into the plane of a normal; 0 if the projection is 0."""
    x, y, z = v = minus(v, times(normal, dot(normal, v)))
    length = math.sqrt(dot(v, v))
    if not (length > 0.0):
        return 0.0, 0.0, 0.0
    return x / length, y / length, z / length
