"""Normals for meshes that come without: smooth, but not across creases."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit
from renderers.drawlist import Mesh

CREASE_COSINE: Final = math.cos(math.radians(45.0))
"""Faces that meet at a larger angle are shaded apart (Director's feature angle)."""
MOST_FACES: Final = 256
"""Faces at one vertex; beyond, its corners are flat, since the time grows with the square of this number."""

_FLOATS = types.Array(types.float32, 2, "C", readonly=True)
_FACES = types.Array(types.uint32, 2, "C", readonly=True)
_RESULT = types.Tuple((types.float32[:, ::1], types.float32[:, ::1], types.uint32[:, ::1]))


@njit(nogil=True)
def _face(positions, a, b, c, unit):
    """Return the cross product of a face's edges, and write its direction to ``unit`` (3,)."""
    ux = np.float64(positions[b, 0]) - positions[a, 0]
    uy = np.float64(positions[b, 1]) - positions[a, 1]
    uz = np.float64(positions[b, 2]) - positions[a, 2]
    vx = np.float64(positions[c, 0]) - positions[a, 0]
    vy = np.float64(positions[c, 1]) - positions[a, 1]
    vz = np.float64(positions[c, 2]) - positions[a, 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = math.sqrt(x * x + y * y + z * z)
    if length > 0.0:
        unit[0], unit[1], unit[2] = x / length, y / length, z / length
    else:
        unit[0], unit[1], unit[2] = 0.0, 0.0, 1.0
    return x, y, z


@cached_njit(_RESULT(_FLOATS, _FACES, types.float64), nogil=True)
def smoothed(positions, faces, cosine):
    """Return positions, unit normals and faces of a surface whose vertices are doubled at creases.

    A corner's normal is the mean, weighted by area, of the faces around its vertex whose normals are within the crease
    angle of its own face's. Corners of a vertex with (almost) the same normal share one vertex.

    Args:
        positions: (N, 3) float32, finite.
        faces: (M, 3) uint32.
        cosine: Cosine of the crease angle.

    Returns:
        (K, 3) float32, (K, 3) float32, (M, 3) uint32, without the vertices that no face uses.
    """
    count = len(positions)
    m = len(faces)
    area = np.empty((m, 3), np.float64)
    unit = np.empty((m, 3), np.float64)
    begin = np.zeros(count + 1, np.int64)
    for f in range(m):
        x, y, z = _face(positions, faces[f, 0], faces[f, 1], faces[f, 2], unit[f])
        area[f, 0], area[f, 1], area[f, 2] = x, y, z
        for k in range(3):
            begin[np.int64(faces[f, k]) + 1] += 1
    for v in range(count):
        begin[v + 1] += begin[v]
    # Corners of each vertex, as 3 f + k.
    corners = np.empty(3 * m, np.int64)
    place = begin[:-1].copy()
    for f in range(m):
        for k in range(3):
            vertex = np.int64(faces[f, k])
            corners[place[vertex]] = 3 * f + k
            place[vertex] += 1
    out_faces = np.empty((m, 3), np.uint32)
    normals = np.empty((3 * m, 3), np.float32)
    source = np.empty(3 * m, np.int64)
    half_cosine = math.sqrt(max(0.0, (1.0 + cosine) / 2.0))
    used = 0
    for v in range(count):
        first, last = begin[v], begin[v + 1]
        mine = used
        flat = last - first > MOST_FACES
        # Most vertices are smooth all around: all faces are so close to the mean that any two are close to each other.
        x, y, z = 0.0, 0.0, 0.0
        for i in range(first, last):
            f = corners[i] // 3
            x += area[f, 0]
            y += area[f, 1]
            z += area[f, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            x, y, z = x / length, y / length, z / length
            smooth = True
            for i in range(first, last):
                f = corners[i] // 3
                if unit[f, 0] * x + unit[f, 1] * y + unit[f, 2] * z <= half_cosine:
                    smooth = False
                    break
            if smooth:
                normals[used, 0], normals[used, 1], normals[used, 2] = x, y, z
                source[used] = v
                for i in range(first, last):
                    f = corners[i] // 3
                    out_faces[f, corners[i] - 3 * f] = used
                used += 1
                continue
        for i in range(first, last):
            f = corners[i] // 3
            x, y, z = 0.0, 0.0, 0.0
            if not flat:
                for j in range(first, last):
                    g = corners[j] // 3
                    near = unit[f, 0] * unit[g, 0] + unit[f, 1] * unit[g, 1] + unit[f, 2] * unit[g, 2]
                    if near > cosine:
                        x += area[g, 0]
                        y += area[g, 1]
                        z += area[g, 2]
            length = math.sqrt(x * x + y * y + z * z)
            if length > 0.0:
                x, y, z = x / length, y / length, z / length
            else:
                x, y, z = unit[f, 0], unit[f, 1], unit[f, 2]
            shared = -1
            for n in range(mine, used):
                if normals[n, 0] * x + normals[n, 1] * y + normals[n, 2] * z > 0.99999:
                    shared = n
                    break
            if shared < 0:
                shared = used
                normals[used, 0], normals[used, 1], normals[used, 2] = x, y, z
                source[used] = v
                used += 1
            out_faces[f, corners[i] - 3 * f] = shared
    out_positions = np.empty((used, 3), np.float32)
    for n in range(used):
        for k in range(3):
            out_positions[n, k] = positions[source[n], k]
    return out_positions, normals[:used].copy(), out_faces


def smooth_mesh(
    positions: NDArray[np.float32], faces: NDArray[np.uint32]
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """Return positions (K, 3) float32, faces (M, 3) uint32 and unit normals (K, 3) float32 of a mesh.

    Vertices are doubled at creases; vertices that no face uses are left out.
    """
    placed, normals, elements = smoothed(positions, faces, CREASE_COSINE)
    return placed, elements, normals


def with_creases(
    positions: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    *,
    uv: NDArray[np.float32] | None = None,
    colors: NDArray[np.float32] | None = None,
) -> Mesh:
    """Return a mesh with unit normals; vertices are doubled at creases, and those of equal positions merged.

    Args:
        positions: (N, 3) float32, finite.
        triangles: (M, 3) uint32.
        uv: (N, 2) float32 or None.
        colors: (N, 4) float32 or None.
    """
    rows = np.ascontiguousarray(positions + np.float32(0.0)).view(np.dtype((np.void, 12))).ravel()  # no -0
    _, first, place = np.unique(rows, return_index=True, return_inverse=True)
    welded = place.reshape(-1).astype(np.uint32)[triangles]
    placed, elements, normals = smooth_mesh(positions[first], welded)
    if uv is None and colors is None:
        return Mesh(placed, elements, normals)
    key = triangles.reshape(-1) * np.int64(max(len(placed), 1)) + elements.reshape(-1)
    _, corner, index = np.unique(key, return_index=True, return_inverse=True)
    vertex = triangles.reshape(-1)[corner]
    return Mesh(
        positions[vertex],
        index.reshape(-1, 3).astype(np.uint32),
        normals[elements.reshape(-1)[corner]],
        uv0=None if uv is None else uv[vertex],
        colors=None if colors is None else colors[vertex],
    )
