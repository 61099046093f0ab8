"""Small triangles with several samples per pixel, eight neighbouring pixels at a time."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import as_f32
from renderers.raster.layout import SMALL_WIDTH
from renderers.raster.msaa.storage import cover, sample_slopes, slope_range, test_samples, test_two_pixels
from renderers.raster.small_triangles import box_of
from renderers.visibility_buffer import BAND_ROWS

# Scratch, int32 or float32: first a list of pixels whose samples must be tested one by one.
_BATCH: Final = (SMALL_WIDTH + 3 * vec.LANES) * BAND_ROWS
"""Two edge functions, index and 1/z of eight of them."""
_STARTS: Final = _BATCH + 4 * vec.LANES
"""1/z at the beginning of each row."""
_ROWS: Final = _STARTS + BAND_ROWS + vec.LANES
"""First and last row of eight columns of blocks."""
TAKEN: Final = _ROWS + 2 * vec.LANES
"""Number of slots that the band uses."""
SCRATCH_VALUES: Final = TAKEN + 1


@inlined
def _limit_rows(edge, right, down, across, lowest, highest):
    """Narrow the rows in which columns of blocks may be on the inner side of an edge; f32x8.

    Args:
        edge, right, down: the edge function in row 0, grid units, and its steps.
        across: i32x8, the blocks' first columns.
    """
    best = vec.i32(edge + max(7 * right, 0)) + across * vec.i32(right)
    zero, slack = vec.f32(0.0), vec.f32(0.01)
    change = np.float32(down)
    step = np.float32(1.0) / change if down != 0 else np.float32(0.0)
    crossed = zero - vec.to_f32(best) * vec.f32(step)
    lowest = vec.select(vec.f32(change) > zero, vec.maximum(crossed - slack, lowest), lowest)
    return lowest, vec.select(vec.f32(change) < zero, vec.minimum(crossed + slack, highest), highest)


@inlined
def _is_hidden(far, stride, left, right, top, bottom, high):
    """Return whether all pixels of a box are nearer than 1/z ``high``.

    Args:
        far: pointer to SAMPLE_BAND.far. left .. bottom: first column and row of the box, and those after the last.
    """
    limit, lane = vec.f32(high), vec.iota()
    # The middle first: what is visible at all mostly is there.
    column = max(min((left + right - vec.LANES) >> 1, stride - vec.LANES), 0)
    at = ((top + bottom) >> 1) * stride + column
    here = vec.i32(column) + lane
    inside = (here >= vec.i32(left)) & (here < vec.i32(right))
    if vec.movemask((vec.load(far, at) <= limit) & inside) != 0:
        return False
    last = bottom - top - 1
    for start in range(left, right, 2 * vec.LANES):
        # Two columns of blocks and four rows at a time; those at the margins are tested twice.
        first, second = min(start, stride - vec.LANES), min(start + vec.LANES, stride - vec.LANES)
        farthest, other = vec.f32(np.inf), vec.f32(np.inf)
        for row in range(0, last + 1, 4):
            for k in range(4):
                at = (top + min(row + k, last)) * stride
                farthest = vec.minimum(vec.load(far, at + first), farthest)
                other = vec.minimum(vec.load(far, at + second), other)
        end = vec.i32(right)
        met = (farthest <= limit) & (vec.i32(first) + lane < end)
        met_other = (other <= limit) & (vec.i32(second) + lane < end)
        if vec.movemask(met | met_other) != 0:
            return False
    return True


@device_function
def draw_small_samples(frame, band, triangle, owner, first_row, last_row, scratch):
    """Draw a SMALL_TRIANGLE, eight pixels at a time.

    Args:
        band: a SAMPLE_BAND. owner: index of the binned primitive.
        scratch: pointer to SCRATCH_VALUES int32.
    """
    box_x, box_y, box_columns, box_rows = box_of(triangle)
    top = max(box_y, first_row)
    bottom = min(box_y + box_rows, last_row)
    if top >= bottom:  # one of the chunk's tall primitives
        return
    left = max(box_x, 0)
    right = min(box_x + box_columns, frame.width)
    stride = frame.stride
    if _is_hidden(band.far, stride, left, right, top, bottom, triangle.high):
        return
    samples = frame.sample_offsets
    ids, owners = vec.i32(triangle.id), vec.i32(owner)
    low, high = vec.f32(triangle.low), vec.f32(triangle.high)
    base, slope, rise = triangle.base, triangle.dx, triangle.dy
    slopes = sample_slopes(frame, slope, rise)
    lowest, highest = slope_range(frame, slope, rise)
    right0, right1 = np.int64(triangle.right[0]), np.int64(triangle.right[1])
    down0, down1 = np.int64(triangle.down), np.int64(triangle.down_second)
    right2, down2 = -right0 - right1, -down0 - down1
    # Steps are those of a whole pixel, of 256 grid units; offsets are grid units.
    ox, oy = vec.load(samples, 0), vec.load(samples, vec.LANES)
    o0 = vec.i32(right0 >> 8) * ox + vec.i32(down0 >> 8) * oy
    o1 = vec.i32(right1 >> 8) * ox + vec.i32(down1 >> 8) * oy
    o2 = vec.i32(right2 >> 8) * ox + vec.i32(down2 >> 8) * oy
    most0, most1, most2 = vec.maximum_of(o0), vec.maximum_of(o1), vec.maximum_of(o2)
    # From the least to the greatest of a pixel's samples.
    b0 = vec.i32(most0 - vec.minimum_of(o0))
    b1 = vec.i32(most1 - vec.minimum_of(o1))
    b2 = vec.i32(most2 - vec.minimum_of(o2))
    e0, e1, e2 = np.int64(triangle.edges[0]), np.int64(triangle.edges[1]), np.int64(triangle.edges[2])
    total = vec.i32(e0 + e1 + e2)  # the sum of the three is constant
    lane, zero = vec.iota(), vec.i32(0)
    skipped, rows = top - box_y, bottom - top
    lane_lists, count = frame.lane_lists, np.int64(0)
    d0, d1, d2 = vec.i32(down0), vec.i32(down1), vec.i32(down2)
    fractions = as_f32(scratch)
    for row in range(0, rows, vec.LANES):
        below = vec.to_f32(vec.i32(skipped + row) + lane)
        vec.store(fractions, _STARTS + row, vec.f32(base) + vec.f32(rise) * below)
    # With several columns of blocks, half of the box lies outside the triangle, and blocks begin where vectors do, so
    # that each lies in one cache line.
    wide = right - left > 2 * vec.LANES
    begin = left - (left & (vec.LANES - 1) if wide else 0)
    f0, f1, f2 = e0 + most0 + skipped * down0, e1 + most1 + skipped * down1, e2 + most2 + skipped * down2
    for group in range(begin, right, vec.LANES * vec.LANES):
        # Rows that the triangle may reach, for each of eight columns of blocks.
        across = vec.i32(group - box_x) + (lane << vec.i32(3))
        lowest_row, highest_row = vec.f32(0.0), vec.f32(rows - 1)
        if wide:
            lowest_row, highest_row = _limit_rows(f0, right0, down0, across, lowest_row, highest_row)
            lowest_row, highest_row = _limit_rows(f1, right1, down1, across, lowest_row, highest_row)
            lowest_row, highest_row = _limit_rows(f2, right2, down2, across, lowest_row, highest_row)
        first = vec.ceil(vec.minimum(lowest_row, vec.f32(rows)))
        last = vec.floor(vec.maximum(highest_row, vec.f32(-1.0)))
        vec.store(scratch, _ROWS, vec.to_i32(first))
        vec.store(scratch, _ROWS + vec.LANES, vec.to_i32(last))
        for block in range(min((right - group + vec.LANES - 1) >> 3, vec.LANES)):
            start = group + vec.LANES * block
            # A block at the right margin is moved left: pixels that were drawn are not drawn again.
            column = min(start, stride - vec.LANES)
            valid = np.int64(255) << (start - column)
            across = vec.i32(column - box_x) + lane
            block_top, block_end = np.int64(scratch[_ROWS + block]), np.int64(scratch[_ROWS + vec.LANES + block]) + 1
            t0 = vec.i32(f0 + block_top * down0) + across * vec.i32(right0)
            t1 = vec.i32(f1 + block_top * down1) + across * vec.i32(right1)
            t2 = vec.i32(f2 + block_top * down2) + across * vec.i32(right2)
            along = vec.f32(slope) * vec.to_f32(across)
            at = (top + block_top) * stride + column
            here = ((skipped + block_top) << 8) + column - box_x + 8
            for row in range(block_top, block_end):
                touched = (t0 | t1 | t2) >= zero
                full = (t0 >= b0) & (t1 >= b1) & (t2 >= b2)
                t0, t1, t2 = t0 + d0, t1 + d1, t2 + d2
                w = vec.f32(fractions[_STARTS + row]) + along
                open_pixels = valid & cover(band, at, w, lowest, highest, low, high, full, touched, ids, owners)
                vec.store(scratch, count, vec.load(lane_lists, vec.LANES * open_pixels) + vec.i32(here))
                count += vec.count_bits(open_pixels)
                at += stride
                here += 256
    taken = np.int64(scratch[TAKEN])
    four = samples[0] == samples[4] and samples[8] == samples[12]
    for begin in range(0, count, vec.LANES):
        listed = vec.load(scratch, begin)
        rows, xs = listed >> vec.i32(8), (listed & vec.i32(255)) - vec.i32(8)
        vec.store(scratch, _BATCH, vec.i32(e0) + rows * d0 + xs * vec.i32(right0))
        vec.store(scratch, _BATCH + 8, vec.i32(e1) + rows * d1 + xs * vec.i32(right1))
        vec.store(scratch, _BATCH + 16, (rows + vec.i32(box_y)) * vec.i32(stride) + (xs + vec.i32(box_x)))
        w = (vec.f32(base) + vec.f32(rise) * vec.to_f32(rows)) + vec.f32(slope) * vec.to_f32(xs)
        vec.store(fractions, _BATCH + 24, w)
        k, end = np.int64(0), min(np.int64(count) - begin, np.int64(vec.LANES))
        while four and k + 1 < end:
            p = _BATCH + k
            c0 = vec.join_halves(vec.i32(scratch[p]), vec.i32(scratch[p + 1])) + o0
            c1 = vec.join_halves(vec.i32(scratch[p + 8]), vec.i32(scratch[p + 9])) + o1
            covered = (c0 | c1 | (total - c0 - c1)) >= zero
            w = vec.join_halves(vec.f32(fractions[p + 24]), vec.f32(fractions[p + 25])) + slopes
            w = vec.minimum(vec.maximum(w, low), high)
            a, b = np.int64(scratch[p + 16]), np.int64(scratch[p + 17])
            taken = test_two_pixels(frame, band, taken, a, b, w, covered, ids)
            k += 2
        while k < end:
            p = _BATCH + k
            c0, c1 = vec.i32(scratch[p]) + o0, vec.i32(scratch[p + 8]) + o1
            covered = (c0 | c1 | (total - c0 - c1)) >= zero
            w = vec.minimum(vec.maximum(vec.f32(fractions[p + 24]) + slopes, low), high)
            taken = test_samples(frame, band, taken, np.int64(scratch[p + 16]), w, covered, ids)
            k += 1
    scratch[TAKEN] = taken
