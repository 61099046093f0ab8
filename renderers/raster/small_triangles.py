"""Coverage of small triangles: find each row's span of columns, then draw its blocks.

A block has eight columns and four rows; it is drawn if any of its pixels is covered.

A pixel is covered where all edge functions are at least 0. They are linear, so that an edge limits a row's columns by a
quotient. Divided by 256 and rounded down, which keeps their sign, the functions are integers below 2^23 and their
steps integers of at most 2^15: exact in float32, also with a half added to the functions, which keeps the sign. Then no
quotient is nearer to a column than half of 2^-15, and none within SMALL_WIDTH, as the product of a value and a
reciprocal, is farther from its float32 than 72 x 2^-23, which is less: a column is on the same side of both.

The trip count of a loop over columns could not be predicted for small triangles. Therefore one loop goes over the set
bits of a mask of blocks. About half of a box is never tested.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.pointers import address, as_f32, as_i64, f32_at, i32_at
from renderers.raster.depth_test import depth_test
from renderers.raster.layout import SMALL_WIDTH
from renderers.visibility_buffer import BAND_ROWS

_ROWS_OF_BLOCK: Final = 4

# Layout of a prepared triangle, int32 or float32. For each row: 1/z at the box's first column; its first column in the
# box and the number of columns. Two int64 masks of blocks with any covered column: for each four rows, the first eight
# blocks; the ninth block. Number of rows within the band, number of prepared rows; the first block's column, and that
# relative to the box; the first row; the primitive id; the last eight values of the SMALL_TRIANGLE.
_START: Final = 0
_FIRST: Final = _START + BAND_ROWS + vec.LANES
_COLUMNS: Final = _FIRST + BAND_ROWS + vec.LANES
_MASKS: Final = _COLUMNS + BAND_ROWS + vec.LANES
_ROWS: Final = _MASKS + 4
_PREPARED_ROWS: Final = _ROWS + 1
_BEGIN: Final = _ROWS + 2
_ACROSS: Final = _ROWS + 3
_TOP: Final = _ROWS + 4
_ID: Final = _ROWS + 5
_PLANE: Final = _ROWS + 8
PREPARED_VALUES: Final = _PLANE + vec.LANES
_DX: Final = _PLANE + 4
_LOW: Final = _PLANE + 6
_HIGH: Final = _PLANE + 7
assert SMALL_WIDTH // vec.LANES < 16
assert _MASKS % 2 == 0


@inlined
def box_of(triangle):
    """Return first column, first row, columns and rows of a SMALL_TRIANGLE's box."""
    box, size = np.int64(triangle.box), np.int64(triangle.size)
    return ((box & 0xFFFF) ^ 0x8000) - 0x8000, box >> 16, size & 0xFFFF, size >> 16


@inlined
def _limit(lower, upper, edge, down, row, begins, ends):
    """Narrow the spans of eight rows to one edge.

    Args:
        edge, down: the edge function at row and column 0 plus a half, and its change per row; in all lanes.
        begins, ends: -1 over the change per column, where the edge limits columns below or above; else NaN, which
            limits nothing.
    """
    value = edge + down * row
    return vec.maximum(value * begins, lower), vec.minimum(value * ends, upper)


@inlined
def _block_masks(first, columns):
    """Return the blocks of eight rows in which any column is covered, eight bits for each four rows, and the same of
    the ninth block; int64.

    Args:
        first, columns: i32x8: the rows' first columns, relative to the first block, and their number.
    """
    one = vec.i32(1)
    blocks = (one << ((first + columns + vec.i32(vec.LANES - 1)) >> vec.i32(3))) - (one << (first >> vec.i32(3)))
    blocks = vec.select(columns > vec.i32(0), blocks, vec.i32(0))
    blocks = blocks | vec.swapped(blocks)
    blocks = blocks | vec.swapped_pairs(blocks)
    upper, lower = np.int64(vec.lane0(blocks)), np.int64(vec.lane4(blocks))
    return (upper & 255) | ((lower & 255) << 8), (upper >> 8) | ((lower >> 8) << 8)


@inlined
def prepare_small(frame, triangle, first_row, last_row, prepared):
    """Find the spans and blocks of a small triangle in the rows ``first_row .. last_row``, for ``draw_small``.

    Args:
        triangle: a SMALL_TRIANGLE.
        prepared: pointer to PREPARED_VALUES int32.
    """
    starts = as_f32(prepared)
    box_x, box_y, box_columns, box_rows = box_of(triangle)
    top = max(box_y, first_row)
    rows = min(box_y + box_rows, last_row) - top
    left = max(box_x, np.int64(0))
    right = min(box_x + box_columns, frame.width)
    # Blocks begin where vectors do: a load gets all of what a neighbour has just stored, from one cache line.
    begin = left & ~np.int64(vec.LANES - 1)
    groups = (rows + vec.LANES - 1) >> 3
    origin = max(min(top, last_row - vec.LANES * groups), first_row)

    # All fields by two loads: a third of the instructions of one for each.
    whole = i32_at(address(triangle))
    edges = vec.to_f32(vec.load(whole, 0) >> vec.i32(8))
    half, none, nothing = vec.f32(0.5), vec.f32(0.0), vec.f32(math.nan)
    e0, e1, e2 = vec.broadcast_lane0(edges) + half, vec.broadcast_lane1(edges) + half, vec.broadcast_lane2(edges) + half
    r0, r1, d0 = vec.broadcast_lane3(edges), vec.broadcast_lane4(edges), vec.broadcast_lane5(edges)
    d1 = vec.broadcast_lane0(vec.to_f32(vec.load(whole, vec.LANES) >> vec.i32(8)))
    r2, d2 = none - r0 - r1, none - d0 - d1
    # Lanes 0 to 2: the changes per column.
    rights = vec.select(vec.iota() == vec.i32(0), r0, vec.select(vec.iota() == vec.i32(1), r1, r2))
    columns = vec.f32(-1.0) / rights
    # A level edge holds for all of a row or for nothing: an infinite lower limit.
    begins = vec.select(rights >= none, columns, nothing)
    ends = vec.select(rights >= none, nothing, columns)
    plane = vec.load(f32_at(address(triangle)), vec.LANES)
    base, rise = vec.broadcast_lane3(plane), vec.broadcast_lane5(plane)
    row = vec.to_f32(vec.i32(origin - box_y) + vec.iota())
    across = begin - box_x
    one, most_left, most_right = vec.f32(1.0), vec.f32(left - box_x) - half, vec.f32(right - box_x) - half
    blocks, ninth = np.int64(0), np.int64(0)
    for group in range(groups):
        lower, upper = most_left, most_right
        lower, upper = _limit(lower, upper, e0, d0, row, vec.broadcast_lane0(begins), vec.broadcast_lane0(ends))
        lower, upper = _limit(lower, upper, e1, d1, row, vec.broadcast_lane1(begins), vec.broadcast_lane1(ends))
        lower, upper = _limit(lower, upper, e2, d2, row, vec.broadcast_lane2(begins), vec.broadcast_lane2(ends))
        # A nearly level edge may limit a row anywhere. No limit is an integer, nor (see above) nearer to one than 6e-6
        # where it counts; a sum below 128 is at most 4e-6 off.
        first = vec.to_i32(vec.minimum(lower, most_right) + one)
        wide = vec.maximum(vec.to_i32(vec.maximum(upper + one, none)) - first, vec.i32(0))
        vec.store(prepared, _FIRST + vec.LANES * group, first)
        vec.store(prepared, _COLUMNS + vec.LANES * group, wide)
        eight, last = _block_masks(first - vec.i32(across), wide)
        blocks |= eight << (16 * group)
        ninth |= last << (16 * group)
        vec.store(starts, _START + vec.LANES * group, base + rise * row)
        row = row + vec.f32(float(vec.LANES))

    masks = as_i64(prepared)
    masks[_MASKS // 2] = blocks
    masks[_MASKS // 2 + 1] = ninth
    prepared[_ROWS] = min(last_row - origin, vec.LANES * groups)
    prepared[_PREPARED_ROWS] = vec.LANES * groups
    prepared[_BEGIN] = begin
    prepared[_ACROSS] = across
    prepared[_TOP] = origin
    prepared[_ID] = triangle.id
    vec.store(starts, _PLANE, plane)


@inlined
def _draw_row(frame, layer, rule, prepared, row, pixel, columns, rising, low, high, ids):
    """Draw eight columns of a row."""
    w = vec.minimum(vec.maximum(vec.f32(as_f32(prepared)[_START + row]) + rising, low), high)
    # One comparison of unsigned numbers tells whether a column is in the span.
    covered = vec.less_unsigned(columns - vec.i32(prepared[_FIRST + row]), vec.i32(prepared[_COLUMNS + row]))
    depth_test(frame, layer, rule, pixel, w, covered, ids)


@inlined
def draw_small(frame, layer, rule, prepared):
    """Draw a triangle that ``prepare_small`` has prepared; ``rule`` as for ``depth_test``."""
    fractions = as_f32(prepared)
    stride = frame.stride
    ids = vec.i32(prepared[_ID])
    slope = vec.f32(fractions[_DX])
    low, high = vec.f32(fractions[_LOW]), vec.f32(fractions[_HIGH])
    begin = np.int64(prepared[_TOP]) * stride + np.int64(prepared[_BEGIN])
    across = vec.i32(prepared[_ACROSS]) + vec.iota()
    masks = as_i64(prepared)
    mask, ninth = masks[_MASKS // 2], masks[_MASKS // 2 + 1]
    rows = np.int64(prepared[_ROWS])
    enough = rows == prepared[_PREPARED_ROWS]
    for _ in range(1 if ninth == 0 else 2):
        while mask != 0:
            bit = vec.lowest_bit(mask)
            mask &= mask - 1
            row = (bit >> 3) * _ROWS_OF_BLOCK
            right = (bit & 7) * vec.LANES
            pixel = begin + row * stride + right
            columns = across + vec.i32(right)
            rising = slope * vec.to_f32(columns)
            if enough:  # a constant number of rows, which LLVM unrolls
                for k in range(_ROWS_OF_BLOCK):
                    _draw_row(
                        frame, layer, rule, prepared, row + k, pixel + k * stride, columns, rising, low, high, ids
                    )
            else:  # in a band of few rows
                for k in range(min(rows - row, _ROWS_OF_BLOCK)):
                    _draw_row(
                        frame, layer, rule, prepared, row + k, pixel + k * stride, columns, rising, low, high, ids
                    )
        mask = ninth
        begin += vec.LANES * vec.LANES
        across = across + vec.i32(vec.LANES * vec.LANES)
