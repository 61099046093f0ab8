"""Tangents for meshes that bring none: MikkTSpace, as glTF 2.0 (3.7.2.1) asks for.

Written from M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited" (2008), chapter 5, and what is documented of his
reference: corners with the same position, normal and coordinates are one vertex; the triangles around a vertex
that hang together by edges and have the same handedness form a group; each corner's tangent is the mean of its
group's, projected into the plane of the normal and weighted by the angle at the corner. A vertex on a border of
handedness so has two tangents and is split.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pending import wait_until_compiled
from renderers.drawlist import Mesh, Topology
from renderers.stop import check_stop, current_stop

_BLOCK: Final = 1 << 14
"""Corners, triangles or vertices between two looks at the ``StopFlag``."""


def with_tangents(mesh: Mesh, uv_set: int) -> Mesh:
    """Add tangents that follow a set of texture coordinates (0 or 1), and drop vertices that no triangle uses.
    A mesh with tangents, or without normals, coordinates or triangles, is returned unchanged.
    """
    wait_until_compiled("normals")
    uv = mesh.uv1 if uv_set == 1 else mesh.uv0
    if mesh.tangents is not None or uv is None or mesh.normals is None or mesh.topology is not Topology.TRIANGLES:
        return mesh
    tangents = corner_tangents(mesh.positions, mesh.normals, uv, mesh.elements)
    check_stop()
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
    check_stop()
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

    Raises:
        Exception: the current ``StopFlag`` was set.
    """
    stop = current_stop()
    flat = triangles.reshape(-1).astype(np.int64)
    every = np.concatenate((positions, normals, uv), axis=1)
    stop.check()
    every = np.where(np.abs(every) < 1e18, every, np.float32(0.0)) + np.float32(0.0)  # no -0, nothing not finite
    stop.check()
    p, n, t = (np.ascontiguousarray(part, np.float64) for part in (every[:, :3], every[:, 3:6], every[:, 6:]))
    stop.check()
    first = np.empty(len(every), np.int64)
    _weld(np.ascontiguousarray(every).view(np.int64), first, _table(len(every)), stop.address)
    stop.check()
    out = np.zeros((len(flat), 4), np.float32)
    _tangents(p, n, t, flat, first[flat], _table(len(flat)), out, stop.address)
    stop.check()
    return out


def _table(count: int) -> NDArray[np.int64]:
    """An empty hash table for ``count`` entries: a power of two of -1, half of it or more free."""
    return np.full(1 << max(2 * count - 1, 1).bit_length(), -1, np.int64)


@inlined
def _mixed(value):
    """splitmix64's finalizer."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@kernel("void(int64[:,::1], int64[::1], int64[::1], int64)")
def _weld(rows, first, table, stop_at):
    """Find for every row the first one that is equal.

    Args:
        first: (rows,) written. table: see ``_table``.
        stop_at: address of a ``StopFlag``; nothing is of use once it is set.
    """
    mask = np.uint64(table.shape[0] - 1)
    for k in range(rows.shape[0]):
        if k % _BLOCK == 0 and is_set(stop_at):
            return
        value = np.uint64(0)
        for c in range(rows.shape[1]):
            value = _mixed(value + np.uint64(rows[k, c]) + np.uint64(0x9E3779B97F4A7C15))
        slot = value & mask
        found = table[slot]
        while found >= 0:
            same = True
            for c in range(rows.shape[1]):
                same &= rows[found, c] == rows[k, c]
            if same:
                break
            slot = (slot + np.uint64(1)) & mask
            found = table[slot]
        if found < 0:
            found = table[slot] = k
        first[k] = found


@device_function
def _root(parent, k):
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@device_function
def _join(parent, j, k):
    j, k = _root(parent, j), _root(parent, k)
    if j < k:
        parent[k] = j
    else:
        parent[j] = k


@kernel(
    "void(float64[:,::1], float64[:,::1], float64[:,::1], int64[::1], int64[::1], int64[::1], float32[:,::1], int64)"
)
def _tangents(p, n, uv, corner, welded, table, out, stop_at):
    """
    Args:
        p, n, uv: of the vertices. corner: (3 M,) vertex of each corner; welded: the same, equal vertices being one.
        table: see ``_table``.
        stop_at: address of a ``StopFlag``; ``out`` is of no use once it is set.
    """
    count = corner.shape[0] // 3
    along = np.zeros((count, 3))
    turn = np.zeros(count, np.int8)  # handedness: 1, -1, 0 where the coordinates have no area
    for f in range(count):
        if f % _BLOCK == 0 and is_set(stop_at):
            return
        i, j, k = corner[3 * f], corner[3 * f + 1], corner[3 * f + 2]
        u1, v1 = uv[j, 0] - uv[i, 0], uv[i, 1] - uv[j, 1]  # v upwards
        u2, v2 = uv[k, 0] - uv[i, 0], uv[i, 1] - uv[k, 1]
        area = u1 * v2 - v1 * u2
        if abs(area) > 1e-30:
            turn[f] = 1 if area > 0.0 else -1
            for c in range(3):
                along[f, c] = turn[f] * (v2 * (p[j, c] - p[i, c]) - v1 * (p[k, c] - p[i, c]))
    parent = np.arange(3 * count)
    # An edge is called by the corner that it begins at. Of those between the same two vertices, the last one that has
    # no neighbour yet waits in ``waiting``, at the place of their first in the table.
    mask = np.uint64(table.shape[0] - 1)
    waiting = np.full(table.shape[0], -1)
    for o in range(3 * count):
        if o % _BLOCK == 0 and is_set(stop_at):
            return
        o2 = o - o % 3 + (o + 1) % 3
        low, high = min(welded[o], welded[o2]), max(welded[o], welded[o2])
        slot = _mixed(_mixed(np.uint64(low) + np.uint64(0x9E3779B97F4A7C15)) + np.uint64(high)) & mask
        known = table[slot]
        while known >= 0:
            a, b = welded[known], welded[known - known % 3 + (known + 1) % 3]
            if min(a, b) == low and max(a, b) == high:
                break
            slot = (slot + np.uint64(1)) & mask
            known = table[slot]
        if known < 0:
            table[slot] = waiting[slot] = o
            continue
        e = waiting[slot]
        waiting[slot] = o
        if e < 0:
            continue
        # Two triangles are neighbours over an edge that they run through in opposite directions.
        e2 = e - e % 3 + (e + 1) % 3
        if welded[e] == welded[o2] and welded[e2] == welded[o] and welded[e] != welded[e2]:
            waiting[slot] = -1
            if turn[e // 3] == turn[o // 3] or turn[e // 3] == 0 or turn[o // 3] == 0:
                _join(parent, e, o2)
                _join(parent, e2, o)
    total = np.zeros((3 * count, 3))
    hand = np.zeros(3 * count, np.int8)
    for c in range(3 * count):
        if c % _BLOCK == 0 and is_set(stop_at):
            return
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


@device_function
def _flat(nx, ny, nz, x, y, z):
    """A vector without its part along the normal, unit length; 0 where nothing is left."""
    d = nx * x + ny * y + nz * z
    x, y, z = x - d * nx, y - d * ny, z - d * nz
    length = math.sqrt(x * x + y * y + z * z)
    if not (length > 0.0):
        return 0.0, 0.0, 0.0
    return x / length, y / length, z / length
