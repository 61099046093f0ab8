"""Records to samples: as ``raster``, for the samples of a pixel at once.

A triangle is set up once. Its edges and its 1/z are linear, so that what they are at a sample is what they are at the
pixel's centre plus an offset that is the same in all pixels; what they are at least and at most in a pixel is what they
are at its centre plus the least and the greatest of these offsets.

Most pixels see one record with all their samples. Of those only the record's place is kept, and bounds of 1/z: eight
pixels at a time, a triangle that covers all samples and lies in front of all that was there takes the whole pixel, and
one that lies behind it is passed over. What is left are edges of triangles and surfaces that meet: there every sample
has its record and its 1/z, side by side, one to a lane. Bounds may be wider than what they bound: they decide only
what costs more to find out, never what is seen. Four samples take eight lanes, too, each of them two; small triangles
test two pixels at a time.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import as_i32, f32_at, f64_at, i32_at, i64_at
from renderers.raster.clip import MAX_VERTICES, clip_triangle
from renderers.raster.depth_sort import BUCKETS, count_records, front_to_back
from renderers.raster.layout import (
    HALF,
    J_FAR,
    J_IDS,
    J_MARGIN,
    J_NEAR,
    J_OWNERS,
    J_RECORDS,
    J_SAMPLE_IDS,
    J_SAMPLE_INV_Z,
    J_SAMPLES,
    J_SLOTS,
    J_STOP,
    J_STRIDE,
    J_TABLE,
    J_WIDTH,
    KIND_CLIPPED,
    KIND_LINE,
    KIND_SMALL,
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
    SUBPIXEL,
    T_COLUMNS,
    T_RECORD,
)
from renderers.raster.msaa.small_triangles import SCRATCH_VALUES, TAKEN, small_samples
from renderers.raster.msaa.storage import box_of, cover, put, reach_of, rising_at
from renderers.raster.primitive_setup import first_centre
from renderers.visibility_buffer import BAND_ROWS

_FAR_AWAY: Final = 1 << 30


@inlined
def _crossing(xa, ya, xb, yb, x, y):
    """i32x8: for every sample, the first column in which it is at or right of the edge; see ``raster``.

    Args:
        xa, ya, xb, yb: float64 integers, grid units; ya != yb.
        x: f64x8, the samples' offsets, y: f64x8, where they are; grid units.
    """
    dy = vec.f64(yb - ya)
    numerator = vec.f64(xb - xa) * (y - vec.f64(ya)) + (vec.f64(xa - HALF) - x) * dy
    crossing = vec.ceil(numerator / (dy * vec.f64(float(SUBPIXEL))))
    return vec.to_i32(vec.least(vec.most(crossing, vec.f64(-1e9)), vec.f64(1e9)))


@inner
def _span(job, record, place, row, start, stop, box_x, box_y, scratch):
    """Draw a row in which every sample has columns of its own, ``start .. stop`` (i32x8 each).

    Args:
        place: of the record among all. box_x, box_y: the pixel that R_BASE belongs to.
        scratch: pointer to SCRATCH_VALUES int32.
    """
    some = start < stop
    start, stop = vec.select(some, start, vec.i32(_FAR_AWAY)), vec.select(some, stop, vec.i32(-_FAR_AWAY))
    begin, end = vec.least_of(start), vec.most_of(stop)
    if begin >= end:
        return
    full_begin, full_end = vec.i32(vec.most_of(start)), vec.i32(vec.least_of(stop))
    first, last = vec.i32(begin), vec.i32(end)
    plane = f64_at(record)
    bounds = f32_at(record)
    slope = plane[R_DX]
    base = plane[R_BASE] + plane[R_DY] * np.float64(row - box_y)
    rising = rising_at(i32_at(job[J_SAMPLES]), slope, plane[R_DY])
    lowest, highest = reach_of(job, slope, plane[R_DY])
    low, high = vec.f32(bounds[R_LOW]), vec.f32(bounds[R_HIGH])
    identity, taker = vec.i32(i32_at(record)[R_ID]), vec.i32(place)
    seen, owners = i32_at(job[J_IDS]), i32_at(job[J_OWNERS])
    far, near = f32_at(job[J_FAR]), f32_at(job[J_NEAR])
    far_bits = as_i32(far)
    ids, depths = i32_at(job[J_SAMPLE_IDS]), f32_at(job[J_SAMPLE_INV_Z])
    slots, taken = i32_at(job[J_SLOTS]), np.int64(scratch[TAKEN])
    line = row * job[J_STRIDE]
    lane = vec.iota()
    for column in range(begin & ~np.int64(vec.LANES - 1), end, vec.LANES):
        here = vec.i32(column) + lane
        full, touched = (here >= full_begin) & (here < full_end), (here >= first) & (here < last)
        w = vec.to_f32(vec.f64(base) + vec.f64(slope) * vec.to_f64(here - vec.i32(box_x)))
        left_open = cover(
            seen, owners, far, near, line + column, w, lowest, highest, low, high, full, touched, identity, taker
        )
        while left_open != 0:
            x = column + vec.lowest_bit(left_open)
            left_open &= left_open - 1
            covered = (vec.i32(x) >= start) & (vec.i32(x) < stop)
            w = vec.f32(base + slope * np.float64(x - box_x)) + rising
            w = vec.least(vec.most(w, low), high)
            taken = put(job, owners, slots, far_bits, ids, depths, taken, line + x, w, covered, identity)
    scratch[TAKEN] = taken


@inner
def _corners(job, record, place, x0, y0, x1, y1, x2, y2, first_row, last_row, box_x, box_y, scratch):
    """Draw the rows ``first_row .. last_row`` of a triangle in grid units, whichever way it winds."""
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0:
        return
    if area < 0:
        x1, x2, y1, y2 = x2, x1, y2, y1
    margin = job[J_MARGIN]
    lowest, highest = min(y0, y1, y2), max(y0, y1, y2)
    top = max(first_centre(lowest - margin), first_row)
    bottom = min(first_centre(highest + margin), last_row)
    left = max(first_centre(min(x0, x1, x2) - margin), 0)
    right = min(first_centre(max(x0, x1, x2) + margin), job[J_WIDTH])
    if left >= right:
        return
    fx0, fy0 = np.float64(x0), np.float64(y0)
    fx1, fy1 = np.float64(x1), np.float64(y1)
    fx2, fy2 = np.float64(x2), np.float64(y2)
    samples = i32_at(job[J_SAMPLES])
    x, oy = vec.to_f64(vec.load(samples, 0)), vec.to_f64(vec.load(samples, vec.LANES))
    for row in range(top, bottom):
        y = vec.f64(row * SUBPIXEL + HALF) + oy
        start, stop = vec.i32(left), vec.i32(right)
        # With this winding (y down) edges that run upwards are left ones.
        if y1 < y0:
            start = vec.most(start, _crossing(fx0, fy0, fx1, fy1, x, y))
        elif y1 > y0:
            stop = vec.least(stop, _crossing(fx0, fy0, fx1, fy1, x, y))
        if y2 < y1:
            start = vec.most(start, _crossing(fx1, fy1, fx2, fy2, x, y))
        elif y2 > y1:
            stop = vec.least(stop, _crossing(fx1, fy1, fx2, fy2, x, y))
        if y0 < y2:
            start = vec.most(start, _crossing(fx2, fy2, fx0, fy0, x, y))
        elif y0 > y2:
            stop = vec.least(stop, _crossing(fx2, fy2, fx0, fy0, x, y))
        inside = (y >= vec.f64(lowest)) & (y < vec.f64(highest))
        _span(job, record, place, row, start, vec.select(inside, stop, vec.i32(-1)), box_x, box_y, scratch)


@inner
def _square(job, record, place, x0, y0, x1, y1, first_row, last_row, scratch):
    """Draw a point: the samples in a square of grid units."""
    margin = job[J_MARGIN]
    top = max(first_centre(y0 - margin), first_row)
    bottom = min(first_centre(y1 + margin), last_row)
    samples = i32_at(job[J_SAMPLES])
    ox, oy = vec.load(samples, 0), vec.load(samples, vec.LANES)
    # first_centre() of each sample.
    up, eight = vec.i32(SUBPIXEL - 1 - HALF) - ox, vec.i32(8)
    start = vec.most((vec.i32(x0) + up) >> eight, vec.i32(0))
    stop = vec.least((vec.i32(x1) + up) >> eight, vec.i32(job[J_WIDTH]))
    for row in range(top, bottom):
        y = vec.i32(row * SUBPIXEL + HALF) + oy
        inside = (y >= vec.i32(y0)) & (y < vec.i32(y1))
        _span(job, record, place, row, start, vec.select(inside, stop, vec.i32(-1)), np.int64(0), np.int64(0), scratch)


@inner
def _draw(job, lens, record, place, first_row, last_row, scratch):
    """Draw the part of a record that lies in the rows ``first_row .. last_row``."""
    whole = i32_at(record)
    kind = whole[R_KIND]
    if kind == KIND_SMALL:
        small_samples(job, record, place, first_row, last_row, scratch)
        return
    a, b = np.int64(whole[R_XY]), np.int64(whole[R_XY + 1])
    c, d = np.int64(whole[R_XY + 2]), np.int64(whole[R_XY + 3])
    e, f = np.int64(whole[R_XY + 4]), np.int64(whole[R_XY + 5])
    # The corners of a triangle, of a line's two triangles or of a clipped polygon, whose fan is drawn.
    grid = np.empty((MAX_VERTICES, 2), np.int64)
    count = 3
    if kind == KIND_TRIANGLE:
        grid[0, 0], grid[0, 1], grid[1, 0], grid[1, 1], grid[2, 0], grid[2, 1] = a, b, c, d, e, f
    elif kind == KIND_LINE:
        ox, oy = (0, e) if abs(c - a) >= abs(d - b) else (e, 0)
        grid[0, 0], grid[0, 1], grid[1, 0], grid[1, 1] = a - ox, b - oy, c - ox, d - oy
        grid[2, 0], grid[2, 1], grid[3, 0], grid[3, 1] = c + ox, d + oy, a + ox, b + oy
        count = 4
    elif kind == KIND_CLIPPED:
        corners = np.empty((3, 3), np.float64)
        element = np.int64(whole[R_ID]) - i64_at(job[J_TABLE])[c * T_COLUMNS + T_RECORD]
        count = clip_triangle(job, lens, c, element, corners, grid)
    else:
        _square(job, record, place, a, b, c, d, first_row, last_row, scratch)
        return
    x0, y0 = grid[0, 0], grid[0, 1]
    box_x, box_y = box_of(whole)
    for k in range(2, count):
        x1, y1, x2, y2 = grid[k - 1, 0], grid[k - 1, 1], grid[k, 0], grid[k, 1]
        _corners(job, record, place, x0, y0, x1, y1, x2, y2, first_row, last_row, box_x, box_y, scratch)


@inner
def raster_samples(job, lens, first_row, last_row):
    """Empty the rows, all of one band, and draw all that touches them.

    Then J_OWNERS has the place of each pixel's record among all, and J_IDS its number; the first is -1 where it sees
    none, and MIXED where the samples have records of their own, the numbers of which J_SAMPLE_IDS has from eight times
    J_SLOTS on.
    """
    band, stride = first_row // BAND_ROWS, job[J_STRIDE]
    owners = i32_at(job[J_OWNERS])
    far, near = f32_at(job[J_FAR]), f32_at(job[J_NEAR])
    # Nothing at or beyond this 1/z is accepted: the far plane costs no test of its own.
    empty = vec.f32(np.nextafter(np.float32(1.0 / lens[L_FAR]), np.float32(-1.0)))
    nobody = vec.i32(-1)
    slots = i32_at(job[J_SLOTS])
    for at in range(first_row * stride, last_row * stride, vec.LANES):
        vec.store(owners, at, nobody)
        vec.store(slots, at, nobody)
        vec.store(far, at, empty)
        vec.store(near, at, empty)
    own_scratch = np.empty(SCRATCH_VALUES, np.int32)
    scratch = i32_at(np.int64(own_scratch.ctypes.data))
    scratch[TAKEN] = 0
    count = count_records(job, band)
    own_places = np.empty(3 * count + BUCKETS, np.int32)
    places = np.int64(own_places.ctypes.data)
    ordered, starts = i32_at(places), i32_at(places + 4 * 3 * count)
    found, keys = i32_at(places + 4 * count), i32_at(places + 8 * count)
    for k in range(front_to_back(job, band, found, keys, starts, ordered)):
        if is_set(job[J_STOP]):
            break
        place = np.int64(ordered[k])
        _draw(job, lens, job[J_RECORDS] + place * RECORD_BYTES, place, first_row, last_row, scratch)
    own_places[0] = 0  # the pointers do not keep the arrays alive
    own_scratch[0] = 0
