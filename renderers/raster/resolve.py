"""The outputs of a band from its visibility layer: depth, label, instance and normal."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.kernel_types import F32, F64, I32, I64, U32, Address, Number, Pointer, f64, i32, i64
from renderers.compiler.pointers import advance, f32_at, i32_at, stack_array
from renderers.compiler.simd import Lanes
from renderers.drawlist import LABEL_NONE
from renderers.primitive_ids import instance_of
from renderers.raster.layer import set_band_layer
from renderers.raster.layout import TOPOLOGY_TRIANGLES, Layer, RasterFrame

_corner_array = stack_array(F64, 9)
_adjugate_array = stack_array(F64, 9)
_normal_array = stack_array(F64, 9)
_BACKGROUND_LABEL: Final = int(np.uint32(LABEL_NONE).astype(np.int32))
_BACKGROUND_ID: Final = -1
_PREFETCH_DISTANCE: Final = 1024
"""Pixels from the one that is written to the one that is prefetched."""
_TOWARDS_CAMERA: Final = (0.0, 0.0, -1.0)
_NO_NORMAL: Final = (0.0, 0.0, 0.0)


@inlined
def _cross(a: Pointer[F64], b: Pointer[F64]) -> tuple[F64, F64, F64]:
    """Return a x b; pointers to three float64 each."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _camera_corners(
    X_camera_mesh: Pointer[F64], positions: Pointer[F32], indices: Pointer[U32], first_index: I64, corners: Pointer[F64]
) -> None:
    """Write the corners of a triangle in the camera's frame, metres: corner k to ``corners[3 k .. 3 k + 3]``.

    Args:
        X_camera_mesh: (4, 4).
        first_index: index of the triangle's first index.
    """
    m = X_camera_mesh
    for k in range(3):
        v = 3 * i64(indices[first_index + k])
        x, y, z = f64(positions[v]), f64(positions[v + 1]), f64(positions[v + 2])
        for axis in range(3):
            corners[3 * k + axis] = m[4 * axis] * x + m[4 * axis + 1] * y + m[4 * axis + 2] * z + m[4 * axis + 3]


@inlined
def _camera_normals(
    X_camera_mesh: Pointer[F64],
    normals: Pointer[F32],
    indices: Pointer[U32],
    first_index: I64,
    corner_normals: Pointer[F64],
) -> None:
    """Write the normals of a triangle's corners in the camera's frame, of any length; otherwise as ``_camera_corners``.

    Args:
        normals: (N, 3), in the mesh's frame.
        corner_normals: pointer to 9 float64: that of corner k goes to ``corner_normals[3 k .. 3 k + 3]``.
    """
    m = X_camera_mesh
    for axis in range(3):
        # Normals transform by the cofactors: the inverse transpose times the determinant.
        cx, cy, cz = _cross(advance(m, 4 * ((axis + 1) % 3)), advance(m, 4 * ((axis + 2) % 3)))
        for k in range(3):
            v = 3 * i64(indices[first_index + k])
            x, y, z = f64(normals[v]), f64(normals[v + 1]), f64(normals[v + 2])
            corner_normals[3 * k + axis] = cx * x + cy * y + cz * z


@inlined
def _adjugate(corners: Pointer[F64], out: Pointer[F64]) -> F64:
    """Write the adjugate of [p0 p1 p2], its inverse times its determinant: rows p1 x p2, p2 x p0 and p0 x p1.

    Args:
        corners: as from ``_camera_corners``.
        out: pointer to 9 float64: row k goes to ``out[3 k .. 3 k + 3]``.

    Returns:
        The determinant.
    """
    for k in range(3):
        a, b = advance(corners, 3 * ((k + 1) % 3)), advance(corners, 3 * ((k + 2) % 3))
        out[3 * k], out[3 * k + 1], out[3 * k + 2] = _cross(a, b)
    return out[0] * corners[0] + out[1] * corners[1] + out[2] * corners[2]


@inlined
def _geometric_normal(adjugate: Pointer[F64], determinant: F64) -> tuple[F64, F64, F64]:
    """Return the unit normal, in the camera's frame, of the side of a triangle that faces the camera.

    Args:
        adjugate, determinant: as from ``_adjugate``.
    """
    a = adjugate
    # The sum of the rows is n = (p1 - p0) x (p2 - p0). n . p0 is the determinant: negative where n faces the camera.
    x, y, z = a[0] + a[3] + a[6], a[1] + a[4] + a[7], a[2] + a[5] + a[8]
    length = np.sqrt(x * x + y * y + z * z)
    if not length > 0.0:
        return _TOWARDS_CAMERA
    scale = 1.0 / length if determinant <= 0.0 else -1.0 / length
    return x * scale, y * scale, z * scale


@inlined
def _smooth_normal(
    adjugate: Pointer[F64], corner_normals: Pointer[F64], ray_x: F64, ray_y: F64, flat_normal: tuple[F64, F64, F64]
) -> tuple[F64, F64, F64]:
    """Return the interpolated unit normal where a ray (ray_x, ray_y, 1) meets a triangle; ``flat_normal`` if none.

    Args:
        adjugate, corner_normals: as from ``_adjugate`` and ``_camera_normals``.
    """
    a, n = adjugate, corner_normals
    # The product of the rows and the ray is proportional to the barycentric coordinates.
    b0 = a[0] * ray_x + a[1] * ray_y + a[2]
    b1 = a[3] * ray_x + a[4] * ray_y + a[5]
    b2 = a[6] * ray_x + a[7] * ray_y + a[8]
    x = b0 * n[0] + b1 * n[3] + b2 * n[6]
    y = b0 * n[1] + b1 * n[4] + b2 * n[7]
    z = b0 * n[2] + b1 * n[5] + b2 * n[8]
    length = np.sqrt(x * x + y * y + z * z)
    if not (length > 0.0 and length < np.inf):
        return flat_normal
    # Facing the camera, as the geometric normal does; a and n may be negated by a mirrored frame.
    facing = x * flat_normal[0] + y * flat_normal[1] + z * flat_normal[2]
    scale = 1.0 / length if facing >= 0.0 else -1.0 / length
    return x * scale, y * scale, z * scale


@inlined
def _fill_normals(out: Pointer[F32], start: I64, stop: I64, normal: tuple[F64, F64, F64]) -> None:
    """Write one normal to the pixels ``start .. stop`` of a row.

    Args:
        out: pointer to the row, (width, 3).
    """
    for column in range(start, stop):
        for axis in range(3):
            out[3 * column + axis] = normal[axis]


@device_function
def _resolve_normal_span(
    frame: RasterFrame, instance_index: I64, primitive_id: I64, row: I64, start: I64, stop: I64
) -> None:
    """Write the normals, unit vectors in the camera's frame, of the pixels ``start .. stop`` that see one primitive.

    Args:
        instance_index: of the primitive's instance.
    """
    out = advance(f32_at(frame.normal), 3 * row * frame.width)
    instance = frame.instances[instance_index]
    if instance.topology != TOPOLOGY_TRIANGLES:
        _fill_normals(out, start, stop, _TOWARDS_CAMERA)
        return
    X_camera_mesh = advance(frame.X_camera_mesh, 16 * instance_index)
    first_index = 3 * (primitive_id - instance.first_primitive)
    corners, adjugate, corner_normals = _corner_array(), _adjugate_array(), _normal_array()
    _camera_corners(X_camera_mesh, instance.mesh_positions, instance.mesh_indices, first_index, corners)
    determinant = _adjugate(corners, adjugate)
    flat_normal = _geometric_normal(adjugate, determinant)
    if instance.mesh_normals == 0:
        _fill_normals(out, start, stop, flat_normal)
        return
    mesh_normals = f32_at(instance.mesh_normals)
    _camera_normals(X_camera_mesh, mesh_normals, instance.mesh_indices, first_index, corner_normals)
    ray_y = (row + 0.5 - frame.cy) / frame.fy
    for column in range(start, stop):
        ray_x = (column + 0.5 - frame.cx) / frame.fx
        normal = _smooth_normal(adjugate, corner_normals, ray_x, ray_y, flat_normal)
        _fill_normals(out, column, column + 1, normal)


@kernel
def resolve_normals(frame_address: Address, first_row: I64, end_row: I64, band_memory: Address) -> None:
    """Write the normals of a band, by spans of pixels that see one primitive.

    Few images have normals. A separate kernel, since it is compiled only after the server is ready.
    """
    frame, layer = RasterFrame(frame_address), Layer()
    set_band_layer(frame, layer, first_row, band_memory)
    width = frame.width
    instance_index = i64(0)
    for row in range(first_row, end_row):
        ids = advance(layer.ids, (row - layer.first_row) * frame.stride)
        start = 0
        while start < width:
            primitive_id = i64(ids[start])
            stop = start + 1
            while stop < width and ids[stop] == primitive_id:
                stop += 1
            if primitive_id >= 0:
                # The last one found is tried first.
                instance_index = instance_of(frame.first_ids, frame.instance_count, primitive_id, instance_index)
                _resolve_normal_span(frame, instance_index, primitive_id, row, start, stop)
            else:
                _fill_normals(advance(f32_at(frame.normal), 3 * row * width), start, stop, _NO_NORMAL)
            start = stop


@device_function
def _resolve_depth_row(inv_z: Pointer[F32], ids: Pointer[I32], out: Pointer[F32], width: I64) -> None:
    """Write the depth of one row.

    Args:
        inv_z, ids: pointers to the row's 1/z and primitive ids, whole vectors of them.
        out: ``width`` float32, metres.
    """
    one, no_depth, zero = vec.f32(1.0), vec.f32(np.inf), vec.i32(0)
    for column in range(0, width, vec.LANES):
        visible = vec.load(ids, column) >= zero
        _store_columns(out, column, width, vec.select(visible, one / vec.load(inv_z, column), no_depth))


@inlined
def _store_columns(out: Pointer[Number], column: I64, width: I64, values: Lanes) -> None:
    """Write eight values of a row, or those before its end.

    Args:
        out: pointer to the row, ``width`` values.
        values: vector of them.
    """
    if column + vec.LANES <= width:
        vec.prefetch(out, column + _PREFETCH_DISTANCE)
        vec.store(out, column, values)
    else:
        for k in range(width - column):
            out[column + k] = vec.lane(values, k)


@device_function
def _resolve_instance_row(
    frame: RasterFrame, ids: Pointer[I32], table: Pointer[I32], background: I64, out: Pointer[I32]
) -> None:
    """Write the value of the instance that each pixel of a row sees, eight pixels at a time.

    Args:
        ids: pointer to the row's primitive ids, whole vectors of them.
        table: (instance_count,), the instances' values.
        background: value where nothing is seen.
        out: pointer to the row's output.
    """
    first_ids, width = frame.first_ids, frame.width
    # The instance that was seen last, its value, and the range of its primitive ids.
    last_index, last_value, first_id, end_id = i64(0), i32(0), i64(0), i64(0)
    for column in range(0, width, vec.LANES):
        eight_ids = vec.load(ids, column)
        sees_last = (eight_ids >= vec.i32(first_id)) & (eight_ids < vec.i32(end_id))
        values = vec.select(sees_last, vec.i32(last_value), vec.i32(background))
        pending = vec.movemask((eight_ids >= vec.i32(0)) & ~sees_last)
        while pending != 0:
            primitive_id = i64(ids[column + vec.lowest_bit(pending)])
            last_index = instance_of(first_ids, frame.instance_count, primitive_id, last_index)
            last_value, first_id, end_id = table[last_index], first_ids[last_index], first_ids[last_index + 1]
            sees_last = (eight_ids >= vec.i32(first_id)) & (eight_ids < vec.i32(end_id))
            values = vec.select(sees_last, vec.i32(last_value), values)
            pending &= ~vec.movemask(sees_last)
        _store_columns(out, column, width, values)


@kernel
def resolve_band(frame_address: Address, first_row: I64, end_row: I64, band_memory: Address) -> None:
    """Write the wanted outputs of a band.

    Args:
        frame_address: address of a RasterFrame.
    """
    frame, layer = RasterFrame(frame_address), Layer()
    set_band_layer(frame, layer, first_row, band_memory)
    for row in range(first_row, end_row):
        layer_pixel, pixel = (row - layer.first_row) * frame.stride, row * frame.width
        ids, inv_z = advance(layer.ids, layer_pixel), advance(layer.inv_z, layer_pixel)
        # One output after the other: consecutive stores to a cache line are combined.
        if frame.depth != 0:
            _resolve_depth_row(inv_z, ids, advance(f32_at(frame.depth), pixel), frame.width)
        if frame.label != 0:
            _resolve_instance_row(frame, ids, frame.labels, _BACKGROUND_LABEL, advance(i32_at(frame.label), pixel))
        if frame.instance != 0:
            out = advance(i32_at(frame.instance), pixel)
            _resolve_instance_row(frame, ids, frame.instance_ids, _BACKGROUND_ID, out)
    if frame.normal != 0:
        call_kernel(frame.normals_kernel, (frame_address, first_row, end_row, band_memory))
