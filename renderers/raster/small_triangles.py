"""Small triangles to pixels: the span of every row, then blocks of eight columns and four rows where any is covered.

A pixel is covered where all edge functions are at least 0; they are linear, so that an edge bounds a row's columns by a
quotient. Divided by 256 and rounded down, which keeps their sign, the functions are integers below 2^23 and their
steps integers of at most 2^15: exact in float32, with a half added to the functions, which keeps the sign, too. Then no
quotient is nearer to a column than half of 2^-15, and none within SMALL_WIDTH, product of a value and a reciprocal, is
further from its float32 than 72 x 2^-23, which is less: a column is on the same side of both.

How often a loop turns cannot be predicted where triangles are small, so that there is one for all blocks, which are
the bits of a number. About half of a box is never looked at.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.pointers import as_f32, as_i64, f32_at, i32_at
from renderers.raster.depth_test import blend
from renderers.raster.layout import (
    J_IDS,
    J_INV_Z,
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
from renderers.visibility_buffer import BAND_ROWS

_ROWS_OF_BLOCK: Final = 4

assert (S_EDGES, S_RIGHT, S_DOWN, R_ID, S_DOWN_SECOND) == (0, 3, 5, 6, 8)
assert (S_BASE, S_DX, S_DY, R_LOW, R_HIGH) == (11, 12, 13, 14, 15)
# What ``prepare`` leaves, 4-byte values. float32 for each row: 1/z at the box's first column ...
_START: Final = 0
# ... int32: for each row its first column in the box and how many there are, so that one comparison of unsigned
# numbers tells whether a column is among them; two int64 whose bits are blocks where a column is: of each four rows the
# first eight strips, and the ninth; how many of the rows lie in the band, and how many are prepared; the first strip's
# column, that in the box, the first of the rows; the record's number and its last eight values.
_LOWER: Final = _START + BAND_ROWS + vec.LANES
_WIDE: Final = _LOWER + BAND_ROWS + vec.LANES
_MASKS: Final = _WIDE + BAND_ROWS + vec.LANES
_ROOM: Final = _MASKS + 4
_PREPARED: Final = _ROOM + 1
_BEGIN: Final = _ROOM + 2
_ACROSS: Final = _ROOM + 3
_ORIGIN: Final = _ROOM + 4
_ID: Final = _ROOM + 5
_PLANE: Final = _ROOM + 8
SMALL_SCRATCH: Final = _PLANE + vec.LANES
assert SMALL_WIDTH // vec.LANES < 16
assert _MASKS % 2 == 0


@inlined
def _bound(lower, upper, edge, down, row, begins, ends):
    """Narrow the spans of eight rows to what one edge leaves of them.

    Args:
        edge, down: the edge function at row and column 0 plus a half, and what a row adds; in all lanes.
        begins, ends: minus one over what a column adds, where this bounds columns below or above, otherwise not a
            number, which bounds nothing.
    """
    value = edge + down * row
    return vec.most(value * begins, lower), vec.least(value * ends, upper)


@inlined
def _strips(first, wide):
    """int64 twice: the blocks of eight rows in which any column is covered, eight bits for each four rows; the same of
    the ninth strip.

    Args:
        first, wide: i32x8, the rows' first columns, counted from the first strip's, and how many there are.
    """
    one = vec.i32(1)
    strips = (one << ((first + wide + vec.i32(vec.LANES - 1)) >> vec.i32(3))) - (one << (first >> vec.i32(3)))
    strips = vec.select(wide > vec.i32(0), strips, vec.i32(0))
    strips = strips | vec.swapped(strips)
    strips = strips | vec.swapped_pairs(strips)
    upper, lower = np.int64(vec.lane0(strips)), np.int64(vec.lane4(strips))
    return (upper & 255) | ((lower & 255) << 8), (upper >> 8) | ((lower >> 8) << 8)


@inlined
def prepare(job, record, first_row, last_row, scratch):
    """Find out what ``draw_prepared`` has to do for what a KIND_SMALL record has in the rows ``first_row .. last_row``.

    By itself, so that the next record can be prepared before one is drawn: how often its loops turn is known then, and
    a wrong guess costs little.

    Args:
        scratch: pointer to SMALL_SCRATCH int32.
    """
    whole, fraction, spans = i32_at(record), f32_at(record), as_f32(scratch)
    box, size = np.int64(whole[S_BOX]), np.int64(whole[S_SIZE])
    box_y, box_x = box >> 16, ((box & 0xFFFF) ^ 0x8000) - 0x8000
    top = max(box_y, first_row)
    rows = min(box_y + (size >> 16), last_row) - top
    left = max(box_x, np.int64(0))
    right = min(box_x + (size & 0xFFFF), job[J_WIDTH])
    # Strips begin where vectors do: what a neighbour has just stored is loaded as a whole, and from one cache line.
    begin = left & ~np.int64(vec.LANES - 1)
    groups = (rows + vec.LANES - 1) >> 3
    origin = max(min(top, last_row - vec.LANES * groups), first_row)

    # All fields by two loads, which is a third of the instructions of one for each.
    edges = vec.to_f32(vec.load(whole, 0) >> vec.i32(8))
    half, none, nothing = vec.f32(0.5), vec.f32(0.0), vec.f32(math.nan)
    e0, e1, e2 = vec.spread0(edges) + half, vec.spread1(edges) + half, vec.spread2(edges) + half
    r0, r1, d0 = vec.spread3(edges), vec.spread4(edges), vec.spread5(edges)
    d1 = vec.spread0(vec.to_f32(vec.load(whole, vec.LANES) >> vec.i32(8)))
    r2, d2 = none - r0 - r1, none - d0 - d1
    # Lanes 0 to 2: the changes per column.
    rights = vec.select(vec.iota() == vec.i32(0), r0, vec.select(vec.iota() == vec.i32(1), r1, r2))
    columns = vec.f32(-1.0) / rights
    # A level edge holds for all of a row or for nothing, which an infinite bound below says.
    begins = vec.select(rights >= none, columns, nothing)
    ends = vec.select(rights >= none, nothing, columns)
    plane = vec.load(fraction, vec.LANES)
    base, rise = vec.spread3(plane), vec.spread5(plane)
    row = vec.to_f32(vec.i32(origin - box_y) + vec.iota())
    across = begin - box_x
    one, most_left, most_right = vec.f32(1.0), vec.f32(left - box_x) - half, vec.f32(right - box_x) - half
    strips, ninth = np.int64(0), np.int64(0)
    for group in range(groups):
        lower, upper = most_left, most_right
        lower, upper = _bound(lower, upper, e0, d0, row, vec.spread0(begins), vec.spread0(ends))
        lower, upper = _bound(lower, upper, e1, d1, row, vec.spread1(begins), vec.spread1(ends))
        lower, upper = _bound(lower, upper, e2, d2, row, vec.spread2(begins), vec.spread2(ends))
        # An edge that is level, or nearly, bounds a row anywhere. No bound is a whole number, nor (see above) nearer to
        # one than 6e-6 where it counts: a sum below 128 is at most 4e-6 off.
        first = vec.to_i32(vec.least(lower, most_right) + one)
        wide = vec.most(vec.to_i32(vec.most(upper + one, none)) - first, vec.i32(0))
        vec.store(scratch, _LOWER + vec.LANES * group, first)
        vec.store(scratch, _WIDE + vec.LANES * group, wide)
        eight, last = _strips(first - vec.i32(across), wide)
        strips |= eight << (16 * group)
        ninth |= last << (16 * group)
        vec.store(spans, _START + vec.LANES * group, base + rise * row)
        row = row + vec.f32(float(vec.LANES))

    masks = as_i64(scratch)
    masks[_MASKS // 2] = strips
    masks[_MASKS // 2 + 1] = ninth
    scratch[_ROOM] = min(last_row - origin, vec.LANES * groups)
    scratch[_PREPARED] = vec.LANES * groups
    scratch[_BEGIN] = begin
    scratch[_ACROSS] = across
    scratch[_ORIGIN] = origin
    scratch[_ID] = whole[R_ID]
    vec.store(spans, _PLANE, plane)


@inlined
def _row(job, rule, scratch, row, pixel, columns, rising, low, high, identity):
    """Draw eight columns of a row."""
    w = vec.least(vec.most(vec.f32(as_f32(scratch)[_START + row]) + rising, low), high)
    met = vec.below(columns - vec.i32(scratch[_LOWER + row]), vec.i32(scratch[_WIDE + row]))
    blend(job, rule, f32_at(job[J_INV_Z]), i32_at(job[J_IDS]), pixel, w, met, identity)


@inlined
def draw_prepared(job, rule, scratch):
    """Draw what ``prepare`` has left.

    Args:
        rule: see ``blend``; a constant saves asking for it.
    """
    spans = as_f32(scratch)
    stride = job[J_STRIDE]
    identity = vec.i32(scratch[_ID])
    slope = vec.f32(spans[_PLANE + S_DX - vec.LANES])
    low, high = vec.f32(spans[_PLANE + R_LOW - vec.LANES]), vec.f32(spans[_PLANE + R_HIGH - vec.LANES])
    begin = np.int64(scratch[_ORIGIN]) * stride + np.int64(scratch[_BEGIN])
    across = vec.i32(scratch[_ACROSS]) + vec.iota()
    masks = as_i64(scratch)
    mask, ninth = masks[_MASKS // 2], masks[_MASKS // 2 + 1]
    room = np.int64(scratch[_ROOM])
    enough = room == scratch[_PREPARED]
    for _ in range(1 if ninth == 0 else 2):
        while mask != 0:
            bit = vec.lowest_bit(mask)
            mask &= mask - 1
            row = (bit >> 3) * _ROWS_OF_BLOCK
            right = (bit & 7) * vec.LANES
            pixel = begin + row * stride + right
            columns = across + vec.i32(right)
            rising = slope * vec.to_f32(columns)
            if enough:
                for k in range(_ROWS_OF_BLOCK):
                    _row(job, rule, scratch, row + k, pixel + k * stride, columns, rising, low, high, identity)
            else:  # in a band of few rows
                for k in range(min(room - row, _ROWS_OF_BLOCK)):
                    _row(job, rule, scratch, row + k, pixel + k * stride, columns, rising, low, high, identity)
        mask = ninth
        begin += vec.LANES * vec.LANES
        across = across + vec.i32(vec.LANES * vec.LANES)
