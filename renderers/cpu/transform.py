"""Vertices to pixels."""

from __future__ import annotations

import numpy as np
from numba import njit

from renderers.cpu.jit import kernel
from renderers.cpu.layout import (
    GUARD,
    J_INSTANCES,
    J_LENGTHS,
    J_TABLE,
    J_W,
    J_X,
    J_Y,
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
from renderers.cpu.memory import f32_at, f64_at, i64_at

BEHIND = -2.0
"""In place of 1/z: the vertex is nearer than the near plane (or not a number)."""
OUTSIDE = -1.0
"""In place of 1/z: the vertex is outside the guard band."""


@njit(nogil=True, error_model="numpy")
def drawn_at(table, count, column, value):  # type: ignore[no-untyped-def]
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


@njit(nogil=True, error_model="numpy")
def _transform(matrix, positions, count, fx, fy, cx, cy, near, out_x, out_y, out_w, first):  # type: ignore[no-untyped-def]
    m00, m01, m02, m03 = matrix[0], matrix[1], matrix[2], matrix[3]
    m10, m11, m12, m13 = matrix[4], matrix[5], matrix[6], matrix[7]
    m20, m21, m22, m23 = matrix[8], matrix[9], matrix[10], matrix[11]
    for k in range(count):
        px = np.float64(positions[3 * k])
        py = np.float64(positions[3 * k + 1])
        pz = np.float64(positions[3 * k + 2])
        z = m20 * px + m21 * py + m22 * pz + m23
        w = 1.0 / z if z >= near else 1.0
        x = fx * (m00 * px + m01 * py + m02 * pz + m03) * w + cx
        y = fy * (m10 * px + m11 * py + m12 * pz + m13) * w + cy
        inside = abs(x) <= GUARD and abs(y) <= GUARD
        w = w if inside else OUTSIDE
        out_x[first + k] = x
        out_y[first + k] = y
        out_w[first + k] = w if z >= near else BEHIND


@kernel("void(int64[::1], float64[::1], int64, int64)")
def transform(job, lens, begin, end):  # type: ignore[no-untyped-def]
    """Pixel coordinates and 1/z of the vertices ``begin .. end`` of the drawn instances, in the job's arrays."""
    table = i64_at(job[J_TABLE])
    out_x = f32_at(job[J_X])
    out_y = f32_at(job[J_Y])
    out_w = f32_at(job[J_W])
    drawn = drawn_at(table, job[J_INSTANCES], T_VERTEX, begin)
    while begin < end:
        row = drawn * T_COLUMNS
        stop = min(end, table[row + T_COLUMNS + T_VERTEX])
        offset = begin - table[row + T_VERTEX]
        _transform(
            f64_at(job[J_LENGTHS] + 8 * M_COLUMNS * drawn),
            f32_at(table[row + T_POSITIONS] + 12 * offset),
            stop - begin,
            lens[L_FX],
            lens[L_FY],
            lens[L_CX],
            lens[L_CY],
            lens[L_NEAR],
            out_x,
            out_y,
            out_w,
            begin,
        )
        begin = max(begin, stop)
        drawn += 1
