"""Small triangles to samples, eight pixels beside each other at a time; see ``multisample``."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import as_f32, as_i32, f32_at, i32_at
from renderers.raster.layout import (
    J_FAR,
    J_IDS,
    J_LANES,
    J_NEAR,
    J_OWNERS,
    J_SAMPLE_IDS,
    J_SAMPLE_INV_Z,
    J_SAMPLES,
    J_SLOTS,
    J_STRIDE,
    J_WIDTH,
    R_HIGH,
    R_ID,
    R_LOW,
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
)
from renderers.raster.msaa.storage import cover, put, put_two, reach_of, rising_at
from renderers.visibility_buffer import BAND_ROWS

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
def small_samples(job, record, place, first_row, last_row, scratch):
    """Draw a KIND_SMALL record, eight pixels at a time.

    Args:
        place: of the record among all. scratch: pointer to SCRATCH_VALUES int32.
    """
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
    lowest, highest = reach_of(job, slope, rise)
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
    far_bits = as_i32(far)
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
            taken = put_two(job, owners, slots, far_bits, ids, depths, taken, a, b, w, covered, identity)
            k += 2
        while k < end:
            c0, c1 = vec.i32(scratch[BATCH + k]) + o0, vec.i32(scratch[BATCH + 8 + k]) + o1
            covered = (c0 | c1 | (total - c0 - c1)) >= zero
            w = vec.least(vec.most(vec.f32(centres[BATCH + 24 + k]) + rising, low), high)
            at = np.int64(scratch[BATCH + 16 + k])
            taken = put(job, owners, slots, far_bits, ids, depths, taken, at, w, covered, identity)
            k += 1
    scratch[TAKEN] = taken
