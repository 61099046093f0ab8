"""Vertices to pixels."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.cpu.layout import (
    B_COLUMNS,
    B_HALF,
    B_MIDDLE,
    GUARD,
    J_INSTANCES,
    J_LENGTHS,
    J_TABLE,
    J_VERTEX,
    L_CX,
    L_CY,
    L_FX,
    L_FY,
    L_NEAR,
    M_COLUMNS,
    M_SIZE,
    T_COLUMNS,
    T_CULL,
    T_HIDDEN,
    T_POSITIONS,
    T_VERTEX,
)
from renderers.jit import kernel
from renderers.linked import inner
from renderers.pointers import f32_at, f64_at, i64_at, u8_at

BEHIND: Final = -2.0
"""In place of 1/z: the vertex is nearer than the near plane (or not a number)."""
OUTSIDE: Final = -1.0
"""In place of 1/z: the vertex is outside the guard band."""


@inner
def drawn_at(table, count, column, value):
    """The last of ``count`` rows of a table of T_COLUMNS whose ``column`` is <= value."""
    low = 0
    high = count
    while high - low > 1:
        middle = (low + high) >> 1
        if table[middle * T_COLUMNS + column] <= value:
            low = middle
        else:
            high = middle
    return low


@inner
def _transform(matrix, positions, count, lens, out):
    """``count`` vertices, eight at a time; the last few one by one with the same arithmetic."""
    fx, fy, cx, cy, near = lens[L_FX], lens[L_FY], lens[L_CX], lens[L_CY], lens[L_NEAR]
    m00, m01, m02, m03 = matrix[0], matrix[1], matrix[2], matrix[3]
    m10, m11, m12, m13 = matrix[4], matrix[5], matrix[6], matrix[7]
    m20, m21, m22, m23 = matrix[8], matrix[9], matrix[10], matrix[11]
    guard, one = vec.f64(GUARD), vec.f64(1.0)
    whole = count - count % vec.LANES
    for k in range(0, whole, vec.LANES):
        px = vec.to_f64(vec.load_third(positions, 3 * k, 0))
        py = vec.to_f64(vec.load_third(positions, 3 * k, 1))
        pz = vec.to_f64(vec.load_third(positions, 3 * k, 2))
        z = vec.f64(m20) * px + vec.f64(m21) * py + vec.f64(m22) * pz + vec.f64(m23)
        in_front = z >= vec.f64(near)
        w = vec.select(in_front, one / z, one)
        x = vec.f64(fx) * (vec.f64(m00) * px + vec.f64(m01) * py + vec.f64(m02) * pz + vec.f64(m03)) * w + vec.f64(cx)
        y = vec.f64(fy) * (vec.f64(m10) * px + vec.f64(m11) * py + vec.f64(m12) * pz + vec.f64(m13)) * w + vec.f64(cy)
        inside = (vec.absolute(x) <= guard) & (vec.absolute(y) <= guard)
        w = vec.select(inside, w, vec.f64(OUTSIDE))
        w = vec.select(in_front, w, vec.f64(BEHIND))
        vec.store_vertices(out, 4 * k, vec.to_f32(x), vec.to_f32(y), vec.to_f32(w))
    for k in range(whole, count):
        sx = np.float64(positions[3 * k])
        sy = np.float64(positions[3 * k + 1])
        sz = np.float64(positions[3 * k + 2])
        depth = m20 * sx + m21 * sy + m22 * sz + m23
        inverse = 1.0 / depth if depth >= near else 1.0
        column = fx * (m00 * sx + m01 * sy + m02 * sz + m03) * inverse + cx
        row = fy * (m10 * sx + m11 * sy + m12 * sz + m13) * inverse + cy
        reached = abs(column) <= GUARD and abs(row) <= GUARD
        inverse = inverse if reached else OUTSIDE
        out[4 * k] = column
        out[4 * k + 1] = row
        out[4 * k + 2] = inverse if depth >= near else BEHIND


@inner
def _outside(m, box, lens):
    """Whether all of a box lies beyond the near plane and within the guard band, so that nothing in it is clipped."""
    far_x, far_y, z = abs(m[3]), abs(m[7]), m[11]
    size = abs(m[11])
    for axis in range(3):
        middle, half = box[B_MIDDLE + axis], box[B_HALF + axis]
        far_x += abs(m[axis]) * (abs(middle) + half)
        far_y += abs(m[4 + axis]) * (abs(middle) + half)
        z += m[8 + axis] * middle - abs(m[8 + axis]) * half
        size += abs(m[8 + axis]) * (abs(middle) + half)
    z -= 1e-9 * size  # what rounding may add up to
    most = GUARD - 1.0
    return (
        box[B_HALF] >= 0.0
        and z > lens[L_NEAR]
        and lens[L_FX] * far_x <= (most - abs(lens[L_CX])) * z
        and lens[L_FY] * far_y <= (most - abs(lens[L_CY])) * z
    )


@kernel("void(int64, int64, int64, int64, int64, int64, int64, int64)")
def place(points_at, sizes_at, cull_at, bounds_at, lens_at, table_at, lengths_at, count):
    """What a frame's tables say of the drawn instances' poses.

    Args:
        points_at, sizes_at: addresses of (count, 4, 4) float64, camera from mesh, and of (count,) float64.
        cull_at: address of (count,) bool, whose back faces are culled; 0: nobody's.
        bounds_at: address of (count, B_COLUMNS) float64; 0: nothing may be said of what is hidden.
        lens_at: address of L_COLUMNS float64.
        table_at, lengths_at: addresses of count + 1 rows, of which T_CULL and T_HIDDEN, and of M_COLUMNS float64, which
            are filled. T_CULL of the last row: how many have back faces that are culled and not hidden.
    """
    lens = f64_at(lens_at)
    apart = 0
    points, sizes, cull = f64_at(points_at), f64_at(sizes_at), u8_at(cull_at)
    table, lengths = i64_at(table_at), f64_at(lengths_at)
    for k in range(count):
        m, out = 16 * k, M_COLUMNS * k
        for value in range(M_SIZE):
            lengths[out + value] = points[m + value]
        lengths[out + M_SIZE] = sizes[k]
        side = hidden = 0
        culled = cull_at != 0 and cull[k] != 0
        solid = bounds_at != 0 and _outside(f64_at(points_at + 128 * k), f64_at(bounds_at + 8 * B_COLUMNS * k), lens)
        if culled or solid:
            # In the optical frame a triangle that faces the camera runs counter-clockwise for the viewer, which is a
            # negative area with y down; a mirrored map turns that round.
            determinant = (
                points[m] * (points[m + 5] * points[m + 10] - points[m + 6] * points[m + 9])
                + points[m + 1] * (points[m + 6] * points[m + 8] - points[m + 4] * points[m + 10])
                + points[m + 2] * (points[m + 4] * points[m + 9] - points[m + 5] * points[m + 8])
            )
            side = -1 if determinant < 0.0 else 1
            hidden = side if solid and determinant != 0.0 else 0
            side = side if culled else 0
            apart += side != 0 and hidden == 0
        table[T_COLUMNS * k + T_CULL] = side
        table[T_COLUMNS * k + T_HIDDEN] = hidden
    table[T_COLUMNS * count + T_CULL] = apart


@kernel("void(int64, int64, int64, int64)")
def transform(job_at, lens_at, begin, end):
    """Pixel coordinates and 1/z of the vertices ``begin .. end`` of the drawn instances, in the job's arrays.

    Args:
        job_at, lens_at: addresses of the J_COLUMNS int64 and the L_COLUMNS float64.
    """
    job = i64_at(job_at)
    lens = f64_at(lens_at)
    table = i64_at(job[J_TABLE])
    drawn = drawn_at(table, job[J_INSTANCES], T_VERTEX, begin)
    while begin < end:
        row = drawn * T_COLUMNS
        stop = min(end, table[row + T_COLUMNS + T_VERTEX])
        offset = begin - table[row + T_VERTEX]
        _transform(
            f64_at(job[J_LENGTHS] + 8 * M_COLUMNS * drawn),
            f32_at(table[row + T_POSITIONS] + 12 * offset),
            stop - begin,
            lens,
            f32_at(job[J_VERTEX] + 16 * begin),
        )
        begin = max(begin, stop)
        drawn += 1
