"""Small triangles to pixels: the span of every row, then strips of eight columns over the rows where they are covered.

A pixel is covered where all edge functions are at least 0; they are linear, so that an edge bounds a row's columns by a
quotient. Divided by 256 and rounded down, which keeps their sign, the functions are integers below 2^23 and their
steps integers of at most 2^15: exact in float32, with a half added to the functions, which keeps the sign, too. Then no
quotient is nearer to a column than half of 2^-15, and none within SMALL_WIDTH, product of a value and a reciprocal, is
further from its float32 than 72 x 2^-23, which is less: a column is on the same side of both.

How often a loop turns cannot be predicted where triangles are small, so that there is one for the strips and one for
the rows of a strip, by four. About half of a box is never looked at.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.cpu.blend import blend
from renderers.cpu.layout import (
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
from renderers.cpu.visibility import BAND_ROWS
from renderers.linked import inlined
from renderers.pointers import as_f32, f32_at, i32_at

UNROLLED: Final = 4
"""Rows that are drawn without asking whether there are more; those in which nothing is covered do no harm."""

assert (S_EDGES, S_RIGHT, S_DOWN, R_ID, S_DOWN_SECOND) == (0, 3, 5, 6, 8)
assert (S_BASE, S_DX, S_DY, R_LOW, R_HIGH) == (11, 12, 13, 14, 15)
# What ``prepare`` leaves, 4-byte values. float32 for each row: 1/z at the box's first column, first and last column ...
_START: Final = 0
_LOWER: Final = _START + BAND_ROWS + vec.LANES
_UPPER: Final = _LOWER + BAND_ROWS + vec.LANES
# ... int32: for each strip the first row that is drawn, and how many times UNROLLED; how many strips, the first one's
# column, that in the box, the first of the rows above, the record's last eight values and its number.
_AT: Final = _UPPER + BAND_ROWS + vec.LANES
_COUNT: Final = _AT + 16
_STRIPS: Final = _COUNT + 16
_BEGIN: Final = _STRIPS + 1
_ACROSS: Final = _STRIPS + 2
_ORIGIN: Final = _STRIPS + 3
_ROOM: Final = _STRIPS + 4
_ID: Final = _STRIPS + 5
_PLANE: Final = _STRIPS + 8
SMALL_SCRATCH: Final = _PLANE + vec.LANES
assert SMALL_WIDTH // vec.LANES < 16


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
def _rows_of(spans, groups, left):
    """int64: the bits of the rows whose span reaches into the eight columns from ``left`` on."""
    rows = np.int64(0)
    begin, end = vec.f32(left), vec.f32(left + np.float32(vec.LANES - 1))
    for group in range(groups):
        k = vec.LANES * group
        met = (vec.load(spans, _LOWER + k) <= end) & (vec.load(spans, _UPPER + k) >= begin)
        rows |= vec.bits(met) << k
    return rows


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
    across = np.float32(begin - box_x)
    for group in range(groups):
        lower, upper = vec.f32(np.float32(left - box_x)), vec.f32(np.float32(right - box_x - 1))
        lower, upper = _bound(lower, upper, e0, d0, row, vec.spread0(begins), vec.spread0(ends))
        lower, upper = _bound(lower, upper, e1, d1, row, vec.spread1(begins), vec.spread1(ends))
        lower, upper = _bound(lower, upper, e2, d2, row, vec.spread2(begins), vec.spread2(ends))
        vec.store(spans, _LOWER + vec.LANES * group, lower)
        vec.store(spans, _UPPER + vec.LANES * group, upper)
        vec.store(spans, _START + vec.LANES * group, base + rise * row)
        row = row + vec.f32(float(vec.LANES))

    inside = ((np.int64(1) << rows) - 1) << (top - origin)
    room = min(last_row - origin, vec.LANES * groups)
    strips = (right - begin + vec.LANES - 1) >> 3
    # All rows, where there is little to leave out.
    count = (rows + UNROLLED - 1) >> 2
    scratch[_AT] = scratch[_AT + 1] = min(top - origin, room - UNROLLED * count)
    scratch[_COUNT] = scratch[_COUNT + 1] = count
    if strips > 2:
        for strip in range(strips):
            covered = _rows_of(spans, groups, across) & inside
            first = vec.lowest_bit(covered | (np.int64(1) << 32))
            last = vec.highest_bit(covered | 1)
            count = (last - first + UNROLLED) >> 2 if covered != 0 else 0
            # Rows above the triangle will do as well as rows below it.
            scratch[_AT + strip] = min(first, room - UNROLLED * count)
            scratch[_COUNT + strip] = count
            across += np.float32(vec.LANES)
    scratch[_STRIPS] = strips
    scratch[_BEGIN] = begin
    scratch[_ACROSS] = begin - box_x
    scratch[_ORIGIN] = origin
    scratch[_ROOM] = room
    scratch[_ID] = whole[R_ID]
    vec.store(spans, _PLANE, plane)


@inlined
def draw_prepared(job, rule, scratch):
    """Draw what ``prepare`` has left.

    Args:
        rule: see ``blend``; a constant saves asking for it.
    """
    spans = as_f32(scratch)
    stride = job[J_STRIDE]
    ids, depths = i32_at(job[J_IDS]), f32_at(job[J_INV_Z])
    identity = vec.i32(scratch[_ID])
    slope = vec.f32(spans[_PLANE + S_DX - vec.LANES])
    low, high = vec.f32(spans[_PLANE + R_LOW - vec.LANES]), vec.f32(spans[_PLANE + R_HIGH - vec.LANES])
    across = vec.to_f32(vec.i32(scratch[_ACROSS]) + vec.iota())
    origin = np.int64(scratch[_ORIGIN])
    begin = origin * stride + np.int64(scratch[_BEGIN])
    for strip in range(scratch[_STRIPS]):
        rising = slope * across
        at = np.int64(scratch[_AT + strip])
        pixel = begin + at * stride
        if at >= 0:
            for _ in range(scratch[_COUNT + strip]):
                for k in range(UNROLLED):
                    w = vec.least(vec.most(vec.f32(spans[_START + at + k]) + rising, low), high)
                    met = (across >= vec.f32(spans[_LOWER + at + k])) & (across <= vec.f32(spans[_UPPER + at + k]))
                    blend(job, rule, depths, ids, pixel, w, met, identity)
                    pixel += stride
                at += UNROLLED
        else:  # in a band of few rows
            pixel = begin
            for row in range(scratch[_ROOM]):
                w = vec.least(vec.most(vec.f32(spans[_START + row]) + rising, low), high)
                met = (across >= vec.f32(spans[_LOWER + row])) & (across <= vec.f32(spans[_UPPER + row]))
                blend(job, rule, depths, ids, pixel, w, met, identity)
                pixel += stride
        across = across + vec.f32(float(vec.LANES))
        begin += vec.LANES
