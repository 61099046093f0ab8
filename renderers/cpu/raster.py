"""Records to pixels: exact coverage by fixed-point edges and the top-left rule, nearest 1/z wins.

A pixel is covered when its centre is inside all edges, or on a left edge or a horizontal top edge. An edge's crossing
with a row of centres is a quotient of integers below 2^50 and 2^33; two of them that differ, differ by at least 2^-33
at a magnitude below 2^17, so that the float64 quotient has the exact ceiling. Spans are half-open: of two triangles
with a common edge exactly one covers each pixel centre.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from renderers.cpu.clip import MAX_VERTICES, clip_triangle
from renderers.cpu.layout import (
    CHUNK,
    HALF,
    J_BANDS,
    J_BEFORE_IDS,
    J_BEFORE_INV_Z,
    J_BEYOND_IDS,
    J_BEYOND_INV_Z,
    J_CHUNKS,
    J_HEIGHT,
    J_IDS,
    J_INV_Z,
    J_OFFSETS,
    J_RECORDS,
    J_SMALL,
    J_TABLE,
    J_TALL,
    J_WIDTH,
    KIND_CLIPPED,
    KIND_LINE,
    KIND_TRIANGLE,
    L_FAR,
    R_BASE,
    R_DX,
    R_DY,
    R_HIGH,
    R_ID,
    R_KIND,
    R_LOW,
    R_XY,
    RECORD_BYTES,
    SMALL_BANDS,
    SUBPIXEL,
    T_COLUMNS,
    T_RECORD,
)
from renderers.cpu.memory import f32_at, f64_at, i32_at, i64_at, u16_at
from renderers.cpu.setup import first_centre
from renderers.cpu.visibility import BAND_ROWS


@njit(nogil=True, error_model="numpy")
def _span(job, record, row, start, stop, box_x, box_y):  # type: ignore[no-untyped-def]
    """Draw the pixels ``start .. stop`` of a row; ``box_x, box_y`` is the pixel that R_BASE belongs to."""
    plane = f64_at(record)
    bounds = f32_at(record)
    slope = plane[R_DX]
    base = plane[R_BASE] + plane[R_DY] * np.float64(row - box_y)
    low, high = bounds[R_LOW], bounds[R_HIGH]
    identity = i32_at(record)[R_ID]
    ids = i32_at(job[J_IDS])
    depths = f32_at(job[J_INV_Z])
    begin = row * job[J_WIDTH]
    if job[J_BEYOND_IDS] == 0 and job[J_BEFORE_IDS] == 0:
        for column in range(start, stop):
            w = min(max(np.float32(base + slope * np.float64(column - box_x)), low), high)
            if w > depths[begin + column]:
                depths[begin + column] = w
                ids[begin + column] = identity
        return
    for column in range(start, stop):
        w = min(max(np.float32(base + slope * np.float64(column - box_x)), low), high)
        pixel = begin + column
        accepted = w > depths[pixel]
        if job[J_BEYOND_IDS] != 0:
            limit = f32_at(job[J_BEYOND_INV_Z])[pixel]
            other = i32_at(job[J_BEYOND_IDS])[pixel]
            accepted = accepted and other >= 0 and (w < limit or (w == limit and identity > other))
        if job[J_BEFORE_IDS] != 0:
            limit = f32_at(job[J_BEFORE_INV_Z])[pixel]
            other = i32_at(job[J_BEFORE_IDS])[pixel]
            accepted = accepted and (other < 0 or w > limit or (w == limit and identity < other))
        if accepted:
            depths[pixel] = w
            ids[pixel] = identity


@njit(nogil=True, error_model="numpy")
def _crossing(xa, ya, xb, yb, y):  # type: ignore[no-untyped-def]
    """The first pixel column whose centre is at or right of the (not horizontal) edge in the row of centres ``y``."""
    dy = yb - ya
    numerator = (xb - xa) * (y - ya) + (xa - HALF) * dy
    return np.int64(np.ceil(np.float64(numerator) / np.float64(dy * SUBPIXEL)))


@njit(nogil=True, error_model="numpy")
def _corners(job, record, x0, y0, x1, y1, x2, y2, first_row, last_row, box_x, box_y):  # type: ignore[no-untyped-def]
    """Draw the rows ``first_row .. last_row`` of a triangle in grid units, whichever way it winds."""
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0:
        return
    if area < 0:
        x1, x2, y1, y2 = x2, x1, y2, y1
    width = job[J_WIDTH]
    top = max(first_centre(min(y0, y1, y2)), first_row)
    bottom = min(first_centre(max(y0, y1, y2)), last_row)
    left = max(first_centre(min(x0, x1, x2)), 0)
    right = min(first_centre(max(x0, x1, x2)), width)
    for row in range(top, bottom):
        y = row * SUBPIXEL + HALF
        start, stop = left, right
        # With this winding (y down) edges that run upwards are left ones.
        if y1 < y0:
            start = max(start, _crossing(x0, y0, x1, y1, y))
        elif y1 > y0:
            stop = min(stop, _crossing(x0, y0, x1, y1, y))
        if y2 < y1:
            start = max(start, _crossing(x1, y1, x2, y2, y))
        elif y2 > y1:
            stop = min(stop, _crossing(x1, y1, x2, y2, y))
        if y0 < y2:
            start = max(start, _crossing(x2, y2, x0, y0, y))
        elif y0 > y2:
            stop = min(stop, _crossing(x2, y2, x0, y0, y))
        if start < stop:
            _span(job, record, row, start, stop, box_x, box_y)


@njit(nogil=True, error_model="numpy")
def _draw(job, lens, record, first_row, last_row):  # type: ignore[no-untyped-def]
    """Draw the part of a record that lies in the rows ``first_row .. last_row``."""
    whole = i32_at(record)
    kind = whole[R_KIND]
    a, b = np.int64(whole[R_XY]), np.int64(whole[R_XY + 1])
    c, d = np.int64(whole[R_XY + 2]), np.int64(whole[R_XY + 3])
    e, f = np.int64(whole[R_XY + 4]), np.int64(whole[R_XY + 5])
    if kind == KIND_TRIANGLE:
        box_x, box_y = first_centre(min(a, c, e)), first_centre(min(b, d, f))
        _corners(job, record, a, b, c, d, e, f, first_row, last_row, box_x, box_y)
    elif kind == KIND_LINE:
        box_x, box_y = f & 0xFFFF, f >> 16
        # As GL's aliased lines: widened along the minor axis, so that a width of 1 is one pixel per step.
        ox, oy = (0, e) if abs(c - a) >= abs(d - b) else (e, 0)
        _corners(job, record, a - ox, b - oy, c - ox, d - oy, c + ox, d + oy, first_row, last_row, box_x, box_y)
        _corners(job, record, a - ox, b - oy, c + ox, d + oy, a + ox, b + oy, first_row, last_row, box_x, box_y)
    elif kind == KIND_CLIPPED:
        corners = np.empty((3, 3), np.float64)
        grid = np.empty((MAX_VERTICES, 2), np.int64)
        element = np.int64(whole[R_ID]) - i64_at(job[J_TABLE])[c * T_COLUMNS + T_RECORD]
        count = clip_triangle(job, lens, c, element, corners, grid)
        for k in range(2, count):
            _corners(
                job,
                record,
                grid[0, 0],
                grid[0, 1],
                grid[k - 1, 0],
                grid[k - 1, 1],
                grid[k, 0],
                grid[k, 1],
                first_row,
                last_row,
                a,
                b,
            )
    else:
        for row in range(max(b, first_row), min(d, last_row)):
            _span(job, record, row, a, c, a, b)


@njit(nogil=True, error_model="numpy")
def raster_band(job, lens, band):  # type: ignore[no-untyped-def]
    """Clear the band and draw all that touches it, in the order of record numbers."""
    first_row = band * BAND_ROWS
    last_row = min(first_row + BAND_ROWS, job[J_HEIGHT])
    width = job[J_WIDTH]
    ids = i32_at(job[J_IDS])
    depths = f32_at(job[J_INV_Z])
    # Nothing at or beyond this 1/z is accepted: the far plane costs no test of its own.
    empty = np.nextafter(np.float32(1.0 / lens[L_FAR]), np.float32(-1.0))
    for pixel in range(first_row * width, last_row * width):
        ids[pixel] = -1
        depths[pixel] = empty
    bands = job[J_BANDS]
    for chunk in range(job[J_CHUNKS]):
        offsets = i32_at(job[J_OFFSETS] + 4 * chunk * (bands + 2))
        k, end = offsets[band], offsets[band + 1]
        t, talls = 0, offsets[bands + 1]
        if k == end and talls == 0:
            continue
        small = u16_at(job[J_SMALL] + 2 * chunk * CHUNK * SMALL_BANDS)
        tall = u16_at(job[J_TALL] + 2 * chunk * CHUNK)
        records = job[J_RECORDS] + chunk * CHUNK * RECORD_BYTES
        while k < end or t < talls:
            if t >= talls or (k < end and small[k] < tall[t]):
                index = np.int64(small[k])
                k += 1
            else:
                index = np.int64(tall[t])
                t += 1
            _draw(job, lens, records + index * RECORD_BYTES, first_row, last_row)
