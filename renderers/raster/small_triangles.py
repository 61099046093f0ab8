"""Coverage of small triangles, up to 64 x 128 pixels, in one band.

    1. ``prepare_small``: the span of covered columns in each row, eight rows at a time, one per lane;
    2. the blocks of eight columns and four rows that have any covered pixel;
    3. ``draw_small``: the depth test of these blocks, a row of eight pixels at a time.

          columns  0      7 8     15
                  +--------+--------+
        rows 0..3 |     .##|        |    spans: (6, 2), (5, 4), ..
                  |    .###|#       |    blocks: 0 and 1 of the upper row of blocks, 1 of the lower one
                  +--------+--------+
        rows 4..7 |        |###     |
                  +--------+--------+

In a row, each of the three edge functions is e + c de at column c, counted from the box's first: it *limits* the
covered columns on one side, at -e / de. Spans are such quotients in float32, yet exact:

- e >> 8 has the sign of e. Edge functions change by multiples of 256 per column and row, so that e >> 8 changes by
  exactly change >> 8. It is an integer below 2^23, and its changes are at most 129 x 256 (128 rows of centres lie in
  fewer than 129 pixels): exact in float32. That also holds in the up to seven rows above and below the box that
  groups of eight rows add: 2 x 256^2 x 65 x 136 < 2^31.
- With a half added, value = (e >> 8) + 1/2 is never 0. With dx = de >> 8, column c is inside where value + c dx > 0.
  A horizontal edge, dx = 0, covers all columns of a row or none: its limit is -inf or +inf.
- The limit of other edges is the quotient q = -value / dx. It differs from every integer by at least (1/2) / |dx| >
  15.1e-6. It is computed as value * (-1 / dx), with two roundings of 2^-24 each: within the box, where |q| <= 64, the
  error is at most 64 x 2^-23 < 7.7e-6. Farther out it stays beyond the box.
- The first column inside a lower limit is floor(q + 1), the end at an upper one too. The computed q is more than
  7.4e-6 away from integers, and the sum, below 128, is rounded by at most 2^-18 < 3.9e-6: floor does not change.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import F32, I32, I64, Pointer, i64
from renderers.compiler.pointers import address, i32_at
from renderers.compiler.simd import F32x8, F32x8x2, F32x8x3, I32x8, I32x8x2
from renderers.compiler.structs import Struct, inline
from renderers.raster.depth_test import depth_test
from renderers.raster.layout import (
    MAX_SMALL_WIDTH,
    SMALL_FIELDS,
    SUBPIXEL_BITS,
    Layer,
    RasterFrame,
    SmallTriangle,
    box_of,
)
from renderers.visibility_buffer import BAND_ROWS

_BLOCK_ROWS: Final = 4
_GROUP_ROWS: Final = vec.LANES
"""Rows whose spans are found at a time: two rows of blocks."""
_GROUP_BITS: Final = 2 * vec.LANES
"""Bits of a group in PreparedTriangle.blocks. Four groups are a band."""
_COLUMN_BITS: Final = vec.LANES.bit_length() - 1
"""``column >> _COLUMN_BITS`` is the block of a column."""
assert MAX_SMALL_WIDTH // vec.LANES < 2 * vec.LANES  # the masks have 16 blocks in a row
assert BAND_ROWS == 4 * _GROUP_ROWS
# Two vectors have all fields of a SmallTriangle: the first ends with ``kind``, the second begins with ``edge1_dy``.
assert (SMALL_FIELDS.kind, SMALL_FIELDS.edge1_dy) == (vec.LANES - 1, vec.LANES)


class PreparedTriangle(Struct):
    """A small triangle within a band, from ``prepare_small`` for ``draw_small``."""

    triangle: SmallTriangle
    row_inv_z: Pointer[F32] = inline(BAND_ROWS)  # of each row: 1/z at the box's first column
    row_begin_in_box: Pointer[I32] = inline(BAND_ROWS)  # first covered column, counted from the box's first
    row_column_count: Pointer[I32] = inline(BAND_ROWS)  # number of covered columns
    # Masks of the blocks with any covered column. Bit 8 r + b of the first is block b (from the left, 0 .. 7) of
    # block row r, which is four rows; bit 8 r + b of the second is block 8 + b of it. The second one is needed
    # since a box that is not aligned has up to nine blocks in a row.
    blocks: Pointer[I64] = inline(2)
    first_row: I64  # row of the image
    row_count: I64  # within the band
    first_column: I64  # of the first block; column of the image
    first_column_in_box: I64  # the same, counted from the box's first column: perhaps negative


class _RowEdges(NamedTuple):
    """Three edge functions, and how they limit the columns of a row; the same in all lanes."""

    base: F32x8x3
    """At row and column 0 of the box, plus a half."""
    dy: F32x8x3
    """Change per row."""
    lower_scale: F32x8x3
    """-1 over the change per column, or NaN, which limits nothing. An edge limits columns either below or above."""
    upper_scale: F32x8x3


@inlined
def prepare_small(
    frame: RasterFrame, triangle: SmallTriangle, first_row: I64, end_row: I64, prepared: PreparedTriangle
) -> None:
    """Find the spans and blocks of a triangle in at most BAND_ROWS rows of the image, for ``draw_small``."""
    # The box, cut to band and image.
    box_x, box_y, box_column_count, box_row_count = box_of(triangle)
    top, bottom = max(box_y, first_row), min(box_y + box_row_count, end_row)
    left, right = max(box_x, i64(0)), min(box_x + box_column_count, frame.width)
    # Blocks begin where vectors do: a load gets all of what the triangle before has just stored, from one cache line.
    block_x = left & ~i64(vec.LANES - 1)
    block_x_in_box = block_x - box_x
    group_count = (bottom - top + _GROUP_ROWS - 1) // _GROUP_ROWS
    groups_top = _first_row_of_groups(top, end_row, group_count, first_row)

    # Spans, 1/z and blocks of eight rows at a time. Rows may lie beyond the box: no column is covered there.
    edges = _load_edges(triangle)
    inv_z_base, inv_z_dy = vec.f32(triangle.inv_z_base), vec.f32(triangle.inv_z_dy)
    row_in_box = vec.to_f32(vec.i32(groups_top - box_y) + vec.iota())
    box_lower, box_upper = vec.f32(left - box_x) - vec.f32(0.5), vec.f32(right - box_x) - vec.f32(0.5)
    low_blocks, high_blocks = i64(0), i64(0)
    for group in range(group_count):
        begin_in_box, column_count = _covered_columns(edges, row_in_box, box_lower, box_upper)
        vec.store(prepared.row_begin_in_box, _GROUP_ROWS * group, begin_in_box)
        vec.store(prepared.row_column_count, _GROUP_ROWS * group, column_count)
        low, high = _block_masks(begin_in_box - vec.i32(block_x_in_box), column_count)
        low_blocks |= low << (_GROUP_BITS * group)
        high_blocks |= high << (_GROUP_BITS * group)
        vec.store(prepared.row_inv_z, _GROUP_ROWS * group, inv_z_base + inv_z_dy * row_in_box)
        row_in_box = row_in_box + vec.f32(float(_GROUP_ROWS))

    prepared.triangle = triangle
    prepared.blocks[0], prepared.blocks[1] = low_blocks, high_blocks
    prepared.first_row = groups_top
    prepared.row_count = min(end_row - groups_top, _GROUP_ROWS * group_count)
    prepared.first_column, prepared.first_column_in_box = block_x, block_x_in_box


@inlined
def draw_small(frame: RasterFrame, layer: Layer, depth_rule: I64, prepared: PreparedTriangle) -> None:
    """Draw a triangle that ``prepare_small`` has prepared; ``depth_rule`` as for ``depth_test``.

    The trip count of a loop over columns could not be predicted for small triangles. Therefore one loop goes over the
    set bits of a mask of blocks. About half of a box is never tested.
    """
    # Both masks in one loop: with a copy of its body for each, draw_band would take longer to compile.
    for mask_index in range(1 if prepared.blocks[1] == 0 else 2):
        blocks = prepared.blocks[mask_index]
        while blocks != 0:
            bit = vec.lowest_bit(blocks)
            blocks &= blocks - 1
            block_row, block = bit // vec.LANES, mask_index * vec.LANES + bit % vec.LANES
            _draw_block(frame, layer, depth_rule, prepared, block_row * _BLOCK_ROWS, block * vec.LANES)


@inlined
def _first_row_of_groups(top: I64, end_row: I64, group_count: I64, first_row: I64) -> I64:
    """Return the row of the image with which the groups of eight rows begin, of a triangle from row ``top`` on.

    The last group may end below the band, where the triangle may go on. Blocks of those rows would be tested although
    they are the next band's. So the groups start as many rows higher, where nothing is covered::

        row  0   the band begins
        row 16   the groups begin: 16 .. 24 and 24 .. 32
        row 18   the triangle begins; groups from here on would be 18 .. 26 and 26 .. 34
        row 32   the next band begins, and the triangle goes on

    They do not start above the band. In a band of fewer rows than the groups, ``draw_small`` skips the rest.
    """
    return max(min(top, end_row - _GROUP_ROWS * group_count), first_row)


@inlined
def _load_edges(triangle: SmallTriangle) -> _RowEdges:
    """Return the edge functions of a triangle, in all lanes.

    All fields by two loads: a third of the instructions of one for each. The lanes of other fields, which are shifted
    and converted too, are not used.
    """
    values, bits = i32_at(address(triangle)), vec.i32(SUBPIXEL_BITS)
    first, second = vec.to_f32(vec.load(values, 0) >> bits), vec.to_f32(vec.load(values, vec.LANES) >> bits)
    e0, e1 = _broadcast_lane(first, SMALL_FIELDS.edges), _broadcast_lane(first, SMALL_FIELDS.edges + 1)
    e2 = _broadcast_lane(first, SMALL_FIELDS.edges + 2)
    e0_dx, e1_dx = _broadcast_lane(first, SMALL_FIELDS.edge_dx), _broadcast_lane(first, SMALL_FIELDS.edge_dx + 1)
    e0_dy = _broadcast_lane(first, SMALL_FIELDS.edge0_dy)
    e1_dy = _broadcast_lane(second, SMALL_FIELDS.edge1_dy - vec.LANES)
    half, zero, no_limit = vec.f32(0.5), vec.f32(0.0), vec.f32(math.nan)
    e2_dx, e2_dy = zero - e0_dx - e1_dx, zero - e0_dy - e1_dy
    # One division for all three edges, in lanes 0 to 2.
    lane = vec.iota()
    edge_dx = vec.select(lane == vec.i32(0), e0_dx, vec.select(lane == vec.i32(1), e1_dx, e2_dx))
    scale = vec.f32(-1.0) / edge_dx
    # The scale of a horizontal edge is -inf: its lower limit is -inf where value > 0, and +inf, no column, elsewhere.
    # NaN on the other side limits nothing, see _limit_by_edge.
    lower = vec.select(edge_dx >= zero, scale, no_limit)
    upper = vec.select(edge_dx >= zero, no_limit, scale)
    return _RowEdges(
        base=(e0 + half, e1 + half, e2 + half),
        dy=(e0_dy, e1_dy, e2_dy),
        lower_scale=(_broadcast_lane(lower, 0), _broadcast_lane(lower, 1), _broadcast_lane(lower, 2)),
        upper_scale=(_broadcast_lane(upper, 0), _broadcast_lane(upper, 1), _broadcast_lane(upper, 2)),
    )


@inlined
def _broadcast_lane(vector: F32x8, k: I64) -> F32x8:
    """Return lane ``k`` in all lanes."""
    return vec.f32(vec.lane(vector, k))


@inlined
def _covered_columns(edges: _RowEdges, row_in_box: F32x8, box_lower: F32x8, box_upper: F32x8) -> I32x8x2:
    """Return the first covered column, counted from the box's first, and their number in each of eight rows.

    Column c is covered if lower < c < upper. So the first one is floor(lower + 1), the end floor(upper + 1).

    Args:
        row_in_box: counted from the box's first row.
        box_lower, box_upper: limits by box and image, integers minus a half, counted from the box's first column.
    """
    one = vec.f32(1.0)
    lower, upper = _limit_by_edge(box_lower, box_upper, edges, 0, row_in_box)
    lower, upper = _limit_by_edge(lower, upper, edges, 1, row_in_box)
    lower, upper = _limit_by_edge(lower, upper, edges, 2, row_in_box)
    # A nearly horizontal edge may limit a row anywhere: minimum and maximum keep its limits within int32. to_i32 is
    # floor of what is not negative.
    begin = vec.to_i32(vec.minimum(lower, box_upper) + one)
    end = vec.to_i32(vec.maximum(upper + one, vec.f32(0.0)))
    return begin, vec.maximum(end - begin, vec.i32(0))


@inlined
def _limit_by_edge(lower: F32x8, upper: F32x8, edges: _RowEdges, k: I64, row_in_box: F32x8) -> F32x8x2:
    """Return the column limits of eight rows, narrowed to the inner side of edge ``k``."""
    edge_value = edges.base[k] + edges.dy[k] * row_in_box
    # NaN limits nothing: if either argument is NaN, minimum and maximum return the second one.
    lower = vec.maximum(edge_value * edges.lower_scale[k], lower)
    return lower, vec.minimum(edge_value * edges.upper_scale[k], upper)


@inlined
def _block_masks(begin: I32x8, column_count: I32x8) -> tuple[I64, I64]:
    """Return the two masks, as PreparedTriangle.blocks, of the blocks of eight rows with any covered column.

    Args:
        begin, column_count: the rows' first covered columns, counted from the first block's first, and their number.
    """
    column_bits, none = vec.i32(_COLUMN_BITS), vec.i32(0)
    end = begin + column_count + vec.i32(vec.LANES - 1)
    blocks = (vec.i32(1) << (end >> column_bits)) - (vec.i32(1) << (begin >> column_bits))
    blocks = vec.select(column_count > none, blocks, none)
    # The eight rows are two block rows, top and bottom, of 16 bits each. The first mask gets their blocks 0 .. 7, the
    # low bytes: bottom in bits 8 .. 15, top in bits 0 .. 7. The second one gets the high bytes, in the same places.
    is_top = vec.iota() < vec.i32(_BLOCK_ROWS)
    top, bottom = vec.or_of(vec.select(is_top, blocks, none)), vec.or_of(vec.select(is_top, none, blocks))
    return (top & 255) | ((bottom & 255) << vec.LANES), (top >> vec.LANES) | ((bottom >> vec.LANES) << vec.LANES)


@inlined
def _draw_block(
    frame: RasterFrame, layer: Layer, depth_rule: I64, prepared: PreparedTriangle, first_row: I64, first_column: I64
) -> None:
    """Draw a block, whose first row and column are counted from those of a PreparedTriangle."""
    triangle = prepared.triangle
    inv_z_min, inv_z_max, ids = vec.f32(triangle.inv_z_min), vec.f32(triangle.inv_z_max), vec.i32(triangle.id)
    columns_in_box = vec.i32(prepared.first_column_in_box + first_column) + vec.iota()
    column_inv_z = vec.f32(triangle.inv_z_dx) * vec.to_f32(columns_in_box)
    row_in_layer = prepared.first_row + first_row - layer.first_row
    pixel = row_in_layer * frame.stride + prepared.first_column + first_column
    for row in range(first_row, min(first_row + _BLOCK_ROWS, prepared.row_count)):
        inv_z = vec.f32(prepared.row_inv_z[row]) + column_inv_z
        inv_z = vec.minimum(vec.maximum(inv_z, inv_z_min), inv_z_max)
        # One comparison of unsigned numbers tells whether a column is in the span.
        column_in_span = columns_in_box - vec.i32(prepared.row_begin_in_box[row])
        covered = vec.less_unsigned(column_in_span, vec.i32(prepared.row_column_count[row]))
        depth_test(frame, layer, depth_rule, pixel, inv_z, covered, ids)
        pixel += frame.stride
