"""Computes normals for meshes without normals: smooth, except at creases, where vertices are duplicated.

Which edges are creases depends on the format:

- Meshes of Director and Drake's viewer, OBJ, STL, PLY and the other mesh files: edges of more than ``CREASE_ANGLE``.
- Shapes in requests of Drake's render client: none. VTK's exporter omits their normals, but not their seams: at edges
  that RenderEngineVtk shows, vertices are not shared.
- Other glTF files: all (glTF 2.0, 3.7.2.1). Meshes without normals are flat, so that nothing is computed here.
"""

from __future__ import annotations

import math
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel, read_only
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import F64, I64, Address, Array1, Array2, ReadOnly2, f64, u64
from renderers.drawlist import Mesh
from renderers.stop import check_stop, current_stop

CREASE_ANGLE: Final = 45.0
"""Degrees between the normals of faces above which their edge is a crease. It is Director's feature angle."""
NO_CREASES: Final = 180.0
"""Crease angle with which faces that share a vertex share its normal."""
MAX_FACES_PER_VERTEX: Final = 256
"""Maximum number of faces at a vertex for smooth normals, whose time grows with the square of this number. At a vertex
with more faces, each corner has the normal of its own face, and is compared with as many output vertices at most."""
_STEPS_PER_STOP_CHECK: Final = 1 << 10
"""Vertices, or corners of a vertex, between two checks of the ``StopFlag``."""
_SAME_NORMAL_COSINE: Final = 0.99999
"""Corners of one vertex share an output vertex if the cosine of the angle between their normals is larger than this
(0.26 degrees)."""


@inlined
def _face_normals(
    positions: ReadOnly2[np.float32], faces: ReadOnly2[np.uint32]
) -> tuple[Array2[np.float64], Array2[np.float64]]:
    """Return each face's cross product of two edges, twice as long as its area, and its unit normal, (M, 3) each.

    A face without area has the unit normal +z.
    """
    area_normals, unit_normals = np.empty((len(faces), 3)), np.empty((len(faces), 3))
    for face in range(len(faces)):
        a, b, c = positions[faces[face, 0]], positions[faces[face, 1]], positions[faces[face, 2]]
        ux, uy, uz = f64(b[0]) - a[0], f64(b[1]) - a[1], f64(b[2]) - a[2]
        vx, vy, vz = f64(c[0]) - a[0], f64(c[1]) - a[1], f64(c[2]) - a[2]
        normal = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        _write(area_normals, face, normal)
        _write(unit_normals, face, _unit(normal, (0.0, 0.0, 1.0)))
    return area_normals, unit_normals


@inlined
def _corners_by_vertex(faces: ReadOnly2[np.uint32], vertex_count: I64) -> tuple[Array1[np.uint32], Array1[np.uint32]]:
    """Return the corners of the faces, 3 * face + 0, 1 or 2, sorted by their vertex, and where each vertex's start.

    A counting sort: ``corners[starts[v] : starts[v + 1]]`` are the corners of vertex v.
    """
    vertices = faces.reshape(-1)
    starts, corners = np.zeros(vertex_count + 2, np.uint32), np.empty(len(vertices), np.uint32)
    # The count of vertex v is kept at starts[v + 2]. The sums below turn starts[v + 1] into the start of vertex v, and
    # writing its corners increments starts[v + 1] to their end, which is the start of vertex v + 1.
    for corner in range(len(vertices)):
        starts[vertices[corner] + 2] += 1
    for vertex in range(2, vertex_count + 2):
        starts[vertex] += starts[vertex - 1]
    for corner in range(len(vertices)):
        next_vertex = vertices[corner] + 1
        corners[starts[next_vertex]] = corner
        starts[next_vertex] += 1
    return corners, starts


Vectors = TypeVar("Vectors", Array2[np.float64], Array2[np.float32])


@inlined
def _write(vectors: Vectors, row: I64, vector: tuple[F64, F64, F64]) -> None:
    vectors[row, 0], vectors[row, 1], vectors[row, 2] = vector


@inlined
def _dot(vectors: Vectors, row: I64, vector: tuple[F64, F64, F64]) -> F64:
    row = u64(row)  # saves the check for a negative index: a quarter of the time at creases
    return vectors[row, 0] * vector[0] + vectors[row, 1] * vector[1] + vectors[row, 2] * vector[2]


@inlined
def _plus(total: tuple[F64, F64, F64], vectors: Array2[np.float64], row: I64) -> tuple[F64, F64, F64]:
    row = u64(row)
    return total[0] + vectors[row, 0], total[1] + vectors[row, 1], total[2] + vectors[row, 2]


@inlined
def _unit(vector: tuple[F64, F64, F64], fallback: tuple[F64, F64, F64]) -> tuple[F64, F64, F64]:
    """Return a vector at length 1, or ``fallback`` if it has no length."""
    length = math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    return (vector[0] / length, vector[1] / length, vector[2] / length) if length > 0.0 else fallback


@inlined
def _common_normal(
    corners: Array1[np.uint32],
    area_normals: Array2[np.float64],
    unit_normals: Array2[np.float64],
    half_angle_cosine: F64,
) -> tuple[tuple[F64, F64, F64], bool]:
    """Return the mean normal of all faces around a vertex, and True if no edge at the vertex is a crease.

    This is certain if all faces are within half the crease angle of their mean normal, because then any two of them are
    within the crease angle of each other.
    """
    total = (0.0, 0.0, 0.0)
    for corner in corners:
        total = _plus(total, area_normals, corner // 3)
    normal = _unit(total, (0.0, 0.0, 0.0))
    if normal == (0.0, 0.0, 0.0):
        return normal, False
    for corner in corners:
        if _dot(unit_normals, corner // 3, normal) <= half_angle_cosine:
            return normal, False
    return normal, True


@inlined
def _corner_normal(
    face: I64,
    corners: Array1[np.uint32],
    area_normals: Array2[np.float64],
    unit_normals: Array2[np.float64],
    crease_cosine: F64,
) -> tuple[F64, F64, F64]:
    """Return the mean normal, weighted by area, of the faces around a vertex within the crease angle of one of them."""
    own, total = (unit_normals[face, 0], unit_normals[face, 1], unit_normals[face, 2]), (0.0, 0.0, 0.0)
    if len(corners) <= MAX_FACES_PER_VERTEX:
        for corner in corners:
            if _dot(unit_normals, corner // 3, own) > crease_cosine:
                total = _plus(total, area_normals, corner // 3)
    return _unit(total, own)


@kernel
def _split_at_creases(
    positions: ReadOnly2[np.float32], faces: ReadOnly2[np.uint32], crease_cosine: F64, stop_at: Address
) -> tuple[Array1[np.int64], Array2[np.uint32], Array2[np.float32]]:
    """Return what ``smooth_vertices`` does; the result is incomplete if the StopFlag at ``stop_at`` is set.

    The normal at a face's corner is the mean normal of some faces around the corner's vertex: those whose normals are
    within the crease angle of the face's own normal. Corners of a vertex whose normals are (almost) the same share one
    output vertex.
    """
    area_normals, unit_normals = _face_normals(positions, faces)
    sorted_corners, starts = _corners_by_vertex(faces, len(positions))
    source_vertex, out_faces = np.empty(faces.size, np.int64), np.empty(faces.size, np.uint32)
    out_normals = np.empty((faces.size, 3), np.float32)
    half_angle_cosine = math.sqrt((1.0 + crease_cosine) / 2.0) if crease_cosine > -1.0 else -math.inf
    out_count = 0
    for vertex in range(len(positions)):
        if vertex % _STEPS_PER_STOP_CHECK == 0 and is_set(stop_at):
            break
        corners = sorted_corners[starts[vertex] : starts[vertex + 1]]
        normal, is_smooth = _common_normal(corners, area_normals, unit_normals, half_angle_cosine)
        first_out_vertex = out_count
        for i in range(len(corners)):
            if i % _STEPS_PER_STOP_CHECK == 0 and is_set(stop_at):
                break
            if not is_smooth:
                normal = _corner_normal(corners[i] // 3, corners, area_normals, unit_normals, crease_cosine)
            out_vertex = max(first_out_vertex, out_count - MAX_FACES_PER_VERTEX)
            while out_vertex < out_count and _dot(out_normals, out_vertex, normal) <= _SAME_NORMAL_COSINE:
                out_vertex += 1
            if out_vertex == out_count:
                _write(out_normals, out_count, normal)
                source_vertex[out_count] = vertex
                out_count += 1
            out_faces[corners[i]] = out_vertex
    return source_vertex[:out_count].copy(), out_faces.reshape(-1, 3), out_normals[:out_count].copy()


def smooth_mesh(
    positions: NDArray[np.float32], faces: NDArray[np.uint32]
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """Return a copy of a mesh with unit normals. Vertices are duplicated at creases; unused vertices are left out.

    Args:
        positions: (N, 3) float32, finite, C-contiguous.
        faces: (M, 3) uint32, C-contiguous, every value < N (not checked).

    Returns:
        Positions (K, 3) float32, faces (M, 3) uint32 and normals (K, 3) float32.
    """
    source_vertex, out_faces, normals = smooth_vertices(positions, faces)
    return positions[source_vertex], out_faces, normals


def smooth_vertices(
    positions: NDArray[np.float32], faces: NDArray[np.uint32], crease_angle: float = CREASE_ANGLE
) -> tuple[NDArray[np.int64], NDArray[np.uint32], NDArray[np.float32]]:
    """Return what ``smooth_mesh`` does, with the vertex in ``positions`` of each position, (K,) int64, in its place.

    Args:
        crease_angle: Degrees, up to ``NO_CREASES``.
    """
    stop = current_stop()
    smooth = _split_at_creases(
        read_only(positions), read_only(faces), math.cos(math.radians(crease_angle)), stop.address
    )
    stop.check()
    source_vertex, out_faces, normals = smooth
    return source_vertex, out_faces, normals


def with_creases(
    positions: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    *,
    uv: NDArray[np.float32] | None = None,
    colors: NDArray[np.float32] | None = None,
) -> Mesh:
    """Return a mesh with unit normals. Vertices at equal positions are merged, then duplicated at creases.

    Args:
        positions: (N, 3) float32, finite.
        triangles: (M, 3) uint32.
        uv: (N, 2) float32 or None.
        colors: (N, 4) float32 or None.
    """
    # Compare positions by their bytes; adding 0 turns -0 into 0.
    position_bytes = np.ascontiguousarray(positions + np.float32(0.0)).view(np.dtype((np.void, 12))).ravel()
    _, first_vertex, merged_vertex = np.unique(position_bytes, return_index=True, return_inverse=True)
    check_stop()
    merged_triangles = merged_vertex.reshape(-1).astype(np.uint32)[triangles]
    smooth_positions, smooth_triangles, normals = smooth_mesh(positions[first_vertex], merged_triangles)
    if uv is None and colors is None:
        return Mesh(smooth_positions, smooth_triangles, normals)
    # One output vertex for each pair of an input vertex, which has uv and colour, and a smooth vertex, with its normal.
    vertices, smooth_vertices = triangles.reshape(-1), smooth_triangles.reshape(-1)
    pairs = vertices * np.int64(max(len(smooth_positions), 1)) + smooth_vertices
    _, corner_of_vertex, output_vertex = np.unique(pairs, return_index=True, return_inverse=True)
    input_vertex = vertices[corner_of_vertex]
    return Mesh(
        positions[input_vertex],
        output_vertex.reshape(-1, 3).astype(np.uint32),
        normals[smooth_vertices[corner_of_vertex]],
        uv0=None if uv is None else uv[input_vertex],
        colors=None if colors is None else colors[input_vertex],
    )
