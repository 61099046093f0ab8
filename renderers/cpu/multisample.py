"""Records to samples: as ``raster``, for the eight samples of a pixel at once.

A triangle is set up once. Its edges and its 1/z are linear, so that what they are at a sample is what they are at the
pixel's centre plus an offset that is the same in all pixels. A pixel's samples lie side by side, one to a lane: a small
triangle, which fills few pixels of a vector along a row, fills all its lanes along the samples. Of four samples, those
of an even column and of the next one share a vector; what is said of the pixel is said of the first one then.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from renderers import simd as vec
from renderers.cpu.clip import MAX_VERTICES, clip_triangle
from renderers.cpu.elements import first_centre
from renderers.cpu.layout import (
    CHUNK,
    HALF,
    J_BANDS,
    J_CHUNKS,
    J_HEIGHT,
    J_MARGIN,
    J_OFFSETS,
    J_PAIRED,
    J_RECORDS,
    J_SAMPLE_IDS,
    J_SAMPLE_INV_Z,
    J_SAMPLES,
    J_SMALL,
    J_STRIDE,
    J_TABLE,
    J_TALL,
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
    S_BASE,
    S_BOX,
    S_DOWN,
    S_DOWN_SECOND,
    S_DX,
    S_DY,
    S_EDGES,
    S_RIGHT,
    S_SIZE,
    SMALL_BANDS,
    SUBPIXEL,
    T_COLUMNS,
    T_RECORD,
)
from renderers.cpu.visibility import BAND_ROWS
from renderers.pointers import f32_at, f64_at, i32_at, i64_at, u16_at

_FAR_AWAY = 1 << 30


@njit(nogil=True, error_model="numpy", forceinline=True)
def _put(depths, ids, at, w, covered, identity):  # type: ignore[no-untyped-def]
    """Write the covered samples from place ``at`` on that are nearer than what is there."""
    old = vec.load_again(depths, at)
    covered = covered & (w > old)
    vec.store(depths, at, vec.select(covered, w, old))
    vec.store(ids, at, vec.select(covered, identity, vec.load_again(ids, at)))


@njit(nogil=True, error_model="numpy", forceinline=True)
def _rising(samples, dx, dy):  # type: ignore[no-untyped-def]
    """f32x8: 1/z at the samples less that at the centre."""
    pixel = vec.f32(1.0 / SUBPIXEL)
    across, down = vec.to_f32(vec.load(samples, 0)) * pixel, vec.to_f32(vec.load(samples, vec.LANES)) * pixel
    return vec.f32(dx) * across + vec.f32(dy) * down


@njit(nogil=True, error_model="numpy")
def _small(job, record, first_row, last_row):  # type: ignore[no-untyped-def]
    """Draw a KIND_SMALL record: the pixels that it may touch are found eight at a time."""
    whole = i32_at(record)
    fraction = f32_at(record)
    box = np.int64(whole[S_BOX])
    size = np.int64(whole[S_SIZE])
    box_y = box >> 16
    box_x = ((box & 0xFFFF) ^ 0x8000) - 0x8000
    top = max(box_y, first_row)
    bottom = min(box_y + (size >> 16), last_row)
    left = max(box_x, 0)
    right = min(box_x + (size & 0xFFFF), job[J_WIDTH])
    stride = job[J_STRIDE]
    ids = i32_at(job[J_SAMPLE_IDS])
    depths = f32_at(job[J_SAMPLE_INV_Z])
    samples = i32_at(job[J_SAMPLES])
    identity = vec.i32(whole[R_ID])
    low, high = vec.f32(fraction[R_LOW]), vec.f32(fraction[R_HIGH])
    base, slope, rise = fraction[S_BASE], fraction[S_DX], fraction[S_DY]
    rising = _rising(samples, slope, rise)
    right0, right1 = np.int64(whole[S_RIGHT]), np.int64(whole[S_RIGHT + 1])
    down0, down1 = np.int64(whole[S_DOWN]), np.int64(whole[S_DOWN_SECOND])
    right2, down2 = -right0 - right1, -down0 - down1
    # Steps are those of a whole pixel, of 256 grid units; offsets are grid units.
    ox, oy = vec.load(samples, 0), vec.load(samples, vec.LANES)
    o0 = vec.i32(right0 >> 8) * ox + vec.i32(down0 >> 8) * oy
    o1 = vec.i32(right1 >> 8) * ox + vec.i32(down1 >> 8) * oy
    o2 = vec.i32(right2 >> 8) * ox + vec.i32(down2 >> 8) * oy
    margin = job[J_MARGIN]
    m0 = margin * ((abs(right0) + abs(down0)) >> 8)
    m1 = margin * ((abs(right1) + abs(down1)) >> 8)
    m2 = margin * ((abs(right2) + abs(down2)) >> 8)
    e0, e1, e2 = np.int64(whole[S_EDGES]), np.int64(whole[S_EDGES + 1]), np.int64(whole[S_EDGES + 2])
    lane, zero = vec.iota(), vec.i32(0)
    paired = job[J_PAIRED]
    for column in range(left & ~paired, right, vec.LANES):
        across = vec.i32(column - box_x) + lane
        skipped = top - box_y
        t0 = vec.i32(e0 + m0 + skipped * down0) + across * vec.i32(right0)
        t1 = vec.i32(e1 + m1 + skipped * down1) + across * vec.i32(right1)
        t2 = vec.i32(e2 + m2 + skipped * down2) + across * vec.i32(right2)
        d0, d1, d2 = vec.i32(down0), vec.i32(down1), vec.i32(down2)
        valid = (np.int64(1) << min(right - column, vec.LANES)) - 1
        for row in range(skipped, bottom - box_y):
            touched = vec.bits((t0 | t1 | t2) >= zero) & valid
            if paired != 0:
                touched = (touched | (touched >> 1)) & 0x55
            t0, t1, t2 = t0 + d0, t1 + d1, t2 + d2
            line = (box_y + row) * stride + column
            here = base + rise * np.float32(row)
            while touched != 0:
                k = vec.lowest_bit(touched)
                touched &= touched - 1
                x = column - box_x + k
                c0 = vec.i32(e0 + row * down0 + x * right0) + o0
                c1 = vec.i32(e1 + row * down1 + x * right1) + o1
                c2 = vec.i32(e2 + row * down2 + x * right2) + o2
                w = vec.f32(here + slope * np.float32(x)) + rising
                w = vec.least(vec.most(w, low), high)
                _put(depths, ids, (line + k) << (3 - paired), w, (c0 | c1 | c2) >= zero, identity)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _crossing(xa, ya, xb, yb, x, y):  # type: ignore[no-untyped-def]
    """i32x8: for every sample, the first column in which it is at or right of the edge; see ``raster``.

    Args:
        xa, ya, xb, yb: float64 integers, grid units; ya != yb.
        x: f64x8, the samples' offsets, y: f64x8, where they are; grid units.
    """
    dy = vec.f64(yb - ya)
    numerator = vec.f64(xb - xa) * (y - vec.f64(ya)) + (vec.f64(xa - HALF) - x) * dy
    crossing = vec.ceil(numerator / (dy * vec.f64(float(SUBPIXEL))))
    return vec.to_i32(vec.least(vec.most(crossing, vec.f64(-1e9)), vec.f64(1e9)))


@njit(nogil=True, error_model="numpy")
def _span(job, record, row, start, stop, box_x, box_y, scratch):  # type: ignore[no-untyped-def]
    """Draw a row in which every sample has columns of its own, ``start .. stop`` (i32x8 each).

    Args:
        box_x, box_y: the pixel that R_BASE belongs to. scratch: pointer to 16 int32.
    """
    some = start < stop
    start, stop = vec.select(some, start, vec.i32(_FAR_AWAY)), vec.select(some, stop, vec.i32(-_FAR_AWAY))
    vec.store(scratch, 0, start)
    vec.store(scratch, vec.LANES, stop)
    begin, end = np.int64(scratch[0]), np.int64(scratch[vec.LANES])
    for k in range(1, vec.LANES):
        begin, end = min(begin, np.int64(scratch[k])), max(end, np.int64(scratch[vec.LANES + k]))
    plane = f64_at(record)
    bounds = f32_at(record)
    samples = i32_at(job[J_SAMPLES])
    slope = plane[R_DX]
    base = plane[R_BASE] + plane[R_DY] * np.float64(row - box_y)
    rising = _rising(samples, slope, plane[R_DY])
    low, high = vec.f32(bounds[R_LOW]), vec.f32(bounds[R_HIGH])
    identity = vec.i32(i32_at(record)[R_ID])
    ids = i32_at(job[J_SAMPLE_IDS])
    depths = f32_at(job[J_SAMPLE_INV_Z])
    line = row * job[J_STRIDE]
    paired = job[J_PAIRED]
    for column in range(max(begin & ~paired, 0), end, 1 + paired):
        here = vec.i32(column)
        w = vec.f32(base + slope * np.float64(column - box_x)) + rising
        w = vec.least(vec.most(w, low), high)
        _put(depths, ids, (line + column) << (3 - paired), w, (here >= start) & (here < stop), identity)


@njit(nogil=True, error_model="numpy")
def _corners(job, record, x0, y0, x1, y1, x2, y2, first_row, last_row, box_x, box_y, scratch):  # type: ignore[no-untyped-def]
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
    further = (vec.load(samples, 0) + vec.i32(HALF)) >> vec.i32(8)  # columns to the right
    for row in range(top, bottom):
        y = vec.f64(row * SUBPIXEL + HALF) + oy
        start, stop = vec.i32(left) - further, vec.i32(right) - further
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
        _span(job, record, row, start, vec.select(inside, stop, vec.i32(-1)), box_x, box_y, scratch)


@njit(nogil=True, error_model="numpy")
def _square(job, record, x0, y0, x1, y1, first_row, last_row, scratch):  # type: ignore[no-untyped-def]
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
        _span(job, record, row, start, vec.select(inside, stop, vec.i32(-1)), np.int64(0), np.int64(0), scratch)


@njit(nogil=True, error_model="numpy")
def _draw(job, lens, record, first_row, last_row, scratch):  # type: ignore[no-untyped-def]
    """Draw the part of a record that lies in the rows ``first_row .. last_row``."""
    whole = i32_at(record)
    kind = whole[R_KIND]
    if kind == KIND_SMALL:
        _small(job, record, first_row, last_row)
        return
    a, b = np.int64(whole[R_XY]), np.int64(whole[R_XY + 1])
    c, d = np.int64(whole[R_XY + 2]), np.int64(whole[R_XY + 3])
    e, f = np.int64(whole[R_XY + 4]), np.int64(whole[R_XY + 5])
    # The corners of a triangle, of a line's two triangles or of a clipped polygon, whose fan is drawn.
    grid = np.empty((MAX_VERTICES, 2), np.int64)
    count = 3
    if kind == KIND_TRIANGLE:
        grid[0, 0], grid[0, 1], grid[1, 0], grid[1, 1], grid[2, 0], grid[2, 1] = a, b, c, d, e, f
        a, b = first_centre(min(a, c, e)), first_centre(min(b, d, f))
    elif kind == KIND_LINE:
        ox, oy = (0, e) if abs(c - a) >= abs(d - b) else (e, 0)
        grid[0, 0], grid[0, 1], grid[1, 0], grid[1, 1] = a - ox, b - oy, c - ox, d - oy
        grid[2, 0], grid[2, 1], grid[3, 0], grid[3, 1] = c + ox, d + oy, a + ox, b + oy
        count = 4
        a, b = f & 0xFFFF, f >> 16
    elif kind == KIND_CLIPPED:
        corners = np.empty((3, 3), np.float64)
        element = np.int64(whole[R_ID]) - i64_at(job[J_TABLE])[c * T_COLUMNS + T_RECORD]
        count = clip_triangle(job, lens, c, element, corners, grid)
    else:
        _square(job, record, a, b, c, d, first_row, last_row, scratch)
        return
    x0, y0 = grid[0, 0], grid[0, 1]
    for k in range(2, count):
        x1, y1, x2, y2 = grid[k - 1, 0], grid[k - 1, 1], grid[k, 0], grid[k, 1]
        _corners(job, record, x0, y0, x1, y1, x2, y2, first_row, last_row, a, b, scratch)


@njit(nogil=True, error_model="numpy")
def raster_samples(job, lens, band):  # type: ignore[no-untyped-def]
    """Empty the band's samples and draw all that touches it, in the order of record numbers."""
    first_row = band * BAND_ROWS
    last_row = min(first_row + BAND_ROWS, job[J_HEIGHT])
    stride = job[J_STRIDE]
    ids = i32_at(job[J_SAMPLE_IDS])
    depths = f32_at(job[J_SAMPLE_INV_Z])
    # Nothing at or beyond this 1/z is accepted: the far plane costs no test of its own.
    empty = vec.f32(np.nextafter(np.float32(1.0 / lens[L_FAR]), np.float32(-1.0)))
    nobody = vec.i32(-1)
    samples = vec.LANES >> job[J_PAIRED]
    for at in range(samples * first_row * stride, samples * last_row * stride, vec.LANES):
        vec.store(ids, at, nobody)
        vec.store(depths, at, empty)
    own_scratch = np.empty(2 * vec.LANES, np.int32)
    scratch = i32_at(np.int64(own_scratch.ctypes.data))
    lists = job[J_BANDS]
    for chunk in range(job[J_CHUNKS]):
        offsets = i32_at(job[J_OFFSETS] + 4 * chunk * (2 * lists + 4))
        k, end = np.int64(offsets[band]), np.int64(offsets[band + 1])
        t, talls = np.int64(0), np.int64(offsets[2 * lists + 2])
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
            _draw(job, lens, records + index * RECORD_BYTES, first_row, last_row, scratch)
    own_scratch[0] = 0  # the pointer above does not keep the array alive
