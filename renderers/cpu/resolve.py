"""Visible records to pictures: depth, label, instance and normal."""

from __future__ import annotations

import numpy as np
from numba import njit

from renderers.cpu.jit import kernel
from renderers.cpu.layout import (
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
    J_DEPTH,
    J_FIRST_RECORD,
    J_HEIGHT,
    J_IDS,
    J_INSTANCE,
    J_INV_Z,
    J_LABEL,
    J_NORMAL,
    J_WIDTH,
    L_CX,
    L_CY,
    L_FX,
    L_FY,
)
from renderers.cpu.memory import f32_at, f64_at, i32_at, i64_at, u32_at
from renderers.cpu.raster import raster_band
from renderers.cpu.visibility import BAND_ROWS
from renderers.drawlist import LABEL_NONE


@njit(nogil=True, error_model="numpy")
def _instance_of(first, count, record, hint):  # type: ignore[no-untyped-def]
    """``visibility.instance_of`` on a pointer."""
    if first[hint] <= record and record < first[hint + 1]:
        return hint
    low = 0
    high = count
    while high - low > 1:
        middle = (low + high) >> 1
        if first[middle] <= record:
            low = middle
        else:
            high = middle
    return low


@njit(nogil=True, error_model="numpy")
def _normal_run(job, lens, instance, record, row, start, stop):  # type: ignore[no-untyped-def]
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


@njit(nogil=True, error_model="numpy")
def _resolve_band(job, lens, band):  # type: ignore[no-untyped-def]
    """Fill the wanted outputs of a band from its records, one run of equal records after the other."""
    first_row = band * BAND_ROWS
    last_row = min(first_row + BAND_ROWS, job[J_HEIGHT])
    width = job[J_WIDTH]
    if job[J_DEPTH] != 0:
        all_ids = i32_at(job[J_IDS])
        inverse = f32_at(job[J_INV_Z])
        depth = f32_at(job[J_DEPTH])
        for pixel in range(first_row * width, last_row * width):
            z = np.float32(1.0) / inverse[pixel]
            depth[pixel] = z if all_ids[pixel] >= 0 else np.float32(np.inf)
    if job[J_LABEL] == 0 and job[J_INSTANCE] == 0 and job[J_NORMAL] == 0:
        return
    first_record = i64_at(job[J_FIRST_RECORD])
    instance = 0
    for row in range(first_row, last_row):
        ids = i32_at(job[J_IDS] + 4 * row * width)
        start = 0
        while start < width:
            record = np.int64(ids[start])
            stop = start + 1
            while stop < width and ids[stop] == record:
                stop += 1
            label = np.uint32(LABEL_NONE)
            identity = np.int32(-1)
            if record >= 0:
                instance = _instance_of(first_record, job[J_ALL_INSTANCES], record, instance)
                label = u32_at(job[J_ALL_LABELS])[instance]
                identity = i32_at(job[J_ALL_IDS])[instance]
            if job[J_LABEL] != 0:
                labels = u32_at(job[J_LABEL] + 4 * row * width)
                for column in range(start, stop):
                    labels[column] = label
            if job[J_INSTANCE] != 0:
                identities = i32_at(job[J_INSTANCE] + 4 * row * width)
                for column in range(start, stop):
                    identities[column] = identity
            if job[J_NORMAL] != 0:
                if record >= 0:
                    _normal_run(job, lens, instance, record, row, start, stop)
                else:
                    normals = f32_at(job[J_NORMAL] + 12 * row * width)
                    for column in range(3 * start, 3 * stop):
                        normals[column] = 0.0
            start = stop


@kernel("void(int64[::1], float64[::1], int64)")
def draw_band(job, lens, band):  # type: ignore[no-untyped-def]
    """Raster and resolve one band of the picture, while it is in the cache."""
    raster_band(job, lens, band)
    _resolve_band(job, lens, band)


@kernel("void(int64[::1], float64[::1], int64)")
def resolve_band(job, lens, band):  # type: ignore[no-untyped-def]
    """Resolve one band of a layer that was rasterized before."""
    _resolve_band(job, lens, band)
