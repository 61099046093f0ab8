"""The kernel that draws a band, and its outputs: depth, label, instance and normal from the visibility layer."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.pointers import address, advance, f32_at, i32_at, stack_array
from renderers.drawlist import LABEL_NONE
from renderers.primitive_ids import instance_of
from renderers.raster.coverage import clear_rows, draw_rows
from renderers.raster.layout import LAYER, TOPOLOGY_TRIANGLES, frame_at
from renderers.visibility_buffer import BAND_ROWS

_new_layer = LAYER.local
_layer_at = LAYER.at
_corner_array = stack_array(types.float64, 9)
_inverse_array = stack_array(types.float64, 9)
_normal_array = stack_array(types.float64, 9)
_instance_cache_array = stack_array(types.int64, 9)
_block_array = stack_array(types.int32, 2 * vec.LANES)


@inlined
def _load_corners(m, positions, indices, first_index, p):
    """Write the corners of a triangle in the camera's frame to the columns of ``p``, (3, 3) float64.

    Args:
        m: pointer to X_camera_mesh, (4, 4) float64.
        first_index: index of the triangle's first index.
    """
    for k in range(3):
        v = 3 * np.int64(indices[first_index + k])
        x, y, z = np.float64(positions[v]), np.float64(positions[v + 1]), np.float64(positions[v + 2])
        for axis in range(3):
            p[3 * k + axis] = m[4 * axis] * x + m[4 * axis + 1] * y + m[4 * axis + 2] * z + m[4 * axis + 3]


@inlined
def _load_normals(m, normals, indices, first_index, n):
    """Write the normals of a triangle's corners to the columns of ``n``; otherwise as ``_load_corners``."""
    for k in range(3):
        v = 3 * np.int64(indices[first_index + k])
        x, y, z = np.float64(normals[v]), np.float64(normals[v + 1]), np.float64(normals[v + 2])
        # Normals transform by the cofactors: the inverse transpose times the determinant.
        for axis in range(3):
            i, j = 4 * ((axis + 1) % 3), 4 * ((axis + 2) % 3)
            cx = m[i + 1] * m[j + 2] - m[i + 2] * m[j + 1]
            cy = m[i + 2] * m[j] - m[i] * m[j + 2]
            cz = m[i] * m[j + 1] - m[i + 1] * m[j]
            n[3 * k + axis] = cx * x + cy * y + cz * z


@inlined
def _invert(p, b):
    """Write the inverse of ``p`` times its determinant to the rows of ``b``, and return the determinant."""
    for k in range(3):
        i, j = 3 * ((k + 1) % 3), 3 * ((k + 2) % 3)
        b[3 * k] = p[i + 1] * p[j + 2] - p[i + 2] * p[j + 1]
        b[3 * k + 1] = p[i + 2] * p[j] - p[i] * p[j + 2]
        b[3 * k + 2] = p[i] * p[j + 1] - p[i + 1] * p[j]
    return b[0] * p[0] + b[1] * p[1] + b[2] * p[2]


@inlined
def _geometric_normal(b, determinant):
    """Return the unit normal that faces the camera of the triangle whose inverse and determinant are given."""
    # The sum of the rows is (p1 - p0) x (p2 - p0).
    x, y, z = b[0] + b[3] + b[6], b[1] + b[4] + b[7], b[2] + b[5] + b[8]
    length = np.sqrt(x * x + y * y + z * z)
    if not length > 0.0:
        return 0.0, 0.0, -1.0
    scale = 1.0 / length if determinant <= 0.0 else -1.0 / length
    return x * scale, y * scale, z * scale


@inlined
def _smooth_normal(b, n, ray_x, ray_y, flat):
    """Return the interpolated unit normal where a ray (ray_x, ray_y, 1) meets a triangle; ``flat`` if it has none."""
    # The product of the rows and the ray is proportional to the barycentric coordinates.
    b0 = b[0] * ray_x + b[1] * ray_y + b[2]
    b1 = b[3] * ray_x + b[4] * ray_y + b[5]
    b2 = b[6] * ray_x + b[7] * ray_y + b[8]
    x = b0 * n[0] + b1 * n[3] + b2 * n[6]
    y = b0 * n[1] + b1 * n[4] + b2 * n[7]
    z = b0 * n[2] + b1 * n[5] + b2 * n[8]
    length = np.sqrt(x * x + y * y + z * z)
    if not (length > 0.0 and length < np.inf):
        return flat
    # Facing the camera, as the geometric normal does; b and n may be negated by a mirrored frame.
    scale = 1.0 / length if x * flat[0] + y * flat[1] + z * flat[2] >= 0.0 else -1.0 / length
    return x * scale, y * scale, z * scale


@device_function
def _resolve_normal_span(frame, instance_index, primitive_id, row, start, stop):
    """Write the normals of the pixels ``start .. stop`` of a row, which all see one primitive."""
    out = advance(f32_at(frame.normal), 3 * row * frame.width)
    instance = frame.instances[instance_index]
    if instance.topology != TOPOLOGY_TRIANGLES:
        for column in range(start, stop):
            out[3 * column] = 0.0
            out[3 * column + 1] = 0.0
            out[3 * column + 2] = -1.0
        return
    m = advance(frame.X_camera_mesh, 16 * instance_index)
    first_index = 3 * (primitive_id - instance.first_primitive)
    p, b, n = _corner_array(), _inverse_array(), _normal_array()
    _load_corners(m, instance.mesh_positions, instance.mesh_indices, first_index, p)
    flat = _geometric_normal(b, _invert(p, b))
    is_smooth = instance.mesh_normals != 0
    if is_smooth:
        _load_normals(m, f32_at(instance.mesh_normals), instance.mesh_indices, first_index, n)
    ray_y = (row + 0.5 - frame.cy) / frame.fy
    for column in range(start, stop):
        normal = flat
        if is_smooth:
            normal = _smooth_normal(b, n, (column + 0.5 - frame.cx) / frame.fx, ray_y, flat)
        for axis in range(3):
            out[3 * column + axis] = normal[axis]


@kernel("void(int64, int64, int64, int64)")
def resolve_normals(frame_address, layer_address, first_row, end_row):
    """Write the normals of some rows, by spans of pixels that see one primitive.

    Few images have normals. A separate kernel, since it is compiled only after the server is ready.
    """
    frame, layer = frame_at(frame_address), _layer_at(layer_address)
    width = frame.width
    instance = np.int64(0)
    for row in range(first_row, end_row):
        ids = advance(layer.ids, (row - layer.first_row) * frame.stride)
        start = 0
        while start < width:
            primitive_id = np.int64(ids[start])
            stop = start + 1
            while stop < width and ids[stop] == primitive_id:
                stop += 1
            if primitive_id >= 0:
                instance = instance_of(frame.first_ids, frame.instance_count, primitive_id, instance)
                _resolve_normal_span(frame, instance, primitive_id, row, start, stop)
            else:
                normals = advance(f32_at(frame.normal), 3 * row * width)
                for value in range(3 * start, 3 * stop):
                    normals[value] = 0.0
            start = stop


# Cache of two instances, since pixels at an edge alternate between two: first primitive id, the one after the last,
# label and instance id of each; then the index of the one looked up last.
_FIRST_ID: Final = 0
_END_ID: Final = 1
_LABEL: Final = 2
_INSTANCE_ID: Final = 3
_SECOND: Final = 4
_INDEX: Final = 8
_BACKGROUND: Final = (-1, 0, int(np.uint32(LABEL_NONE).astype(np.int32)), -1)


@device_function
def _look_up_block(frame, ids, column, cache, block):
    """Write labels and instance ids of eight pixels to ``block`` and update the ``cache``."""
    first_ids = frame.first_ids
    block_ids = vec.load(ids, column)
    labels = instance_ids = vec.i32(0)
    missing = 255
    while missing != 0:
        primitive_id = np.int64(ids[column + vec.lowest_bit(missing)])
        for k in range(_SECOND):
            cache[k], cache[_SECOND + k] = cache[_SECOND + k], cache[k]
        if primitive_id < cache[_FIRST_ID] or primitive_id >= cache[_END_ID]:
            if primitive_id < 0:
                cache[_FIRST_ID], cache[_END_ID], cache[_LABEL], cache[_INSTANCE_ID] = _BACKGROUND
            else:
                index = instance_of(first_ids, frame.instance_count, primitive_id, cache[_INDEX])
                cache[_INDEX] = index
                cache[_FIRST_ID], cache[_END_ID] = first_ids[index], first_ids[index + 1]
                cache[_LABEL] = frame.labels[index]
                cache[_INSTANCE_ID] = frame.instance_ids[index]
        same = (block_ids >= vec.i32(cache[_FIRST_ID])) & (block_ids < vec.i32(cache[_END_ID]))
        labels = vec.select(same, vec.i32(cache[_LABEL]), labels)
        instance_ids = vec.select(same, vec.i32(cache[_INSTANCE_ID]), instance_ids)
        missing &= ~vec.movemask(same)
    vec.store(block, 0, labels)
    vec.store(block, vec.LANES, instance_ids)


_PREFETCH_DISTANCE: Final = 1024
"""Pixels from the one that is written to the one that is prefetched."""


@device_function
def _resolve_depth_row(inv_z, ids, out, width):
    """Write the depth of one row. Labels are written later, since consecutive stores to a cache line are combined."""
    one, no_depth, zero = vec.f32(1.0), vec.f32(np.inf), vec.i32(0)
    whole = width - width % vec.LANES
    for column in range(0, whole, vec.LANES):
        vec.prefetch(out, column + _PREFETCH_DISTANCE)
        visible = vec.load(ids, column) >= zero
        vec.store(out, column, vec.select(visible, one / vec.load(inv_z, column), no_depth))
    for column in range(whole, width):
        out[column] = np.float32(1.0) / inv_z[column] if ids[column] >= 0 else np.float32(np.inf)


@device_function
def _resolve_label_row(frame, ids, labels, instance_ids, cache, block):
    """Write label and instance id of one row, eight pixels at once where they see one instance or nothing.

    Args:
        ids: pointer to the row's primitive ids, whole vectors of them.
        labels, instance_ids: pointers to the row's outputs; only what the frame wants is written.
        cache: nine int64, as the previous row left them; see _FIRST_ID.
        block: 2 x 8 int32 of scratch.
    """
    width = frame.width
    has_label, has_instance = frame.label != 0, frame.instance != 0
    first_id, end_id = vec.i32(cache[_FIRST_ID]), vec.i32(cache[_END_ID])
    label, instance_id = vec.i32(cache[_LABEL]), vec.i32(cache[_INSTANCE_ID])
    whole = width - width % vec.LANES
    for column in range(0, whole, vec.LANES):
        block_ids = vec.load(ids, column)
        if vec.movemask((block_ids >= first_id) & (block_ids < end_id)) == 255:
            if has_label:
                vec.prefetch(labels, column + _PREFETCH_DISTANCE)
                vec.store(labels, column, label)
            if has_instance:
                vec.store(instance_ids, column, instance_id)
        else:
            _look_up_block(frame, ids, column, cache, block)
            if has_label:
                vec.store(labels, column, vec.load(block, 0))
            if has_instance:
                vec.store(instance_ids, column, vec.load(block, vec.LANES))
            first_id, end_id = vec.i32(cache[_FIRST_ID]), vec.i32(cache[_END_ID])
            label, instance_id = vec.i32(cache[_LABEL]), vec.i32(cache[_INSTANCE_ID])
    if whole < width:
        _look_up_block(frame, ids, whole, cache, block)
        for k in range(width - whole):
            if has_label:
                labels[whole + k] = block[k]
            if has_instance:
                instance_ids[whole + k] = block[vec.LANES + k]


@device_function
def _resolve_rows(frame, layer, first_row, end_row):
    """Write the wanted outputs of some rows."""
    width = frame.width
    stride = frame.stride
    cache, block = _instance_cache_array(), _block_array()
    for k in range(9):
        cache[k] = 0
    for row in range(first_row, end_row):
        layer_pixel, pixel = (row - layer.first_row) * stride, row * width
        ids, inv_z = advance(layer.ids, layer_pixel), advance(layer.inv_z, layer_pixel)
        if frame.unpadded_ids != 0:
            unpadded_ids = advance(i32_at(frame.unpadded_ids), pixel)
            unpadded_inv_z = advance(f32_at(frame.unpadded_inv_z), pixel)
            for column in range(width):
                unpadded_ids[column] = ids[column]
                unpadded_inv_z[column] = inv_z[column]
        if frame.depth != 0:
            _resolve_depth_row(inv_z, ids, advance(f32_at(frame.depth), pixel), width)
        if frame.label != 0 or frame.instance != 0:
            labels, instance_ids = advance(i32_at(frame.label), pixel), advance(i32_at(frame.instance), pixel)
            _resolve_label_row(frame, ids, labels, instance_ids, cache, block)
    if frame.normal != 0:
        call_kernel(frame.normals_kernel, (address(frame), address(layer), first_row, end_row))


@kernel("void(int64, int64, int64, int64, int64)")
def resolve_layer(frame_address, ids_address, inv_z_address, first_row, end_row):
    """Write the wanted outputs of some rows from a finished layer.

    Args:
        ids_address, inv_z_address: addresses of (H, stride) int32 and float32.
    """
    layer = _new_layer()
    layer.ids, layer.inv_z, layer.first_row = i32_at(ids_address), f32_at(inv_z_address), 0
    _resolve_rows(frame_at(frame_address), layer, first_row, end_row)


ALL_FACES: Final = 0
FRONT_FACES: Final = 1
"""Without the back faces that are kept; nothing is resolved."""
BACK_FACES: Final = 2
"""Those that are kept, on top of the layer that FRONT_FACES has left; then resolve."""


@kernel("void(int64, int64, int64, int64, int64)")
def draw_band(frame_address, first_row, end_row, band_memory, faces):
    """Rasterize and resolve a band of the image, or a part of one, while it is in the cache.

    Args:
        first_row, end_row: rows of the image, all of one band.
        band_memory: address of the layer of these rows: BAND_ROWS x stride int32 and as many float32; 0: the frame has
            a layer of the whole image.
        faces: ALL_FACES, FRONT_FACES or BACK_FACES.
    """
    frame = frame_at(frame_address)
    layer = _new_layer()
    if band_memory == 0:
        layer.ids, layer.inv_z, layer.first_row = i32_at(frame.layer_ids), f32_at(frame.layer_inv_z), 0
    else:
        layer.ids, layer.first_row = i32_at(band_memory), first_row
        layer.inv_z = advance(f32_at(band_memory), BAND_ROWS * frame.stride)
    if faces != BACK_FACES:
        clear_rows(frame, layer, first_row, end_row)
    draw_rows(frame, layer, first_row, end_row, faces == BACK_FACES)
    if faces != FRONT_FACES:
        _resolve_rows(frame, layer, first_row, end_row)
