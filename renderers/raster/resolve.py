"""Visible records to pictures: depth, label, instance and normal."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inner
from renderers.compiler.jit import kernel
from renderers.compiler.pointers import f32_at, f64_at, i32_at, i64_at, u32_at
from renderers.drawlist import LABEL_NONE
from renderers.primitive_ids import instance_of
from renderers.raster.coverage import clear_rows, raster_band
from renderers.raster.layout import (
    A_COLUMNS,
    A_ELEMENTS,
    A_NORMALS,
    A_POSITIONS,
    A_TOPOLOGY,
    J_ALL_IDS,
    J_ALL_INSTANCES,
    J_ALL_LABELS,
    J_ALL_MESHES,
    J_ALL_X,
    J_COLUMNS,
    J_DEPTH,
    J_FIRST_RECORD,
    J_IDS,
    J_INSTANCE,
    J_INV_Z,
    J_LABEL,
    J_NORMAL,
    J_PLAIN_IDS,
    J_PLAIN_INV_Z,
    J_STRIDE,
    J_WIDTH,
    L_CX,
    L_CY,
    L_FX,
    L_FY,
)
from renderers.visibility_buffer import BAND_ROWS


@inner
def _normal_run(job, lens, instance, record, row, start, stop):
    """Normals of the pixels ``start .. stop`` of a row, which all see one record."""
    out = f32_at(job[J_NORMAL] + 12 * row * job[J_WIDTH])
    mesh = i64_at(job[J_ALL_MESHES] + 8 * A_COLUMNS * instance)
    if mesh[A_TOPOLOGY] != 3:
        for column in range(start, stop):
            out[3 * column] = 0.0
            out[3 * column + 1] = 0.0
            out[3 * column + 2] = -1.0
        return
    m = f64_at(job[J_ALL_X] + 8 * 16 * instance)
    element = record - i64_at(job[J_FIRST_RECORD])[instance]
    indices = u32_at(mesh[A_ELEMENTS] + 12 * element)
    positions = f32_at(mesh[A_POSITIONS])
    p = np.empty((3, 3), np.float64)
    for k in range(3):
        v = 3 * np.int64(indices[k])
        x, y, z = np.float64(positions[v]), np.float64(positions[v + 1]), np.float64(positions[v + 2])
        for axis in range(3):
            p[k, axis] = m[4 * axis] * x + m[4 * axis + 1] * y + m[4 * axis + 2] * z + m[4 * axis + 3]
    # Rows of the inverse of [p0 p1 p2], up to the determinant: cross products of the columns.
    b = np.empty((3, 3), np.float64)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        b[k, 0] = p[i, 1] * p[j, 2] - p[i, 2] * p[j, 1]
        b[k, 1] = p[i, 2] * p[j, 0] - p[i, 0] * p[j, 2]
        b[k, 2] = p[i, 0] * p[j, 1] - p[i, 1] * p[j, 0]
    # Their sum is (p1 - p0) x (p2 - p0).
    gx, gy, gz = b[0, 0] + b[1, 0] + b[2, 0], b[0, 1] + b[1, 1] + b[2, 1], b[0, 2] + b[1, 2] + b[2, 2]
    determinant = b[0, 0] * p[0, 0] + b[0, 1] * p[0, 1] + b[0, 2] * p[0, 2]
    length = np.sqrt(gx * gx + gy * gy + gz * gz)
    if length > 0.0:
        scale = 1.0 / length if determinant <= 0.0 else -1.0 / length
        gx, gy, gz = gx * scale, gy * scale, gz * scale
    else:
        gx, gy, gz = 0.0, 0.0, -1.0
    n = np.empty((3, 3), np.float64)
    smooth = mesh[A_NORMALS] != 0
    if smooth:
        normals = f32_at(mesh[A_NORMALS])
        for k in range(3):
            v = 3 * np.int64(indices[k])
            x, y, z = np.float64(normals[v]), np.float64(normals[v + 1]), np.float64(normals[v + 2])
            # Normals go by the cofactors, the inverse transpose up to a factor.
            for axis in range(3):
                i, j = (axis + 1) % 3, (axis + 2) % 3
                cx = m[4 * i + 1] * m[4 * j + 2] - m[4 * i + 2] * m[4 * j + 1]
                cy = m[4 * i + 2] * m[4 * j] - m[4 * i] * m[4 * j + 2]
                cz = m[4 * i] * m[4 * j + 1] - m[4 * i + 1] * m[4 * j]
                n[k, axis] = cx * x + cy * y + cz * z
    ray_y = (row + 0.5 - lens[L_CY]) / lens[L_FY]
    for column in range(start, stop):
        ray_x = (column + 0.5 - lens[L_CX]) / lens[L_FX]
        nx, ny, nz = gx, gy, gz
        if smooth:
            b0 = b[0, 0] * ray_x + b[0, 1] * ray_y + b[0, 2]
            b1 = b[1, 0] * ray_x + b[1, 1] * ray_y + b[1, 2]
            b2 = b[2, 0] * ray_x + b[2, 1] * ray_y + b[2, 2]
            sx = b0 * n[0, 0] + b1 * n[1, 0] + b2 * n[2, 0]
            sy = b0 * n[0, 1] + b1 * n[1, 1] + b2 * n[2, 1]
            sz = b0 * n[0, 2] + b1 * n[1, 2] + b2 * n[2, 2]
            length = np.sqrt(sx * sx + sy * sy + sz * sz)
            if length > 0.0 and length < np.inf:
                # To the side of the surface that is seen; b and n may both have the sign of a mirrored frame.
                scale = 1.0 / length if sx * gx + sy * gy + sz * gz >= 0.0 else -1.0 / length
                nx, ny, nz = sx * scale, sy * scale, sz * scale
        out[3 * column] = nx
        out[3 * column + 1] = ny
        out[3 * column + 2] = nz


# What of a row's names is kept from one block to the next: the last two instances seen, since at an edge pixels go to
# and fro between two; each its records' first and end, label and identity. Then a block's labels and identities.
N_FIRST: Final = 0
N_END: Final = 1
N_LABEL: Final = 2
N_IDENTITY: Final = 3
N_OTHER: Final = 4
N_INSTANCE: Final = 8
N_COLUMNS: Final = 9
_NOBODY: Final = (-1, 0, int(np.uint32(LABEL_NONE).astype(np.int32)), -1)


@inner
def _mixed_names(job, ids, column, seen, block):
    """Labels and identities of eight pixels, left in ``block``; ``seen`` is renewed."""
    first_record = i64_at(job[J_FIRST_RECORD])
    eight = vec.load(ids, column)
    names = numbers = vec.i32(0)
    missing = 255
    while missing != 0:
        record = np.int64(ids[column + vec.lowest_bit(missing)])
        for k in range(N_OTHER):
            seen[k], seen[N_OTHER + k] = seen[N_OTHER + k], seen[k]
        if record < seen[N_FIRST] or record >= seen[N_END]:
            if record < 0:
                seen[N_FIRST], seen[N_END], seen[N_LABEL], seen[N_IDENTITY] = _NOBODY
            else:
                instance = instance_of(first_record, job[J_ALL_INSTANCES], record, seen[N_INSTANCE])
                seen[N_INSTANCE] = instance
                seen[N_FIRST], seen[N_END] = first_record[instance], first_record[instance + 1]
                seen[N_LABEL] = i32_at(job[J_ALL_LABELS])[instance]
                seen[N_IDENTITY] = i32_at(job[J_ALL_IDS])[instance]
        same = (eight >= vec.i32(seen[N_FIRST])) & (eight < vec.i32(seen[N_END]))
        names = vec.select(same, vec.i32(seen[N_LABEL]), names)
        numbers = vec.select(same, vec.i32(seen[N_IDENTITY]), numbers)
        missing &= ~vec.bits(same)
    vec.store(block, 0, names)
    vec.store(block, vec.LANES, numbers)


_AHEAD: Final = 1024
"""Pixels of a picture that are on their way to the cache before they are written: pictures follow row upon row."""


@inner
def _depth_row(inverse, ids, out, width):
    """Depth of one row. Apart from its labels: stores that go on in one cache line are joined, others are not."""
    one, none, zero = vec.f32(1.0), vec.f32(np.inf), vec.i32(0)
    whole = width - width % vec.LANES
    for column in range(0, whole, vec.LANES):
        vec.prefetch(out, column + _AHEAD)
        seen = vec.load(ids, column) >= zero
        vec.store(out, column, vec.select(seen, one / vec.load(inverse, column), none))
    for column in range(whole, width):
        out[column] = np.float32(1.0) / inverse[column] if ids[column] >= 0 else np.float32(np.inf)


@inner
def _named_row(job, ids, width, labels, identities, seen, block):
    """Label and instance of one row, eight pixels at once where they see one instance (or nothing).

    Args:
        ids: pointer to the row's records, whole vectors of them.
        labels, identities: pointers to uint32 and int32; null: not wanted.
        seen: pointer to N_COLUMNS int64, as the row before left them. block: pointer to 2 x 8 int32 of scratch.
    """
    want_labels, want_identities = job[J_LABEL] != 0, job[J_INSTANCE] != 0
    first, end = vec.i32(seen[N_FIRST]), vec.i32(seen[N_END])
    name, number = vec.i32(seen[N_LABEL]), vec.i32(seen[N_IDENTITY])
    whole = width - width % vec.LANES
    for column in range(0, whole, vec.LANES):
        eight = vec.load(ids, column)
        if vec.bits((eight >= first) & (eight < end)) == 255:
            if want_labels:
                vec.prefetch(labels, column + _AHEAD)
                vec.store(labels, column, name)
            if want_identities:
                vec.store(identities, column, number)
        else:
            _mixed_names(job, ids, column, seen, block)
            if want_labels:
                vec.store(labels, column, vec.load(block, 0))
            if want_identities:
                vec.store(identities, column, vec.load(block, vec.LANES))
            first, end = vec.i32(seen[N_FIRST]), vec.i32(seen[N_END])
            name, number = vec.i32(seen[N_LABEL]), vec.i32(seen[N_IDENTITY])
    if whole < width:
        _mixed_names(job, ids, whole, seen, block)
        for k in range(width - whole):
            if want_labels:
                labels[whole + k] = block[k]
            if want_identities:
                identities[whole + k] = block[vec.LANES + k]


@inner
def _normal_row(job, lens, ids, row, width, instance):
    """Normals of one row, by runs of pixels that see one record; returns the new hint."""
    first_record = i64_at(job[J_FIRST_RECORD])
    start = 0
    while start < width:
        record = np.int64(ids[start])
        stop = start + 1
        while stop < width and ids[stop] == record:
            stop += 1
        if record >= 0:
            instance = instance_of(first_record, job[J_ALL_INSTANCES], record, instance)
            _normal_run(job, lens, instance, record, row, start, stop)
        else:
            normals = f32_at(job[J_NORMAL] + 12 * row * width)
            for column in range(3 * start, 3 * stop):
                normals[column] = 0.0
        start = stop
    return instance


@inner
def _resolve_rows(job, lens, first_row, last_row):
    """Fill the wanted outputs of some rows from their records."""
    width = job[J_WIDTH]
    stride = job[J_STRIDE]
    named = 0
    own_seen = np.zeros(N_COLUMNS, np.int64)
    own_block = np.empty(2 * vec.LANES, np.int32)
    seen, block = i64_at(np.int64(own_seen.ctypes.data)), i32_at(np.int64(own_block.ctypes.data))
    for row in range(first_row, last_row):
        ids = i32_at(job[J_IDS] + 4 * row * stride)
        inverse = f32_at(job[J_INV_Z] + 4 * row * stride)
        if job[J_PLAIN_IDS] != 0:
            plain_ids = i32_at(job[J_PLAIN_IDS] + 4 * row * width)
            plain_inverse = f32_at(job[J_PLAIN_INV_Z] + 4 * row * width)
            for column in range(width):
                plain_ids[column] = ids[column]
                plain_inverse[column] = inverse[column]
        if job[J_DEPTH] != 0:
            _depth_row(inverse, ids, f32_at(job[J_DEPTH] + 4 * row * width), width)
        if job[J_LABEL] != 0 or job[J_INSTANCE] != 0:
            labels = i32_at(job[J_LABEL] + 4 * row * width)
            identities = i32_at(job[J_INSTANCE] + 4 * row * width)
            _named_row(job, ids, width, labels, identities, seen, block)
        if job[J_NORMAL] != 0:
            named = _normal_row(job, lens, ids, row, width, named)
    own_seen[0] = own_block[0] = 0  # the pointers above do not keep the arrays alive


LAYER_GAP: Final = 1040
"""Values between a band's records and its depths: without it, or half of it, both would often lie a multiple of 4096
bytes apart, where loads of one wait for stores to the other."""
_LINE: Final = 16
"""Values of a cache line."""


def row_stride(width: int) -> int:
    """Values of a row of a band that nobody keeps: an odd number of cache lines. Rows of 640 or 1280 pixels would share
    an eighth or a sixteenth of the places that a processor's innermost cache has for them."""
    return (-(-width // _LINE) | 1) * _LINE


EVERYTHING: Final = 0
FRONTS: Final = 1
BACKS: Final = 2


@kernel("void(int64, int64, int64, int64, int64, int64)")
def draw_band(job_at, lens_at, row_begin, row_end, layer, part):
    """Raster and resolve a band of the picture, or a part of one, while it is in the cache.

    Args:
        row_begin, row_end: rows of the picture, all of one band.
        layer: address of a band's layer, BAND_ROWS x J_STRIDE int32, LAYER_GAP values and as many float32; 0: the layer
            is where the job says.
        part: EVERYTHING; FRONTS: without the back faces that are kept apart, and nothing is resolved; BACKS: these on
            top of what FRONTS has left in the layer, and resolve.
    """
    job = i64_at(job_at)
    lens = f64_at(lens_at)
    own_job = np.empty(J_COLUMNS, np.int64)
    if layer != 0:
        for k in range(J_COLUMNS):
            own_job[k] = job[k]
        # Kernels count pixels from the picture's first row.
        before = 4 * row_begin * job[J_STRIDE]
        own_job[J_IDS] = layer - before
        own_job[J_INV_Z] = layer + 4 * (BAND_ROWS * job[J_STRIDE] + LAYER_GAP) - before
        job = i64_at(np.int64(own_job.ctypes.data))
    if part != BACKS:
        clear_rows(job, lens, row_begin, row_end)
        raster_band(job, lens, row_begin, row_end, False)
    else:
        raster_band(job, lens, row_begin, row_end, True)
    if part != FRONTS:
        _resolve_rows(job, lens, row_begin, row_end)
    own_job[0] = 0  # the pointer above does not keep the array alive
