"""Vertices to pixels."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inner
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import f32_at, f64_at, i64_at
from renderers.raster.layout import (
    GUARD,
    J_INSTANCES,
    J_LENGTHS,
    J_STOP,
    J_TABLE,
    J_VERTEX,
    L_CX,
    L_CY,
    L_FX,
    L_FY,
    L_NEAR,
    M_COLUMNS,
    T_COLUMNS,
    T_POSITIONS,
    T_VERTEX,
)

PIECE: Final = 1 << 18
"""Vertices between two looks at J_STOP: about a millisecond."""
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
    while begin < end and not is_set(job[J_STOP]):
        row = drawn * T_COLUMNS
        last = table[row + T_COLUMNS + T_VERTEX]
        stop = min(end, last, begin + PIECE)
        offset = begin - table[row + T_VERTEX]
        _transform(
            f64_at(job[J_LENGTHS] + 8 * M_COLUMNS * drawn),
            f32_at(table[row + T_POSITIONS] + 12 * offset),
            stop - begin,
            lens,
            f32_at(job[J_VERTEX] + 16 * begin),
        )
        begin = max(begin, stop)
        drawn += begin >= last
