"""Computes normals for meshes without normals: smooth, except at creases, where vertices are duplicated.

Which edges are creases depends on the format:

- Meshes of Director and Drake's viewer, OBJ, STL, PLY and the other mesh files: edges of more than ``CREASE_ANGLE``.
- Shapes in requests of Drake's render client: none. VTK's exporter omits their normals, but not their seams: at edges
  that RenderEngineVtk shows, vertices are not shared.
- Other glTF files: all (glTF 2.0, 3.7.2.1). Meshes without normals are flat, so that nothing is computed here.
"""

import math
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.equal_rows import first_of_equal, first_of_equal_pairs
from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel, read_only
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import F64, I64, Address, Array1, Array2, ReadOnly2, f64, i64, u64
from renderers.drawlist import Mesh
from renderers.stop import current_stop

CREASE_ANGLE: Final = 45.0
"""Degrees between the normals of faces above which their edge is a crease. It is Director's feature angle."""
NO_CREASES: Final = 180.0
"""Crease angle with which faces that share a vertex share its normal."""
MAX_FACES_PER_VERTEX: Final = 256
"""Maximum number of faces at a vertex for smooth normals, whose time grows with the square of this number. At a vertex
with more faces, each corner has the normal of its own face, and is compared with as many output vertices at most."""
UNUSED, SMOOTH, CREASED = range(3)
"""Kinds of vertices: without a face, without a crease, and others."""
_STEPS_PER_STOP_CHECK: Final = 1 << 10
"""Vertices, or corners of a vertex, between two checks of the ``StopFlag``."""
_SAME_NORMAL_COSINE: Final = 0.99999
"""Corners of one vertex share an output vertex if the cosine of the angle between their normals is larger than this
(0.26 degrees)."""


@inlined
def _face_normals(positions: ReadOnly2[np.float32], faces: ReadOnly2[np.uint32]) -> Array2[np.float64]:
    """Return each face's cross product of two edges, twice as long as its area, and its length, (M, 4)."""
    face_normals = np.empty((len(faces), 4))
    for face in range(len(faces)):
        a, b, c = positions[faces[face, 0]], positions[faces[face, 1]], positions[faces[face, 2]]
        ux, uy, uz = f64(b[0]) - a[0], f64(b[1]) - a[1], f64(b[2]) - a[2]
        vx, vy, vz = f64(c[0]) - a[0], f64(c[1]) - a[1], f64(c[2]) - a[2]
        normal = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        _write(face_normals, face, normal)
        face_normals[face, 3] = _length(normal)
    return face_normals


@inlined
def _vertex_normals(
    face_normals: Array2[np.float64], faces: ReadOnly2[np.uint32], vertex_count: I64, half_angle_cosine: F64
) -> tuple[Array2[np.float64], Array1[np.uint8]]:
    """Return the mean normal of the faces around each vertex, (N, 3), and the vertices' kinds, (N,).

    Two faces within half the crease angle of their mean normal are within the crease angle of each other, so that a
    vertex is SMOOTH if this holds for all its faces.
    """
    normals, kinds = np.zeros((vertex_count, 3)), np.full(vertex_count, UNUSED, np.uint8)
    for face in range(len(faces)):
        for k in range(3):
            vertex = faces[face, k]
            _write(normals, vertex, _plus(_row(normals, vertex), face_normals, face))
            kinds[vertex] = SMOOTH
    for vertex in range(vertex_count):
        total = _row(normals, vertex)
        if kinds[vertex] == SMOOTH and _length(total) == 0.0:
            kinds[vertex] = CREASED
        _write(normals, vertex, _unit(total, (0.0, 0.0, 0.0)))
    for face in range(len(faces)):
        for k in range(3):
            vertex = faces[face, k]
            if not _is_within(face_normals, face, _row(normals, vertex), half_angle_cosine):
                kinds[vertex] = CREASED
    return normals, kinds


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
def _row(vectors: Array2[np.float64], row: I64) -> tuple[F64, F64, F64]:
    return vectors[row, 0], vectors[row, 1], vectors[row, 2]


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
def _length(vector: tuple[F64, F64, F64]) -> F64:
    return math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])


@inlined
def _unit(vector: tuple[F64, F64, F64], fallback: tuple[F64, F64, F64]) -> tuple[F64, F64, F64]:
    """Return a vector at length 1, or ``fallback`` if it has no length."""
    length = _length(vector)
    return (vector[0] / length, vector[1] / length, vector[2] / length) if length > 0.0 else fallback


@inlined
def _is_within(face_normals: Array2[np.float64], face: I64, normal: tuple[F64, F64, F64], cosine: F64) -> bool:
    """Return True if the angle between a face's normal and a unit vector has a cosine above ``cosine``.

    A face without area has the normal +z.
    """
    length = face_normals[u64(face), 3]
    return _dot(face_normals, face, normal) > cosine * length if length > 0.0 else normal[2] > cosine


@inlined
def _corner_normal(
    face: I64, corners: Array1[np.uint32], face_normals: Array2[np.float64], crease_cosine: F64
) -> tuple[F64, F64, F64]:
    """Return the mean normal, weighted by area, of the faces around a vertex within the crease angle of one of them."""
    row = u64(face)
    length = face_normals[row, 3]
    own, total = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    if length > 0.0:
        own = face_normals[row, 0] / length, face_normals[row, 1] / length, face_normals[row, 2] / length
    if len(corners) <= MAX_FACES_PER_VERTEX:
        for corner in corners:
            other = i64(corner // 3)
            if _dot(face_normals, other, own) > crease_cosine * face_normals[u64(other), 3]:
                total = _plus(total, face_normals, other)
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
    half_angle_cosine = math.sqrt((1.0 + crease_cosine) / 2.0) if crease_cosine > -1.0 else -math.inf
    face_normals = _face_normals(positions, faces)
    normals, kinds = _vertex_normals(face_normals, faces, len(positions), half_angle_cosine)
    sorted_corners, starts = np.empty(0, np.uint32), np.empty(0, np.uint32)
    if np.any(kinds == CREASED):
        sorted_corners, starts = _corners_by_vertex(faces, len(positions))
    vertices, first_out_vertices = faces.reshape(-1), np.empty(len(positions), np.uint32)
    source_vertex, out_faces = np.empty(faces.size, np.int64), np.empty(faces.size, np.uint32)
    out_normals = np.empty((faces.size, 3), np.float32)
    out_count = 0
    for vertex in range(len(positions)):
        if vertex % _STEPS_PER_STOP_CHECK == 0 and is_set(stop_at):
            break
        first_out_vertex = first_out_vertices[vertex] = out_count
        if kinds[vertex] == SMOOTH:
            _write(out_normals, out_count, _row(normals, vertex))
            source_vertex[out_count] = vertex
            out_count += 1
        elif kinds[vertex] == CREASED:
            corners = sorted_corners[starts[vertex] : starts[vertex + 1]]
            for i in range(len(corners)):
                if i % _STEPS_PER_STOP_CHECK == 0 and is_set(stop_at):
                    break
                normal = _corner_normal(corners[i] // 3, corners, face_normals, crease_cosine)
                out_vertex = max(first_out_vertex, out_count - MAX_FACES_PER_VERTEX)
                while out_vertex < out_count and _dot(out_normals, out_vertex, normal) <= _SAME_NORMAL_COSINE:
                    out_vertex += 1
                if out_vertex == out_count:
                    _write(out_normals, out_count, normal)
                    source_vertex[out_count] = vertex
                    out_count += 1
                out_faces[corners[i]] = out_vertex
    for corner in range(len(vertices)):
        if kinds[vertices[corner]] == SMOOTH:
            out_faces[corner] = first_out_vertices[vertices[corner]]
    return source_vertex[:out_count].copy(), out_faces.reshape(-1, 3), out_normals[:out_count].copy()


def smooth_mesh(
    positions: NDArray[np.float32], faces: NDArray[np.uint32]
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """Return positions (K, 3), faces (M, 3) and unit normals (K, 3) of a copy of a mesh.

    Vertices are duplicated at creases; unused ones are left out. The input is finite and C-contiguous, (N, 3) and (M,
    3), every index < N (not checked).
    """
    source_vertex, out_faces, normals = smooth_vertices(positions, faces)
    return positions.take(source_vertex, axis=0), out_faces, normals  # a quarter of an index's time


def smooth_vertices(
    positions: NDArray[np.float32], faces: NDArray[np.uint32], crease_angle: float = CREASE_ANGLE
) -> tuple[NDArray[np.int64], NDArray[np.uint32], NDArray[np.float32]]:
    """Return what ``smooth_mesh`` does, with the vertex in ``positions`` of each position, (K,), in its place.

    The crease angle is in degrees, up to ``NO_CREASES``.
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

    Positions (N, 3) are finite; ``uv`` is (N, 2), ``colors`` (N, 4).
    """
    # Positions are compared as integers; adding 0 turns -0 into 0.
    first_vertex, merged_vertex = first_of_equal(np.ascontiguousarray(positions + np.float32(0.0)).view(np.uint32))
    merged_triangles = merged_vertex.take(triangles)
    smooth_positions, smooth_triangles, normals = smooth_mesh(positions.take(first_vertex, axis=0), merged_triangles)
    if uv is None and colors is None:
        return Mesh(smooth_positions, smooth_triangles, normals)
    # One output vertex for each pair of an input vertex, which has uv and colour, and a smooth vertex, with its normal.
    vertices, smooth_vertices = triangles.reshape(-1), smooth_triangles.reshape(-1)
    corner_of_vertex, output_vertex = first_of_equal_pairs(vertices, smooth_vertices, len(positions))
    input_vertex = vertices[corner_of_vertex]
    return Mesh(
        positions.take(input_vertex, axis=0),
        output_vertex.reshape(-1, 3),
        normals.take(smooth_vertices[corner_of_vertex], axis=0),
        uv0=None if uv is None else uv.take(input_vertex, axis=0),
        colors=None if colors is None else colors.take(input_vertex, axis=0),
    )
