"""Normals of meshes that come without them: smooth, but not across creases."""

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
MAX_FACES_PER_VERTEX: Final = 256
"""Beyond, the corners of a vertex get the normals of their own faces, since the time grows with the square of this
number."""
_SAME_NORMAL_COSINE: Final = 0.99999
"""Corners of one vertex whose normals differ by less (0.26 degrees) share an output vertex."""

_FLOATS = types.Array(types.float32, 2, "C", readonly=True)
_FACES = types.Array(types.uint32, 2, "C", readonly=True)
_RESULT = types.Tuple((types.float32[:, ::1], types.float32[:, ::1], types.uint32[:, ::1]))


@njit(nogil=True)
def _face_normal(positions, a, b, c, unit_normal):
    """Return the cross product of a face's edges, and write its direction to ``unit_normal`` (3,)."""
    ux = np.float64(positions[b, 0]) - positions[a, 0]
    uy = np.float64(positions[b, 1]) - positions[a, 1]
    uz = np.float64(positions[b, 2]) - positions[a, 2]
    vx = np.float64(positions[c, 0]) - positions[a, 0]
    vy = np.float64(positions[c, 1]) - positions[a, 1]
    vz = np.float64(positions[c, 2]) - positions[a, 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = math.sqrt(x * x + y * y + z * z)
    if length > 0.0:
        unit_normal[0], unit_normal[1], unit_normal[2] = x / length, y / length, z / length
    else:
        unit_normal[0], unit_normal[1], unit_normal[2] = 0.0, 0.0, 1.0
    return x, y, z


@njit(nogil=True)
def _corners_by_vertex(faces, vertex_count):
    """Return the corners of each vertex as ``3 * face + k``, and where each vertex's corners start.

    Returns:
        (3 M,) int64 corners; (N + 1,) int64 starts: vertex v has ``corners[starts[v] : starts[v + 1]]``.
    """
    starts = np.zeros(vertex_count + 1, np.int64)
    for face in range(len(faces)):
        for k in range(3):
            starts[np.int64(faces[face, k]) + 1] += 1
    for vertex in range(vertex_count):
        starts[vertex + 1] += starts[vertex]
    corners = np.empty(3 * len(faces), np.int64)
    next_corner = starts[:-1].copy()
    for face in range(len(faces)):
        for k in range(3):
            corner_vertex = np.int64(faces[face, k])
            corners[next_corner[corner_vertex]] = 3 * face + k
            next_corner[corner_vertex] += 1
    return corners, starts


@cached_njit(_RESULT(_FLOATS, _FACES, types.float64), nogil=True)
def split_at_creases(positions, faces, crease_cosine):
    """Return positions, unit normals and faces of a surface whose vertices are doubled at creases.

    The normal of a face's corner is a mean, weighted by area, over the faces around its vertex: those whose normals are
    within the crease angle of the face's own normal. Corners of a vertex with (almost) the same normal share one output
    vertex.

    Args:
        positions: (N, 3) float32, finite.
        faces: (M, 3) uint32.
        crease_cosine: Cosine of the crease angle.

    Returns:
        (K, 3) float32, (K, 3) float32, (M, 3) uint32, without the vertices that no face uses.
    """
    vertex_count = len(positions)
    face_count = len(faces)
    area_normals = np.empty((face_count, 3), np.float64)  # of twice the face's area
    unit_normals = np.empty((face_count, 3), np.float64)
    for face in range(face_count):
        x, y, z = _face_normal(positions, faces[face, 0], faces[face, 1], faces[face, 2], unit_normals[face])
        area_normals[face, 0], area_normals[face, 1], area_normals[face, 2] = x, y, z
    corners, starts = _corners_by_vertex(faces, vertex_count)
    out_faces = np.empty((face_count, 3), np.uint32)
    out_normals = np.empty((3 * face_count, 3), np.float32)
    source_vertex = np.empty(3 * face_count, np.int64)  # input vertex of each output vertex
    half_angle_cosine = math.sqrt(max(0.0, (1.0 + crease_cosine) / 2.0))
    out_count = 0
    for vertex in range(vertex_count):
        start, end = starts[vertex], starts[vertex + 1]
        # Most vertices have no crease: all faces are within half the crease angle of the mean, so any two are within
        # the crease angle of each other.
        x, y, z = 0.0, 0.0, 0.0
        for i in range(start, end):
            face = corners[i] // 3
            x += area_normals[face, 0]
            y += area_normals[face, 1]
            z += area_normals[face, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            x, y, z = x / length, y / length, z / length
            has_crease = False
            for i in range(start, end):
                face = corners[i] // 3
                cosine = unit_normals[face, 0] * x + unit_normals[face, 1] * y + unit_normals[face, 2] * z
                if cosine <= half_angle_cosine:
                    has_crease = True
                    break
            if not has_crease:
                out_normals[out_count, 0], out_normals[out_count, 1], out_normals[out_count, 2] = x, y, z
                source_vertex[out_count] = vertex
                for i in range(start, end):
                    out_faces[corners[i] // 3, corners[i] % 3] = out_count
                out_count += 1
                continue
        first_of_vertex = out_count
        too_many_faces = end - start > MAX_FACES_PER_VERTEX
        for i in range(start, end):
            face = corners[i] // 3
            x, y, z = 0.0, 0.0, 0.0
            if not too_many_faces:
                for j in range(start, end):
                    other = corners[j] // 3
                    cosine = (
                        unit_normals[face, 0] * unit_normals[other, 0]
                        + unit_normals[face, 1] * unit_normals[other, 1]
                        + unit_normals[face, 2] * unit_normals[other, 2]
                    )
                    if cosine > crease_cosine:
                        x += area_normals[other, 0]
                        y += area_normals[other, 1]
                        z += area_normals[other, 2]
            length = math.sqrt(x * x + y * y + z * z)
            if length > 0.0:
                x, y, z = x / length, y / length, z / length
            else:
                x, y, z = unit_normals[face, 0], unit_normals[face, 1], unit_normals[face, 2]
            out_vertex = first_of_vertex
            while out_vertex < out_count:
                cosine = (
                    out_normals[out_vertex, 0] * x + out_normals[out_vertex, 1] * y + out_normals[out_vertex, 2] * z
                )
                if cosine > _SAME_NORMAL_COSINE:
                    break
                out_vertex += 1
            if out_vertex == out_count:
                out_normals[out_count, 0], out_normals[out_count, 1], out_normals[out_count, 2] = x, y, z
                source_vertex[out_count] = vertex
                out_count += 1
            out_faces[face, corners[i] % 3] = out_vertex
    out_positions = np.empty((out_count, 3), np.float32)
    for out_vertex in range(out_count):
        for k in range(3):
            out_positions[out_vertex, k] = positions[source_vertex[out_vertex], k]
    return out_positions, out_normals[:out_count].copy(), out_faces


def smooth_mesh(
    positions: NDArray[np.float32], faces: NDArray[np.uint32]
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """Return positions (K, 3) float32, faces (M, 3) uint32 and unit normals (K, 3) float32 of a mesh.

    Vertices are doubled at creases; vertices that no face uses are left out.
    """
    out_positions, normals, out_faces = split_at_creases(positions, faces, CREASE_COSINE)
    return out_positions, out_faces, normals


def with_creases(
    positions: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    *,
    uv: NDArray[np.float32] | None = None,
    colors: NDArray[np.float32] | None = None,
) -> Mesh:
    """Return a mesh with unit normals; vertices of equal positions are merged, then doubled at creases.

    Args:
        positions: (N, 3) float32, finite.
        triangles: (M, 3) uint32.
        uv: (N, 2) float32 or None.
        colors: (N, 4) float32 or None.
    """
    position_bytes = np.ascontiguousarray(positions + np.float32(0.0)).view(np.dtype((np.void, 12))).ravel()  # no -0
    _, first_vertex, merged_vertex = np.unique(position_bytes, return_index=True, return_inverse=True)
    merged_triangles = merged_vertex.reshape(-1).astype(np.uint32)[triangles]
    smooth_positions, smooth_triangles, normals = smooth_mesh(positions[first_vertex], merged_triangles)
    if uv is None and colors is None:
        return Mesh(smooth_positions, smooth_triangles, normals)
    # One output vertex for each pair of an input vertex (uv, colour) and a smooth vertex (normal).
    vertices, smooth_vertices = triangles.reshape(-1), smooth_triangles.reshape(-1)
    pairs = vertices * np.int64(max(len(smooth_positions), 1)) + smooth_vertices
    _, corner, index = np.unique(pairs, return_index=True, return_inverse=True)
    vertex = vertices[corner]
    return Mesh(
        positions[vertex],
        index.reshape(-1, 3).astype(np.uint32),
        normals[smooth_vertices[corner]],
        uv0=None if uv is None else uv[vertex],
        colors=None if colors is None else colors[vertex],
    )
