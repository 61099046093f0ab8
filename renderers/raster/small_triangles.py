"""Coverage of small triangles: find each row's span of covered columns, then draw its blocks.

A block has eight columns and four rows. It is drawn if any of its pixels is covered.

Spans are quotients in float32, yet exact, in these steps:

1. Edge functions change by multiples of 256 per column and row, so that e >> 8 has the sign of e. It is an integer
   below 2^23, and its changes are integers of at most 2^15: exact in float32.
2. With a half added, value = (e >> 8) + 1/2 is never 0. Column c is inside where value + c dx > 0.
3. The limit is the quotient q = -value / dx. It differs from every integer by at least (1/2) / |dx| >= 2^-16.
4. Computed as value * (-1 / dx), within MAX_SMALL_WIDTH, q has an error of at most 72 x 2^-23 < 2^-16, and so is on the
   right side of every column.

The trip count of a loop over columns could not be predicted for small triangles. Therefore one loop goes over the set
bits of a mask of blocks. About half of a box is never tested.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.pointers import address, f32_at, i32_at
from renderers.compiler.structs import F32, I32, I64, Struct, array_of
from renderers.raster.depth_test import depth_test
from renderers.raster.layout import MAX_SMALL_WIDTH, SUBPIXEL_BITS, box_of
from renderers.visibility_buffer import BAND_ROWS

_BLOCK_ROWS: Final = 4

PREPARED: Final = Struct(
    "PreparedTriangle",
    {
        "row_inv_z": array_of(F32, BAND_ROWS),  # of each row: 1/z at the box's first column
        "row_begin_in_box": array_of(I32, BAND_ROWS),  # first covered column, counted from the box's first
        "row_column_count": array_of(I32, BAND_ROWS),  # number of covered columns
        "blocks_to_7": I64,  # mask of blocks with any covered column: for each four rows, the first eight blocks
        "blocks_from_8": I64,  # the same of the next eight blocks
        "first_row": I64,  # row of the image
        "row_count": I64,  # within the band
        "first_column": I64,  # of the first block; column of the image
        "first_column_in_box": I64,  # the same, counted from the box's first column
        "id": I64,
        "tail": array_of(F32, vec.LANES),  # the last eight values of the SMALL_TRIANGLE
    },
)
"""A small triangle within a band, from ``prepare_small`` for ``draw_small``."""
# Lanes of the first eight values of a SMALL_TRIANGLE.
_EDGES: Final = 0
_EDGE_DX: Final = 3
_EDGE0_DY: Final = 5
# Lanes of its last eight values.
_EDGE1_DY: Final = 0
_INV_Z_BASE: Final = 3
_INV_Z_DX: Final = 4
_INV_Z_DY: Final = 5
_INV_Z_MIN: Final = 6
_INV_Z_MAX: Final = 7
_GROUP_SHIFT: Final = 2 * vec.LANES
"""Bits of a mask of blocks for eight rows, which are two rows of blocks. Four groups of rows are a band."""
assert MAX_SMALL_WIDTH // vec.LANES < 2 * vec.LANES
assert BAND_ROWS == 4 * vec.LANES


class _RowEdges(NamedTuple):
    """Three edge functions, and how they limit the columns of a row; three f32x8 each, the same in all lanes."""

    first: Any
    """At row and column 0 of the box, plus a half."""
    dy: Any
    """Change per row."""
    lower_scale: Any
    """-1 over the change per column, or NaN, which limits nothing. An edge limits columns either below or above."""
    upper_scale: Any


@inlined
def _broadcast_lane(vector, k):
    """Return lane ``k`` of an f32x8 in all lanes."""
    return vec.f32(vec.lane(vector, k))


@inlined
def _load_edges(triangle):
    """Return the _RowEdges of a SMALL_TRIANGLE."""
    # All fields by two loads: a third of the instructions of one for each.
    values, bits = i32_at(address(triangle)), vec.i32(SUBPIXEL_BITS)
    fields, tail = vec.to_f32(vec.load(values, 0) >> bits), vec.to_f32(vec.load(values, vec.LANES) >> bits)
    e0, e1, e2 = (
        _broadcast_lane(fields, _EDGES),
        _broadcast_lane(fields, _EDGES + 1),
        _broadcast_lane(fields, _EDGES + 2),
    )
    e0_dx, e1_dx = _broadcast_lane(fields, _EDGE_DX), _broadcast_lane(fields, _EDGE_DX + 1)
    e0_dy, e1_dy = _broadcast_lane(fields, _EDGE0_DY), _broadcast_lane(tail, _EDGE1_DY)
    half, zero, no_limit = vec.f32(0.5), vec.f32(0.0), vec.f32(math.nan)
    e2_dx, e2_dy = zero - e0_dx - e1_dx, zero - e0_dy - e1_dy
    # One division for all three edges, in lanes 0 to 2.
    lane = vec.iota()
    edge_dx = vec.select(lane == vec.i32(0), e0_dx, vec.select(lane == vec.i32(1), e1_dx, e2_dx))
    scale = vec.f32(-1.0) / edge_dx
    # A horizontal edge holds for all of a row or for nothing: an infinite lower limit.
    lower = vec.select(edge_dx >= zero, scale, no_limit)
    upper = vec.select(edge_dx >= zero, no_limit, scale)
    return _RowEdges(
        first=(e0 + half, e1 + half, e2 + half),
        dy=(e0_dy, e1_dy, e2_dy),
        lower_scale=(_broadcast_lane(lower, 0), _broadcast_lane(lower, 1), _broadcast_lane(lower, 2)),
        upper_scale=(_broadcast_lane(upper, 0), _broadcast_lane(upper, 1), _broadcast_lane(upper, 2)),
    )


@inlined
def _covered_columns(edges, row_in_box, lower, upper):
    """Return the first covered column, counted from the box's first, and their number in each of eight rows, i32x8.

    Column c is covered if lower < c < upper. No limit is an integer, nor nearer to one than 6e-6 where it counts, and
    sums below 128 are at most 4e-6 off. So the first column is floor(lower + 1), and the end floor(upper + 1).

    Args:
        edges: a _RowEdges.
        row_in_box: f32x8, counted from the box's first row.
        lower, upper: f32x8: limits by box and image, integers minus a half, counted from the box's first column.
    """
    box_upper, one = upper, vec.f32(1.0)
    lower, upper = _limit_by_edge(lower, upper, edges, 0, row_in_box)
    lower, upper = _limit_by_edge(lower, upper, edges, 1, row_in_box)
    lower, upper = _limit_by_edge(lower, upper, edges, 2, row_in_box)
    # A nearly horizontal edge may limit a row anywhere, also outside of int32. to_i32 is floor of what is not negative.
    begin = vec.to_i32(vec.minimum(lower, box_upper) + one)
    end = vec.to_i32(vec.maximum(upper + one, vec.f32(0.0)))
    return begin, vec.maximum(end - begin, vec.i32(0))


@inlined
def _limit_by_edge(lower, upper, edges, k, row_in_box):
    """Return the column limits of eight rows, narrowed to the inner side of edge ``k``; arguments as above."""
    value = edges.first[k] + edges.dy[k] * row_in_box
    # NaN limits nothing: minimum and maximum return their second argument.
    return vec.maximum(value * edges.lower_scale[k], lower), vec.minimum(value * edges.upper_scale[k], upper)


@inlined
def _block_masks(begin_in_blocks, column_count):
    """Return the masks of the blocks of eight rows in which any column is covered, as PREPARED's, int64.

    Args:
        begin_in_blocks, column_count: i32x8: the rows' first covered columns, counted from the first block's, and their
            number.
    """
    bits, none = vec.i32(3), vec.i32(0)  # of a column within a block
    end = begin_in_blocks + column_count + vec.i32(vec.LANES - 1)
    blocks = (vec.i32(1) << (end >> bits)) - (vec.i32(1) << (begin_in_blocks >> bits))
    blocks = vec.select(column_count > none, blocks, none)
    is_top = vec.iota() < vec.i32(_BLOCK_ROWS)
    top, bottom = vec.or_of(vec.select(is_top, blocks, none)), vec.or_of(vec.select(is_top, none, blocks))
    return (top & 255) | ((bottom & 255) << vec.LANES), (top >> vec.LANES) | ((bottom >> vec.LANES) << vec.LANES)


@inlined
def prepare_small(frame, triangle, first_row, end_row, prepared):
    """Find the spans and blocks of a SMALL_TRIANGLE in some rows, for ``draw_small``.

    Args:
        first_row, end_row: rows of the image, at most BAND_ROWS.
        prepared: a PREPARED.
    """
    box_x, box_y, column_count, box_row_count = box_of(triangle)
    top = max(box_y, first_row)
    row_count = min(box_y + box_row_count, end_row) - top
    left, right = max(box_x, np.int64(0)), min(box_x + column_count, frame.width)
    # Blocks begin where vectors do: a load gets all of what a neighbour has just stored, from one cache line.
    block_x = left & ~np.int64(vec.LANES - 1)
    block_x_in_box = block_x - box_x
    group_count = (row_count + vec.LANES - 1) // vec.LANES
    # The last group would reach beyond the band where rows may be covered. Above the box none is: move all groups up,
    # but not out of the band.
    prepared_top = max(min(top, end_row - vec.LANES * group_count), first_row)

    edges, tail = _load_edges(triangle), vec.load(f32_at(address(triangle)), vec.LANES)
    inv_z_base, inv_z_dy = _broadcast_lane(tail, _INV_Z_BASE), _broadcast_lane(tail, _INV_Z_DY)
    row_in_box = vec.to_f32(vec.i32(prepared_top - box_y) + vec.iota())
    box_lower, box_upper = vec.f32(left - box_x) - vec.f32(0.5), vec.f32(right - box_x) - vec.f32(0.5)
    blocks_to_7, blocks_from_8 = np.int64(0), np.int64(0)
    for group in range(group_count):
        begin_in_box, covered_count = _covered_columns(edges, row_in_box, box_lower, box_upper)
        vec.store(prepared.row_begin_in_box, vec.LANES * group, begin_in_box)
        vec.store(prepared.row_column_count, vec.LANES * group, covered_count)
        to_7, from_8 = _block_masks(begin_in_box - vec.i32(block_x_in_box), covered_count)
        blocks_to_7 |= to_7 << (_GROUP_SHIFT * group)
        blocks_from_8 |= from_8 << (_GROUP_SHIFT * group)
        vec.store(prepared.row_inv_z, vec.LANES * group, inv_z_base + inv_z_dy * row_in_box)
        row_in_box = row_in_box + vec.f32(float(vec.LANES))

    prepared.blocks_to_7, prepared.blocks_from_8 = blocks_to_7, blocks_from_8
    prepared.first_row = prepared_top
    prepared.row_count = min(end_row - prepared_top, vec.LANES * group_count)
    prepared.first_column, prepared.first_column_in_box = block_x, block_x_in_box
    prepared.id = triangle.id
    vec.store(prepared.tail, 0, tail)


@inlined
def _draw_block(frame, layer, depth_rule, prepared, first, row_count, x_in_blocks):
    """Draw the first ``row_count`` rows of a block of a PREPARED.

    Args:
        first: the block's first row, counted from PREPARED.first_row.
        x_in_blocks: the block's first column, counted from that of the first block.
    """
    tail, ids = prepared.tail, vec.i32(prepared.id)
    inv_z_min, inv_z_max = vec.f32(tail[_INV_Z_MIN]), vec.f32(tail[_INV_Z_MAX])
    columns_in_box = vec.i32(prepared.first_column_in_box + x_in_blocks) + vec.iota()
    column_inv_z = vec.f32(tail[_INV_Z_DX]) * vec.to_f32(columns_in_box)
    row_in_layer = prepared.first_row + first - layer.first_row
    pixel = row_in_layer * frame.stride + prepared.first_column + x_in_blocks
    for k in range(row_count):
        row = first + k
        inv_z = vec.f32(prepared.row_inv_z[row]) + column_inv_z
        inv_z = vec.minimum(vec.maximum(inv_z, inv_z_min), inv_z_max)
        # One comparison of unsigned numbers tells whether a column is in the span.
        column_in_span = columns_in_box - vec.i32(prepared.row_begin_in_box[row])
        covered = vec.less_unsigned(column_in_span, vec.i32(prepared.row_column_count[row]))
        depth_test(frame, layer, depth_rule, pixel + k * frame.stride, inv_z, covered, ids)


@inlined
def draw_small(frame, layer, depth_rule, prepared):
    """Draw a triangle that ``prepare_small`` has prepared; ``depth_rule`` as for ``depth_test``."""
    blocks, x_in_blocks = prepared.blocks_to_7, 0
    for _ in range(1 if prepared.blocks_from_8 == 0 else 2):  # a loop: inlined twice, draw_band would compile longer
        while blocks != 0:
            bit = vec.lowest_bit(blocks)
            blocks &= blocks - 1
            row = bit // vec.LANES * _BLOCK_ROWS
            x = x_in_blocks + bit % vec.LANES * vec.LANES
            _draw_block(frame, layer, depth_rule, prepared, row, min(prepared.row_count - row, _BLOCK_ROWS), x)
        blocks, x_in_blocks = prepared.blocks_from_8, vec.LANES * vec.LANES
