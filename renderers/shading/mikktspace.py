"""Tangents for meshes that bring none: MikkTSpace, as glTF 2.0 (3.7.2.1) asks for.

Written from M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited" (2008), chapter 5, and what is documented of his
reference: corners with the same position, normal and coordinates are one vertex; the triangles around a vertex
that hang together by edges and have the same handedness form a group; each corner's tangent is the mean of its
group's, projected into the plane of the normal and weighted by the angle at the corner. A vertex on a border of
handedness so has two tangents and is split.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import Mesh, Topology
from renderers.jit import kernel
from renderers.linked import inner


def with_tangents(mesh: Mesh, uv_set: int) -> Mesh:
    """Add tangents that follow a set of texture coordinates (0 or 1), and drop vertices that no triangle uses.
    A mesh with tangents, or without normals, coordinates or triangles, is returned unchanged.
    """
    uv = mesh.uv1 if uv_set == 1 else mesh.uv0
    if mesh.tangents is not None or uv is None or mesh.normals is None or mesh.topology is not Topology.TRIANGLES:
        return mesh
    tangents = corner_tangents(mesh.positions, mesh.normals, uv, mesh.elements)
    corner = mesh.elements.reshape(-1).astype(np.intp)
    # Each vertex keeps the tangent of its first corner (of repeated indices, the last assignment counts).
    first = np.full(len(mesh.positions), -1, np.intp)
    first[corner[::-1]] = np.arange(len(corner) - 1, -1, -1)
    used = first >= 0
    # Corners with another tangent get vertices of their own.
    apart = np.flatnonzero((tangents != tangents[first[corner]]).any(axis=1))
    elements = (np.cumsum(used) - 1)[corner]
    elements[apart] = np.count_nonzero(used) + np.arange(len(apart))
    kept = np.concatenate((first[used], apart))
    vertex = corner[kept]
    return Mesh(
        mesh.positions[vertex],
        elements.reshape(-1, 3).astype(np.uint32),
        mesh.normals[vertex],
        None if mesh.uv0 is None else mesh.uv0[vertex],
        None if mesh.uv1 is None else mesh.uv1[vertex],
        None if mesh.colors is None else mesh.colors[vertex],
        tangents[kept],
    )


def corner_tangents(
    positions: NDArray[np.float32],
    normals: NDArray[np.float32],
    uv: NDArray[np.float32],
    triangles: NDArray[np.uint32],
) -> NDArray[np.float32]:
    """(3 M, 4) float32: unit tangent and handedness of the bitangent at every corner of every triangle.

    Args:
        positions, normals: (N, 3) float32. uv: (N, 2) float32, v downwards as in glTF.
        triangles: (M, 3) uint32.
    """
    flat = triangles.reshape(-1).astype(np.int64)
    every = np.concatenate((positions, normals, uv), axis=1)
    every = np.where(np.abs(every) < 1e18, every, np.float32(0.0)) + np.float32(0.0)  # no -0, nothing not finite
    rows = np.ascontiguousarray(every).view(np.dtype((np.void, every.shape[1] * 4)))[:, 0]
    _, vertex = np.unique(rows, return_inverse=True)
    welded = vertex.reshape(-1)[flat].astype(np.int64)
    a, b = welded.reshape(-1, 3), np.roll(welded.reshape(-1, 3), -1, axis=1)
    low, high = np.minimum(a, b).reshape(-1), np.maximum(a, b).reshape(-1)
    order = np.lexsort((np.arange(len(low)), high, low))
    out = np.zeros((len(flat), 4), np.float32)
    _tangents(
        np.ascontiguousarray(every[:, :3], np.float64),
        np.ascontiguousarray(every[:, 3:6], np.float64),
        np.ascontiguousarray(every[:, 6:], np.float64),
        flat,
        welded,
        order.astype(np.int64),
        out,
    )
    return out


@inner
def _root(parent, k):
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@inner
def _join(parent, j, k):
    j, k = _root(parent, j), _root(parent, k)
    if j < k:
        parent[k] = j
    else:
        parent[j] = k


@kernel("void(float64[:,::1], float64[:,::1], float64[:,::1], int64[::1], int64[::1], int64[::1], float32[:,::1])")
def _tangents(p, n, uv, corner, welded, edges, out):
    """
    Args:
        p, n, uv: of the vertices. corner: (3 M,) vertex of each corner; welded: the same, equal vertices being one.
        edges: (3 M,) edges (by the corner they begin at), those between the same two vertices next to each other.
    """
    count = corner.shape[0] // 3
    along = np.zeros((count, 3))
    turn = np.zeros(count, np.int8)  # handedness: 1, -1, 0 where the coordinates have no area
    for f in range(count):
        i, j, k = corner[3 * f], corner[3 * f + 1], corner[3 * f + 2]
        u1, v1 = uv[j, 0] - uv[i, 0], uv[i, 1] - uv[j, 1]  # v upwards
        u2, v2 = uv[k, 0] - uv[i, 0], uv[i, 1] - uv[k, 1]
        area = u1 * v2 - v1 * u2
        if abs(area) > 1e-30:
            turn[f] = 1 if area > 0.0 else -1
            for c in range(3):
                along[f, c] = turn[f] * (v2 * (p[j, c] - p[i, c]) - v1 * (p[k, c] - p[i, c]))
    parent = np.arange(3 * count)
    begin = 0
    while begin < edges.shape[0]:
        # Two triangles are neighbours over an edge that they run through in opposite directions.
        e = edges[begin]
        end = begin + 1
        if end < edges.shape[0]:
            o = edges[end]
            e2, o2 = e - e % 3 + (e + 1) % 3, o - o % 3 + (o + 1) % 3
            if welded[e] == welded[o2] and welded[e2] == welded[o] and welded[e] != welded[e2]:
                end += 1
                if turn[e // 3] == turn[o // 3] or turn[e // 3] == 0 or turn[o // 3] == 0:
                    _join(parent, e, o2)
                    _join(parent, e2, o)
        begin = end
    total = np.zeros((3 * count, 3))
    hand = np.zeros(3 * count, np.int8)
    for c in range(3 * count):
        f = c // 3
        if turn[f] == 0:
            continue
        group = _root(parent, c)
        # A group that only triangles without area join may hold both hands: the first decides.
        if hand[group] == 0:
            hand[group] = turn[f]
        at, ahead, behind = corner[c], corner[3 * f + (c + 1) % 3], corner[3 * f + (c + 2) % 3]
        nx, ny, nz = n[at, 0], n[at, 1], n[at, 2]
        tx, ty, tz = _flat(nx, ny, nz, along[f, 0], along[f, 1], along[f, 2])
        ax, ay, az = _flat(nx, ny, nz, p[ahead, 0] - p[at, 0], p[ahead, 1] - p[at, 1], p[ahead, 2] - p[at, 2])
        bx, by, bz = _flat(nx, ny, nz, p[behind, 0] - p[at, 0], p[behind, 1] - p[at, 1], p[behind, 2] - p[at, 2])
        angle = math.acos(min(max(ax * bx + ay * by + az * bz, -1.0), 1.0))
        total[group, 0] += angle * tx
        total[group, 1] += angle * ty
        total[group, 2] += angle * tz
    for c in range(3 * count):
        group = _root(parent, c)
        x, y, z = total[group, 0], total[group, 1], total[group, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            out[c, 0], out[c, 1], out[c, 2] = x / length, y / length, z / length
        out[c, 3] = -1.0 if hand[group] < 0 else 1.0


@inner
def _flat(nx, ny, nz, x, y, z):
    """A vector without its part along the normal, unit length; 0 where nothing is left."""
    d = nx * x + ny * y + nz * z
    x, y, z = x - d * nx, y - d * ny, z - d * nz
    length = math.sqrt(x * x + y * y + z * z)
    if not (length > 0.0):
        return 0.0, 0.0, 0.0
    return x / length, y / length, z / length
