"""Coverage of small triangles: find each row's span of covered columns, then draw its blocks.

A block has eight columns and four rows. It is drawn if any of its pixels is covered.

A pixel is covered where all edge functions are at least 0. They are linear, so that an edge limits a row's columns by a
quotient. Divided by 256 and rounded down, which keeps their sign, the functions are integers below 2^23 and their
steps integers of at most 2^15: exact in float32, also with a half added to the functions, which keeps the sign. Then no
quotient is nearer to a column than half of 2^-15. Within MAX_SMALL_WIDTH, the product of a value and a reciprocal
differs from the quotient by at most 72 x 2^-23, which is less, so that both are on the same side of every column.

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
from renderers.raster.layout import MAX_SMALL_WIDTH
from renderers.visibility_buffer import BAND_ROWS

_BLOCK_ROWS: Final = 4
_MAX_ROWS: Final = BAND_ROWS + vec.LANES

PREPARED: Final = Struct(
    "PreparedTriangle",
    {
        "row_inv_z": array_of(F32, _MAX_ROWS),  # 1/z at the box's first column
        "row_first_column": array_of(I32, _MAX_ROWS),  # first covered column, counted from the box's first
        "row_column_count": array_of(I32, _MAX_ROWS),  # number of covered columns
        "blocks": I64,  # mask of blocks with any covered column: for each four rows, the first eight blocks
        "ninth_blocks": I64,  # the same of the ninth block
        "first_row": I64,
        "rows": I64,  # within the band
        "first_column": I64,  # of the first block
        "first_column_in_box": I64,  # the same, counted from the box's first column
        "id": I64,
        "plane": array_of(F32, vec.LANES),  # the last eight values of the SMALL_TRIANGLE
    },
)
"""A small triangle within a band, from ``prepare_small`` for ``draw_small``."""
# Indices into the last eight values of a SMALL_TRIANGLE.
_INV_Z_DX: Final = 4
_INV_Z_MIN: Final = 6
_INV_Z_MAX: Final = 7
assert MAX_SMALL_WIDTH // vec.LANES < 16


@inlined
def box_of(triangle):
    """Return first column, first row, columns and rows of a SMALL_TRIANGLE's box."""
    corner, size = np.int64(triangle.box_corner), np.int64(triangle.box_size)
    return ((corner & 0xFFFF) ^ 0x8000) - 0x8000, corner >> 16, size & 0xFFFF, size >> 16


class _RowEdges(NamedTuple):
    """Three edge functions, and how they limit the columns of a row; a tuple of three f32x8 each, in all lanes."""

    first: Any
    """At row and column 0, plus a half."""
    dy: Any
    """Change per row."""
    lower_scale: Any
    """-1 over the change per column, or NaN, which limits nothing. An edge limits columns either below or above."""
    upper_scale: Any


@inlined
def _load_edges(triangle):
    """Return the _RowEdges of a SMALL_TRIANGLE."""
    # All fields by two loads: a third of the instructions of one for each.
    values = i32_at(address(triangle))
    fields = vec.to_f32(vec.load(values, 0) >> vec.i32(8))
    half, zero, no_limit = vec.f32(0.5), vec.f32(0.0), vec.f32(math.nan)
    e0, e1, e2 = vec.f32(vec.lane(fields, 0)), vec.f32(vec.lane(fields, 1)), vec.f32(vec.lane(fields, 2))
    e0_dx, e1_dx, e0_dy = vec.f32(vec.lane(fields, 3)), vec.f32(vec.lane(fields, 4)), vec.f32(vec.lane(fields, 5))
    e1_dy = vec.f32(vec.lane(vec.to_f32(vec.load(values, vec.LANES) >> vec.i32(8)), 0))
    e2_dx, e2_dy = zero - e0_dx - e1_dx, zero - e0_dy - e1_dy
    # Lanes 0 to 2: the changes per column.
    lane = vec.iota()
    edge_dx = vec.select(lane == vec.i32(0), e0_dx, vec.select(lane == vec.i32(1), e1_dx, e2_dx))
    scale = vec.f32(-1.0) / edge_dx
    # A horizontal edge holds for all of a row or for nothing: an infinite lower limit.
    lower = vec.select(edge_dx >= zero, scale, no_limit)
    upper = vec.select(edge_dx >= zero, no_limit, scale)
    return _RowEdges(
        first=(e0 + half, e1 + half, e2 + half),
        dy=(e0_dy, e1_dy, e2_dy),
        lower_scale=(vec.f32(vec.lane(lower, 0)), vec.f32(vec.lane(lower, 1)), vec.f32(vec.lane(lower, 2))),
        upper_scale=(vec.f32(vec.lane(upper, 0)), vec.f32(vec.lane(upper, 1)), vec.f32(vec.lane(upper, 2))),
    )


@inlined
def _covered_columns(edges, row, lower, upper):
    """Return the first covered column of eight rows and the number of covered columns, i32x8 each.

    Args:
        edges: a _RowEdges.
        row: f32x8, counted from the box's first row.
        lower, upper: f32x8: limits of the columns by the box and the image, minus a half.
    """
    box_upper, one = upper, vec.f32(1.0)
    lower, upper = _limit_by_edge(lower, upper, edges, 0, row)
    lower, upper = _limit_by_edge(lower, upper, edges, 1, row)
    lower, upper = _limit_by_edge(lower, upper, edges, 2, row)
    # A nearly horizontal edge may limit a row anywhere. No limit is an integer, nor (see above) nearer to one than
    # 6e-6 where it counts; a sum below 128 is at most 4e-6 off.
    first_column = vec.to_i32(vec.minimum(lower, box_upper) + one)
    end_column = vec.to_i32(vec.maximum(upper + one, vec.f32(0.0)))
    return first_column, vec.maximum(end_column - first_column, vec.i32(0))


@inlined
def _limit_by_edge(lower, upper, edges, k, row):
    """Narrow the column limits of eight rows to the inner side of edge ``k`` of a _RowEdges; all f32x8."""
    value = edges.first[k] + edges.dy[k] * row
    return vec.maximum(value * edges.lower_scale[k], lower), vec.minimum(value * edges.upper_scale[k], upper)


@inlined
def _block_masks(first_column, column_count):
    """Return the blocks of eight rows in which any column is covered, eight bits for each four rows, and the same of
    the ninth block; int64.

    Args:
        first_column, column_count: i32x8: the rows' first columns, counted from the first block's, and their number.
    """
    one, end = vec.i32(1), first_column + column_count + vec.i32(vec.LANES - 1)
    blocks = (one << (end >> vec.i32(3))) - (one << (first_column >> vec.i32(3)))
    blocks = vec.select(column_count > vec.i32(0), blocks, vec.i32(0))
    is_upper, none = vec.iota() < vec.i32(_BLOCK_ROWS), vec.i32(0)
    upper, lower = vec.or_of(vec.select(is_upper, blocks, none)), vec.or_of(vec.select(is_upper, none, blocks))
    return (upper & 255) | ((lower & 255) << 8), (upper >> 8) | ((lower >> 8) << 8)


@inlined
def prepare_small(frame, triangle, first_row, end_row, prepared):
    """Find the spans and blocks of a small triangle in some rows, for ``draw_small``.

    Args:
        triangle: a SMALL_TRIANGLE.
        prepared: a PREPARED.
    """
    box_x, box_y, box_columns, box_rows = box_of(triangle)
    top = max(box_y, first_row)
    rows = min(box_y + box_rows, end_row) - top
    left = max(box_x, np.int64(0))
    right = min(box_x + box_columns, frame.width)
    # Blocks begin where vectors do: a load gets all of what a neighbour has just stored, from one cache line.
    block_x = left & ~np.int64(vec.LANES - 1)
    block_x_in_box = block_x - box_x
    groups = (rows + vec.LANES - 1) >> 3
    prepared_top = max(min(top, end_row - vec.LANES * groups), first_row)

    edges = _load_edges(triangle)
    plane = vec.load(f32_at(address(triangle)), vec.LANES)
    inv_z_base, inv_z_dy = vec.f32(vec.lane(plane, 3)), vec.f32(vec.lane(plane, 5))
    row = vec.to_f32(vec.i32(prepared_top - box_y) + vec.iota())
    box_lower, box_upper = vec.f32(left - box_x) - vec.f32(0.5), vec.f32(right - box_x) - vec.f32(0.5)
    blocks, ninth_blocks = np.int64(0), np.int64(0)
    for group in range(groups):
        first_column, column_count = _covered_columns(edges, row, box_lower, box_upper)
        vec.store(prepared.row_first_column, vec.LANES * group, first_column)
        vec.store(prepared.row_column_count, vec.LANES * group, column_count)
        group_blocks, group_ninth = _block_masks(first_column - vec.i32(block_x_in_box), column_count)
        blocks |= group_blocks << (16 * group)
        ninth_blocks |= group_ninth << (16 * group)
        vec.store(prepared.row_inv_z, vec.LANES * group, inv_z_base + inv_z_dy * row)
        row = row + vec.f32(float(vec.LANES))

    prepared.blocks, prepared.ninth_blocks = blocks, ninth_blocks
    prepared.first_row = prepared_top
    prepared.rows = min(end_row - prepared_top, vec.LANES * groups)
    prepared.first_column, prepared.first_column_in_box = block_x, block_x_in_box
    prepared.id = triangle.id
    vec.store(prepared.plane, 0, plane)


@inlined
def _draw_block(frame, layer, depth_rule, prepared, first_row, row_count, block_x):
    """Draw the first ``row_count`` rows of a block.

    Args:
        first_row: counted from the first prepared row.
        block_x: the block's first column, counted from the first block's.
    """
    plane, ids = prepared.plane, vec.i32(prepared.id)
    inv_z_min, inv_z_max = vec.f32(plane[_INV_Z_MIN]), vec.f32(plane[_INV_Z_MAX])
    columns = vec.i32(prepared.first_column_in_box + block_x) + vec.iota()
    column_inv_z = vec.f32(plane[_INV_Z_DX]) * vec.to_f32(columns)
    row_in_layer = prepared.first_row + first_row - layer.first_row
    pixel = row_in_layer * frame.stride + prepared.first_column + block_x
    for k in range(row_count):
        row = first_row + k
        inv_z = vec.f32(prepared.row_inv_z[row]) + column_inv_z
        inv_z = vec.minimum(vec.maximum(inv_z, inv_z_min), inv_z_max)
        # One comparison of unsigned numbers tells whether a column is in the span.
        column_in_span = columns - vec.i32(prepared.row_first_column[row])
        covered = vec.less_unsigned(column_in_span, vec.i32(prepared.row_column_count[row]))
        depth_test(frame, layer, depth_rule, pixel + k * frame.stride, inv_z, covered, ids)


@inlined
def draw_small(frame, layer, depth_rule, prepared):
    """Draw a triangle that ``prepare_small`` has prepared; ``depth_rule`` as for ``depth_test``."""
    blocks, rows = prepared.blocks, prepared.rows
    first_block_x = 0
    for _ in range(1 if prepared.ninth_blocks == 0 else 2):
        while blocks != 0:
            bit = vec.lowest_bit(blocks)
            blocks &= blocks - 1
            row = (bit >> 3) * _BLOCK_ROWS
            block_x = first_block_x + (bit & 7) * vec.LANES
            _draw_block(frame, layer, depth_rule, prepared, row, min(rows - row, _BLOCK_ROWS), block_x)
        blocks = prepared.ninth_blocks
        first_block_x = vec.LANES * vec.LANES
