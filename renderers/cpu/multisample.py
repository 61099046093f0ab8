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

from renderers import simd as vec
from renderers.cpu.clip import MAX_VERTICES, clip_triangle
from renderers.cpu.elements import first_centre
from renderers.cpu.layout import (
    HALF,
    J_FAR,
    J_IDS,
    J_LANES,
    J_MARGIN,
    J_NEAR,
    J_OWNERS,
    J_RECORDS,
    J_SAMPLE_IDS,
    J_SAMPLE_INV_Z,
    J_SAMPLES,
    J_SLOTS,
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
    S_BASE,
    S_BOX,
    S_DOWN,
    S_DOWN_SECOND,
    S_DX,
    S_DY,
    S_EDGES,
    S_RIGHT,
    S_SIZE,
    SMALL_WIDTH,
    SUBPIXEL,
    T_COLUMNS,
    T_RECORD,
)
from renderers.cpu.order import BUCKETS, count_records, front_to_back
from renderers.cpu.pixelsamples import bounds_of, box_of, cover, put, put_two, rising_at
from renderers.cpu.visibility import BAND_ROWS
from renderers.linked import inlined, inner
from renderers.pointers import as_f32, as_i32, f32_at, f64_at, i32_at, i64_at

_FAR_AWAY: Final = 1 << 30
BATCH: Final = (SMALL_WIDTH + 3 * vec.LANES) * BAND_ROWS
"""Scratch begins with room for a band's pixels of a small triangle; here is what is known of eight of them ..."""
STARTS: Final = BATCH + 4 * vec.LANES
"""... here 1/z where each row begins ..."""
ROWS: Final = STARTS + BAND_ROWS + vec.LANES
"""... here the first and the last row of eight columns of blocks ..."""
TAKEN: Final = ROWS + 2 * vec.LANES
"""... and here how many slots the band has taken."""
SCRATCH_VALUES: Final = TAKEN + 1


@inlined
def _reach(edge, right, down, across, lowest, highest):
    """Narrow the rows in which columns of blocks may be on the inner side of an edge, float32 of some decimals.

    Args:
        edge: an edge function in row 0, grid units; right, down: its steps. across: i32x8, the blocks' first columns.
    """
    best = vec.i32(edge + max(7 * right, 0)) + across * vec.i32(right)
    zero, slack = vec.f32(0.0), vec.f32(0.01)
    change = np.float32(down)
    step = np.float32(1.0) / change if down != 0 else np.float32(0.0)
    crossed = zero - vec.to_f32(best) * vec.f32(step)
    lowest = vec.select(vec.f32(change) > zero, vec.most(crossed - slack, lowest), lowest)
    return lowest, vec.select(vec.f32(change) < zero, vec.least(crossed + slack, highest), highest)


@inlined
def _hidden(far, stride, left, right, top, bottom, high):
    """Whether all pixels of a box see only what is nearer than 1/z ``high``.

    Args:
        far: pointer to J_FAR. left .. bottom: the first column and row of the box and those after its last ones.
    """
    limit, lane = vec.f32(high), vec.iota()
    # What is seen at all is seen in the middle, most often.
    column = max(min((left + right - vec.LANES) >> 1, stride - vec.LANES), 0)
    at = ((top + bottom) >> 1) * stride + column
    here = vec.i32(column) + lane
    inside = (here >= vec.i32(left)) & (here < vec.i32(right))
    if vec.bits((vec.load(far, at) <= limit) & inside) != 0:
        return False
    last = bottom - top - 1
    for start in range(left, right, 2 * vec.LANES):
        # Two columns of blocks and four rows at a time; those at the margins are looked at again.
        first, second = min(start, stride - vec.LANES), min(start + vec.LANES, stride - vec.LANES)
        farthest, other = vec.f32(np.inf), vec.f32(np.inf)
        for row in range(0, last + 1, 4):
            for k in range(4):
                at = (top + min(row + k, last)) * stride
                farthest = vec.least(vec.load(far, at + first), farthest)
                other = vec.least(vec.load(far, at + second), other)
        end = vec.i32(right)
        met = (farthest <= limit) & (vec.i32(first) + lane < end)
        met_other = (other <= limit) & (vec.i32(second) + lane < end)
        if vec.bits(met | met_other) != 0:
            return False
    return True


@inner
def _small(job, record, place, first_row, last_row, scratch):
    """Draw a KIND_SMALL record, eight pixels at a time."""
    whole = i32_at(record)
    fraction = f32_at(record)
    box = np.int64(whole[S_BOX])
    size = np.int64(whole[S_SIZE])
    box_y = box >> 16
    box_x = ((box & 0xFFFF) ^ 0x8000) - 0x8000
    top = max(box_y, first_row)
    bottom = min(box_y + (size >> 16), last_row)
    if top >= bottom:  # one of the chunk's tall ones
        return
    left = max(box_x, 0)
    right = min(box_x + (size & 0xFFFF), job[J_WIDTH])
    stride = job[J_STRIDE]
    if _hidden(f32_at(job[J_FAR]), stride, left, right, top, bottom, fraction[R_HIGH]):
        return
    samples = i32_at(job[J_SAMPLES])
    identity, taker = vec.i32(whole[R_ID]), vec.i32(place)
    low, high = vec.f32(fraction[R_LOW]), vec.f32(fraction[R_HIGH])
    base, slope, rise = fraction[S_BASE], fraction[S_DX], fraction[S_DY]
    rising = rising_at(samples, slope, rise)
    down_to, up_to = bounds_of(rising, scratch)
    lowest, highest = vec.f32(down_to), vec.f32(up_to)
    right0, right1 = np.int64(whole[S_RIGHT]), np.int64(whole[S_RIGHT + 1])
    down0, down1 = np.int64(whole[S_DOWN]), np.int64(whole[S_DOWN_SECOND])
    right2, down2 = -right0 - right1, -down0 - down1
    # Steps are those of a whole pixel, of 256 grid units; offsets are grid units.
    ox, oy = vec.load(samples, 0), vec.load(samples, vec.LANES)
    o0 = vec.i32(right0 >> 8) * ox + vec.i32(down0 >> 8) * oy
    o1 = vec.i32(right1 >> 8) * ox + vec.i32(down1 >> 8) * oy
    o2 = vec.i32(right2 >> 8) * ox + vec.i32(down2 >> 8) * oy
    most0, most1, most2 = vec.most_of(o0), vec.most_of(o1), vec.most_of(o2)
    # From the least to the greatest of a pixel's samples.
    b0 = vec.i32(most0 - vec.least_of(o0))
    b1 = vec.i32(most1 - vec.least_of(o1))
    b2 = vec.i32(most2 - vec.least_of(o2))
    e0, e1, e2 = np.int64(whole[S_EDGES]), np.int64(whole[S_EDGES + 1]), np.int64(whole[S_EDGES + 2])
    total = vec.i32(e0 + e1 + e2)  # the three change by nothing together
    lane, zero = vec.iota(), vec.i32(0)
    skipped, rows = top - box_y, bottom - top
    seen, owners = i32_at(job[J_IDS]), i32_at(job[J_OWNERS])
    far, near = f32_at(job[J_FAR]), f32_at(job[J_NEAR])
    lanes, count = i32_at(job[J_LANES]), np.int64(0)
    d0, d1, d2 = vec.i32(down0), vec.i32(down1), vec.i32(down2)
    starts = as_f32(scratch)
    for row in range(0, rows, vec.LANES):
        below = vec.to_f32(vec.i32(skipped + row) + lane)
        vec.store(starts, STARTS + row, vec.f32(base) + vec.f32(rise) * below)
    # Where there are several columns of blocks, half of the box lies outside the triangle, and blocks begin where
    # vectors do: they lie in one cache line.
    wide = right - left > 2 * vec.LANES
    begin = left - (left & (vec.LANES - 1) if wide else 0)  # type: ignore[operator]  # kernels' integers
    f0, f1, f2 = e0 + most0 + skipped * down0, e1 + most1 + skipped * down1, e2 + most2 + skipped * down2
    for group in range(begin, right, vec.LANES * vec.LANES):
        # Of each of eight columns of blocks, the rows that the triangle may reach.
        across = vec.i32(group - box_x) + (lane << vec.i32(3))
        lowest_row, highest_row = vec.f32(0.0), vec.f32(rows - 1)
        if wide:
            lowest_row, highest_row = _reach(f0, right0, down0, across, lowest_row, highest_row)
            lowest_row, highest_row = _reach(f1, right1, down1, across, lowest_row, highest_row)
            lowest_row, highest_row = _reach(f2, right2, down2, across, lowest_row, highest_row)
        first, last = vec.ceil(vec.least(lowest_row, vec.f32(rows))), vec.floor(vec.most(highest_row, vec.f32(-1.0)))
        vec.store(scratch, ROWS, vec.to_i32(first))
        vec.store(scratch, ROWS + vec.LANES, vec.to_i32(last))
        for block in range(min((right - group + vec.LANES - 1) >> 3, vec.LANES)):
            start = group + vec.LANES * block
            # A block at the right margin moves left: its pixels that were drawn are not drawn again.
            column = min(start, stride - vec.LANES)
            valid = np.int64(255) << (start - column)
            across = vec.i32(column - box_x) + lane
            first_row, end_row = np.int64(scratch[ROWS + block]), np.int64(scratch[ROWS + vec.LANES + block]) + 1
            t0 = vec.i32(f0 + first_row * down0) + across * vec.i32(right0)
            t1 = vec.i32(f1 + first_row * down1) + across * vec.i32(right1)
            t2 = vec.i32(f2 + first_row * down2) + across * vec.i32(right2)
            along = vec.f32(slope) * vec.to_f32(across)
            at = (top + first_row) * stride + column
            here = ((skipped + first_row) << 8) + column - box_x + 8
            for row in range(first_row, end_row):
                touched = (t0 | t1 | t2) >= zero
                full = (t0 >= b0) & (t1 >= b1) & (t2 >= b2)
                t0, t1, t2 = t0 + d0, t1 + d1, t2 + d2
                w = vec.f32(starts[STARTS + row]) + along
                left_open = valid & cover(
                    seen, owners, far, near, at, w, lowest, highest, low, high, full, touched, identity, taker
                )
                vec.store(scratch, count, vec.load(lanes, vec.LANES * left_open) + vec.i32(here))
                count += vec.count_bits(left_open)
                at += stride
                here += 256
    far_bits, near_bits = as_i32(far), as_i32(near)
    ids, depths = i32_at(job[J_SAMPLE_IDS]), f32_at(job[J_SAMPLE_INV_Z])
    slots, taken = i32_at(job[J_SLOTS]), np.int64(scratch[TAKEN])
    centres = as_f32(scratch)
    four = samples[0] == samples[4] and samples[8] == samples[12]
    for begin in range(0, count, vec.LANES):
        listed = vec.load(scratch, begin)
        rows, xs = listed >> vec.i32(8), (listed & vec.i32(255)) - vec.i32(8)
        vec.store(scratch, BATCH, vec.i32(e0) + rows * d0 + xs * vec.i32(right0))
        vec.store(scratch, BATCH + 8, vec.i32(e1) + rows * d1 + xs * vec.i32(right1))
        vec.store(scratch, BATCH + 16, (rows + vec.i32(box_y)) * vec.i32(stride) + (xs + vec.i32(box_x)))
        w = (vec.f32(base) + vec.f32(rise) * vec.to_f32(rows)) + vec.f32(slope) * vec.to_f32(xs)
        vec.store(centres, BATCH + 24, w)
        k, end = np.int64(0), min(np.int64(count) - begin, np.int64(vec.LANES))
        while four and k + 1 < end:
            place_of = BATCH + k
            c0 = vec.halves(vec.i32(scratch[place_of]), vec.i32(scratch[place_of + 1])) + o0
            c1 = vec.halves(vec.i32(scratch[place_of + 8]), vec.i32(scratch[place_of + 9])) + o1
            covered = (c0 | c1 | (total - c0 - c1)) >= zero
            w = vec.halves(vec.f32(centres[place_of + 24]), vec.f32(centres[place_of + 25])) + rising
            w = vec.least(vec.most(w, low), high)
            a, b = np.int64(scratch[place_of + 16]), np.int64(scratch[place_of + 17])
            taken = put_two(job, owners, slots, far_bits, near_bits, ids, depths, taken, a, b, w, covered, identity)
            k += 2
        while k < end:
            c0, c1 = vec.i32(scratch[BATCH + k]) + o0, vec.i32(scratch[BATCH + 8 + k]) + o1
            covered = (c0 | c1 | (total - c0 - c1)) >= zero
            w = vec.least(vec.most(vec.f32(centres[BATCH + 24 + k]) + rising, low), high)
            at = np.int64(scratch[BATCH + 16 + k])
            taken = put(job, owners, slots, far_bits, near_bits, ids, depths, taken, at, w, covered, identity)
            k += 1
    scratch[TAKEN] = taken


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
    down_to, up_to = bounds_of(rising, scratch)
    lowest, highest = vec.f32(down_to), vec.f32(up_to)
    low, high = vec.f32(bounds[R_LOW]), vec.f32(bounds[R_HIGH])
    identity, taker = vec.i32(i32_at(record)[R_ID]), vec.i32(place)
    seen, owners = i32_at(job[J_IDS]), i32_at(job[J_OWNERS])
    far, near = f32_at(job[J_FAR]), f32_at(job[J_NEAR])
    far_bits, near_bits = as_i32(far), as_i32(near)
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
            taken = put(job, owners, slots, far_bits, near_bits, ids, depths, taken, line + x, w, covered, identity)
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
        _small(job, record, place, first_row, last_row, scratch)
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

    Then J_IDS has the number of each pixel's record, -1 where it sees none, and J_OWNERS the record's place among all,
    -1 or MIXED where the samples have records of their own, the numbers of which J_SAMPLE_IDS has from eight times
    J_SLOTS on.
    """
    band, stride = first_row // BAND_ROWS, job[J_STRIDE]
    ids, owners = i32_at(job[J_IDS]), i32_at(job[J_OWNERS])
    far, near = f32_at(job[J_FAR]), f32_at(job[J_NEAR])
    # Nothing at or beyond this 1/z is accepted: the far plane costs no test of its own.
    empty = vec.f32(np.nextafter(np.float32(1.0 / lens[L_FAR]), np.float32(-1.0)))
    nobody = vec.i32(-1)
    slots = i32_at(job[J_SLOTS])
    for at in range(first_row * stride, last_row * stride, vec.LANES):
        vec.store(ids, at, nobody)
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
    front_to_back(job, band, i32_at(places + 4 * count), i32_at(places + 8 * count), starts, ordered)
    for k in range(count):
        place = np.int64(ordered[k])
        _draw(job, lens, job[J_RECORDS] + place * RECORD_BYTES, place, first_row, last_row, scratch)
    own_places[0] = 0  # the pointers do not keep the arrays alive
    own_scratch[0] = 0
