"""Computes normals for meshes without normals: smooth, except at creases, where vertices are duplicated.

Which edges are creases depends on the format:

- Meshes of Director and Drake's viewer, OBJ, STL, PLY and the other mesh files: edges of more than ``CREASE_ANGLE``.
- Shapes in requests of Drake's render client: none. VTK's exporter omits their normals, but not their seams: at edges
  that RenderEngineVtk shows, vertices are not shared.
- Other glTF files: all (glTF 2.0, 3.7.2.1). Meshes without normals are flat, so that nothing is computed here.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pending import wait_until_compiled
from renderers.compiler.pointers import address_of
from renderers.compiler.structs import F32, F64, I64, U32, Struct, pointer_to
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

CREASED_MESH: Final = Struct(
    "CreasedMesh",
    {
        "positions": pointer_to(F32),  # (N, 3)
        "faces": pointer_to(U32),  # (M, 3)
        "vertex_count": I64,  # N
        "face_count": I64,  # M
        "crease_cosine": F64,  # cosine of the crease angle
        "stop_at": I64,  # address of a StopFlag; the outputs are incomplete once it is set
        # Scratch.
        "area_normals": pointer_to(F64),  # (M, 3): cross products of the faces' edges; their length is twice the area
        "unit_normals": pointer_to(F64),  # (M, 3): normals of the faces
        "corners": pointer_to(I64),  # (3 M,): corners of the faces (3 * face + 0, 1 or 2), sorted by their vertex
        "starts": pointer_to(I64),  # (N + 2,), zeros at first: vertex v has corners[starts[v] : starts[v + 1]]
        # Outputs. There are at most 3 M output vertices.
        "source_vertex": pointer_to(I64),  # (3 M,): input vertex of each output vertex
        "out_normals": pointer_to(F32),  # (3 M, 3): normal of each output vertex
        "out_faces": pointer_to(U32),  # (M, 3): output vertices of the faces
    },
)
"""A mesh of N vertices and M triangular faces, and the arrays that ``smooth_mesh`` computes."""
_mesh_at: Final = CREASED_MESH.at


@device_function
def _write_face_normals(mesh):
    """Write ``area_normals`` and ``unit_normals`` of a CREASED_MESH; a face without area has the unit normal +z."""
    positions, faces, area_normals, unit_normals = mesh.positions, mesh.faces, mesh.area_normals, mesh.unit_normals
    for face in range(mesh.face_count):
        a, b, c = (
            3 * np.int64(faces[3 * face]),
            3 * np.int64(faces[3 * face + 1]),
            3 * np.int64(faces[3 * face + 2]),
        )
        ux = np.float64(positions[b]) - positions[a]
        uy = np.float64(positions[b + 1]) - positions[a + 1]
        uz = np.float64(positions[b + 2]) - positions[a + 2]
        vx = np.float64(positions[c]) - positions[a]
        vy = np.float64(positions[c + 1]) - positions[a + 1]
        vz = np.float64(positions[c + 2]) - positions[a + 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area_normals[3 * face], area_normals[3 * face + 1], area_normals[3 * face + 2] = x, y, z
        length = math.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            x, y, z = x / length, y / length, z / length
        else:
            x, y, z = 0.0, 0.0, 1.0
        unit_normals[3 * face], unit_normals[3 * face + 1], unit_normals[3 * face + 2] = x, y, z


@device_function
def _sort_corners(mesh):
    """Write ``corners`` and ``starts`` of a CREASED_MESH: a counting sort by vertex."""
    faces, starts, corners = mesh.faces, mesh.starts, mesh.corners
    corner_count = 3 * mesh.face_count
    # The count of vertex v is kept at starts[v + 2]. The sums below turn starts[v + 1] into the start of vertex v, and
    # writing its corners increments starts[v + 1] to their end, which is the start of vertex v + 1.
    for corner in range(corner_count):
        starts[np.int64(faces[corner]) + 2] += 1
    for vertex in range(2, mesh.vertex_count + 2):
        starts[vertex] += starts[vertex - 1]
    for corner in range(corner_count):
        next_vertex = np.int64(faces[corner]) + 1
        corners[starts[next_vertex]] = corner
        starts[next_vertex] += 1


@kernel("int64(int64)")
def _split_at_creases(mesh_at):
    """Compute the outputs of a CREASED_MESH, and return its number of output vertices.

    The normal at a face's corner is the mean normal, weighted by area, of some faces around the corner's vertex: those
    whose normals are within the crease angle of the face's own normal. Corners of a vertex whose normals are
    (almost) the same share one output vertex.
    """
    mesh = _mesh_at(mesh_at)
    area_normals, unit_normals, starts, corners = mesh.area_normals, mesh.unit_normals, mesh.starts, mesh.corners
    source_vertex, out_normals, out_faces = mesh.source_vertex, mesh.out_normals, mesh.out_faces
    _write_face_normals(mesh)
    _sort_corners(mesh)
    crease_cosine = mesh.crease_cosine
    half_angle_cosine = math.sqrt((1.0 + crease_cosine) / 2.0) if crease_cosine > -1.0 else -math.inf
    out_count = 0
    for vertex in range(mesh.vertex_count):
        if vertex % _STEPS_PER_STOP_CHECK == 0 and is_set(mesh.stop_at):
            return out_count
        start, end = starts[vertex], starts[vertex + 1]
        # At most vertices there is no crease. This is certain if all faces are within half the crease angle of their
        # mean normal, because then any two of them are within the crease angle of each other.
        x, y, z = 0.0, 0.0, 0.0
        for i in range(start, end):
            face = 3 * (corners[i] // 3)
            x += area_normals[face]
            y += area_normals[face + 1]
            z += area_normals[face + 2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            x, y, z = x / length, y / length, z / length
            has_crease = False
            for i in range(start, end):
                face = 3 * (corners[i] // 3)
                cosine = unit_normals[face] * x + unit_normals[face + 1] * y + unit_normals[face + 2] * z
                if cosine <= half_angle_cosine:
                    has_crease = True
                    break
            if not has_crease:
                out_normals[3 * out_count], out_normals[3 * out_count + 1], out_normals[3 * out_count + 2] = x, y, z
                source_vertex[out_count] = vertex
                for i in range(start, end):
                    out_faces[corners[i]] = out_count
                out_count += 1
                continue
        first_out_vertex = out_count
        too_many_faces = end - start > MAX_FACES_PER_VERTEX
        for i in range(start, end):
            if i % _STEPS_PER_STOP_CHECK == 0 and is_set(mesh.stop_at):
                return out_count
            face = 3 * (corners[i] // 3)
            x, y, z = 0.0, 0.0, 0.0
            if not too_many_faces:
                for j in range(start, end):
                    other = 3 * (corners[j] // 3)
                    cosine = (
                        unit_normals[face] * unit_normals[other]
                        + unit_normals[face + 1] * unit_normals[other + 1]
                        + unit_normals[face + 2] * unit_normals[other + 2]
                    )
                    if cosine > crease_cosine:
                        x += area_normals[other]
                        y += area_normals[other + 1]
                        z += area_normals[other + 2]
            length = math.sqrt(x * x + y * y + z * z)
            if length > 0.0:
                x, y, z = x / length, y / length, z / length
            else:
                x, y, z = unit_normals[face], unit_normals[face + 1], unit_normals[face + 2]
            out_vertex = max(first_out_vertex, out_count - MAX_FACES_PER_VERTEX)
            while out_vertex < out_count:
                cosine = (
                    out_normals[3 * out_vertex] * x
                    + out_normals[3 * out_vertex + 1] * y
                    + out_normals[3 * out_vertex + 2] * z
                )
                if cosine > _SAME_NORMAL_COSINE:
                    break
                out_vertex += 1
            if out_vertex == out_count:
                out_normals[3 * out_count], out_normals[3 * out_count + 1], out_normals[3 * out_count + 2] = x, y, z
                source_vertex[out_count] = vertex
                out_count += 1
            out_faces[corners[i]] = out_vertex
    return out_count


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
    wait_until_compiled("formats")
    vertex_count, face_count, corner_count = len(positions), len(faces), faces.size
    area_normals, unit_normals = np.empty((2, face_count, 3), np.float64)
    corners, source_vertex = np.empty((2, corner_count), np.int64)
    starts = np.zeros(vertex_count + 2, np.int64)
    normals, out_faces = np.empty((corner_count, 3), np.float32), np.empty((face_count, 3), np.uint32)
    stop = current_stop()
    mesh = np.zeros(1, CREASED_MESH.dtype)
    mesh[0] = (
        *(address_of(positions, np.float32), address_of(faces, np.uint32), vertex_count, face_count),
        *(math.cos(math.radians(crease_angle)), stop.address),
        *(address_of(area_normals, np.float64), address_of(unit_normals, np.float64)),
        *(address_of(array, np.int64) for array in (corners, starts, source_vertex)),
        *(address_of(normals, np.float32), address_of(out_faces, np.uint32)),
    )
    out_count = _split_at_creases(address_of(mesh, CREASED_MESH.dtype))
    stop.check()
    return source_vertex[:out_count], out_faces, normals[:out_count].copy()


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
