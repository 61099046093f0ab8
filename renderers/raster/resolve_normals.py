"""The output ``normal`` of a band from its visibility layer: unit vectors in the camera's frame, towards the camera.

For each run of pixels that see one triangle with corners p0, p1, p2 in the camera's frame:

1. the adjugate of the matrix [p0 p1 p2]: rows p1 x p2, p2 x p0, p0 x p1. Its product with a pixel's ray is
   proportional to the barycentric coordinates there;
2. the geometric normal, the sum of these rows;
3. if the mesh has normals, those of the corners, interpolated at each pixel.
"""

from typing import Final, NamedTuple

import numpy as np

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F32, F64, I64, U32, Address, Pointer, f64, i64
from renderers.compiler.pointers import advance, f32_at
from renderers.primitive_ids import instance_of
from renderers.raster.layout import TRIANGLE_VERTICES, Layer, RasterFrame, set_band_layer
from renderers.shading.vec3 import cross, dot, times

Vector = tuple[F64, F64, F64]
_TOWARDS_CAMERA: Final = (0.0, 0.0, -1.0)
_NO_NORMAL: Final = (0.0, 0.0, 0.0)


class _Rows(NamedTuple):
    """A 3 x 3 matrix, or one vector for each corner of a triangle."""

    first: Vector
    second: Vector
    third: Vector


@kernel
def resolve_normals(frame_address: Address, first_row: I64, end_row: I64, band_memory: Address) -> None:
    """Write the normals of a band, by spans of pixels that see one primitive.

    Few images have normals. A separate kernel, since it is compiled only after the server is ready.
    """
    frame, layer = RasterFrame(frame_address), Layer()
    set_band_layer(frame, layer, first_row, band_memory)
    instance_index = i64(0)
    for row in range(first_row, end_row):
        ids = advance(layer.ids, (row - layer.first_row) * frame.stride)
        start = 0
        while start < frame.width:
            primitive_id = i64(ids[start])
            stop = start + 1
            while stop < frame.width and ids[stop] == primitive_id:
                stop += 1
            if primitive_id >= 0:
                # The last one found is tried first.
                instance_index = instance_of(frame.first_ids, frame.instance_count, primitive_id, instance_index)
                _write_span(frame, instance_index, primitive_id, row, start, stop)
            else:
                _fill(_row_of_normals(frame, row), start, stop, _NO_NORMAL)
            start = stop


@inlined
def _row_of_normals(frame: RasterFrame, row: I64) -> Pointer[F32]:
    """Return a row of the output, (width, 3)."""
    return advance(f32_at(frame.normal_out), 3 * row * frame.width)


@device_function
def _write_span(frame: RasterFrame, instance_index: I64, primitive_id: I64, row: I64, start: I64, stop: I64) -> None:
    """Write the normals of the pixels ``start .. stop`` of a row, which see one primitive of an instance."""
    out, instance = _row_of_normals(frame, row), frame.instances[instance_index]
    if instance.vertices_per_primitive != TRIANGLE_VERTICES:
        _fill(out, start, stop, _TOWARDS_CAMERA)
        return
    X_camera_mesh = advance(frame.X_camera_mesh, 16 * instance_index)
    corner_indices = advance(instance.mesh_indices, 3 * (primitive_id - instance.first_id))
    corners = _camera_corners(X_camera_mesh, instance.mesh_positions, corner_indices)
    adjugate = _adjugate(corners)
    flat_normal = _geometric_normal(adjugate, dot(adjugate.first, corners.first))
    if instance.mesh_normals == 0:
        _fill(out, start, stop, flat_normal)
        return
    corner_normals = _camera_normals(X_camera_mesh, f32_at(instance.mesh_normals), corner_indices)
    ray_y = (row + 0.5 - frame.cy) / frame.fy
    for column in range(start, stop):
        ray = (column + 0.5 - frame.cx) / frame.fx, ray_y, 1.0
        _fill(out, column, column + 1, _smooth_normal(adjugate, corner_normals, ray, flat_normal))


@inlined
def _fill(out: Pointer[F32], start: I64, stop: I64, normal: Vector) -> None:
    """Write one normal to the pixels ``start .. stop`` of a row."""
    for column in range(start, stop):
        out[3 * column], out[3 * column + 1], out[3 * column + 2] = normal


@inlined
def _load_vector(values: Pointer[F32], k: I64) -> Vector:
    """Return vector ``k`` of (N, 3)."""
    return f64(values[3 * k]), f64(values[3 * k + 1]), f64(values[3 * k + 2])


@inlined
def _transform_point(X: Pointer[F64], p: Vector) -> Vector:
    """Return a point transformed by a (4, 4) matrix."""
    return (
        X[0] * p[0] + X[1] * p[1] + X[2] * p[2] + X[3],
        X[4] * p[0] + X[5] * p[1] + X[6] * p[2] + X[7],
        X[8] * p[0] + X[9] * p[1] + X[10] * p[2] + X[11],
    )


@inlined
def _camera_corners(X_camera_mesh: Pointer[F64], positions: Pointer[F32], corner_indices: Pointer[U32]) -> _Rows:
    """Return the corners of a triangle in the camera's frame, metres."""
    return _Rows(
        _transform_point(X_camera_mesh, _load_vector(positions, i64(corner_indices[0]))),
        _transform_point(X_camera_mesh, _load_vector(positions, i64(corner_indices[1]))),
        _transform_point(X_camera_mesh, _load_vector(positions, i64(corner_indices[2]))),
    )


@inlined
def _adjugate(m: _Rows) -> _Rows:
    """Return the adjugate of the matrix with these columns: its inverse times its determinant."""
    return _Rows(cross(m.second, m.third), cross(m.third, m.first), cross(m.first, m.second))


@inlined
def _times(matrix: _Rows, v: Vector) -> Vector:
    """Return the product of a matrix and a vector."""
    return dot(matrix.first, v), dot(matrix.second, v), dot(matrix.third, v)


@inlined
def _camera_normals(X_camera_mesh: Pointer[F64], normals: Pointer[F32], corner_indices: Pointer[U32]) -> _Rows:
    """Return the normals of a triangle's corners in the camera's frame, of any length.

    Normals transform by the cofactors, the inverse transpose times the determinant.
    """
    X = X_camera_mesh
    cofactors = _adjugate(_Rows((X[0], X[1], X[2]), (X[4], X[5], X[6]), (X[8], X[9], X[10])))
    return _Rows(
        _times(cofactors, _load_vector(normals, i64(corner_indices[0]))),
        _times(cofactors, _load_vector(normals, i64(corner_indices[1]))),
        _times(cofactors, _load_vector(normals, i64(corner_indices[2]))),
    )


@inlined
def _geometric_normal(adjugate: _Rows, determinant: F64) -> Vector:
    """Return the unit normal of the side of a triangle that faces the camera.

    The sum of the adjugate's rows is n = (p1 - p0) x (p2 - p0). n . p0 is the determinant: negative where n faces the
    camera.
    """
    a, b, c = adjugate
    n = a[0] + b[0] + c[0], a[1] + b[1] + c[1], a[2] + b[2] + c[2]
    length = np.sqrt(dot(n, n))
    if not length > 0.0:
        return _TOWARDS_CAMERA
    scale = 1.0 / length if determinant <= 0.0 else -1.0 / length
    return times(n, scale)


@inlined
def _smooth_normal(adjugate: _Rows, corner_normals: _Rows, ray: Vector, flat_normal: Vector) -> Vector:
    """Return the interpolated unit normal where a ray (x, y, 1) meets a triangle; ``flat_normal`` if there is none."""
    barycentric, (n0, n1, n2) = _times(adjugate, ray), corner_normals
    n = (
        dot(barycentric, (n0[0], n1[0], n2[0])),
        dot(barycentric, (n0[1], n1[1], n2[1])),
        dot(barycentric, (n0[2], n1[2], n2[2])),
    )
    length = np.sqrt(dot(n, n))
    if not (length > 0.0 and length < np.inf):
        return flat_normal
    # Facing the camera, as the geometric normal does; a mirrored frame negates the adjugate and the normals.
    scale = 1.0 / length if dot(n, flat_normal) >= 0.0 else -1.0 / length
    return times(n, scale)
