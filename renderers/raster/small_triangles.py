"""Coverage of small triangles, up to 64 x 128 pixels, in one band.

    1. ``find_small_spans`` finds the span of covered columns in each row, eight rows at a time, one per lane; and the
       blocks of eight columns and four rows that have any covered pixel.
    2. ``draw_small`` makes the depth test in these blocks, a row of eight pixels at a time.

          columns  0      7 8     15
                  +--------+--------+
        rows 0..3 |      ##|        |    spans: 2 columns from column 6 on, 4 from column 5 on, ...
                  |     ###|#       |    blocks: 0 and 1 of the first block row, 1 of the second
                  +--------+--------+
        rows 4..7 |        |###     |
                  +--------+--------+

In a row, the edge function of each of the three edges has the value ``edge + c edge_dx`` at column c, counted from the
first column of the triangle's box. A pixel is inside where none of the three is negative: where its
centre lies on an edge, the top-left rule of ``triangle_geometry`` has decided by the sign.

A pixel is 256 grid units wide, so that edge_dx is a multiple of 256, and edge can be divided by 256 without a change of
sign: with scaled_edge = (edge >> 8) + 1/2 and scaled_dx = edge_dx >> 8, column c is inside where scaled_edge +
c scaled_dx > 0. The 1/2 keeps this sum from being 0. So each edge limits the span on one side, at q = -scaled_edge /
scaled_dx. The first column right of q is floor(q + 1). It is the first covered column if the edge is on the left, and
the column after the last covered one if it is on the right. ``_limit_by_edge`` says why float32 is exact here.
"""

import math
from typing import Final, NamedTuple

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import F32, I32, I64, Pointer, i64
from renderers.compiler.pointers import address, i32_at
from renderers.compiler.simd import F32x8, F32x8x2, F32x8x3, I32x8, I32x8x2
from renderers.compiler.structs import Struct, inline
from renderers.raster.depth_test import depth_test
from renderers.raster.grid import box_of
from renderers.raster.layout import MAX_SMALL_WIDTH, SMALL_FIELD_INDEX, SUBPIXEL_BITS, Layer, RasterFrame, SmallTriangle
from renderers.visibility_buffer import BAND_ROWS

_BLOCK_ROWS: Final = 4
_GROUP_ROWS: Final = vec.LANES
"""Rows whose spans are found at a time: two rows of blocks."""
_BITS_PER_BLOCK_ROW: Final = 8
"""Bits of one block row in a mask of SmallTriangleSpans.block_masks: a byte, for eight blocks."""
_BITS_PER_GROUP: Final = 2 * _BITS_PER_BLOCK_ROW
"""Bits of a group's two block rows in a mask. Four groups are a band."""
_LOG2_BLOCK_COLUMNS: Final = vec.LANES.bit_length() - 1
"""``column >> _LOG2_BLOCK_COLUMNS`` is the block of a column."""
# A box that does not begin at a multiple of eight touches one block more than 64 / 8. Two masks have bits for 16.
assert MAX_SMALL_WIDTH // vec.LANES + 1 <= 2 * _BITS_PER_BLOCK_ROW
assert BAND_ROWS == 4 * _GROUP_ROWS
# Two vectors have all fields of a SmallTriangle: the first ends with ``kind``, the second begins with ``edge1_dy``.
assert (SMALL_FIELD_INDEX.kind, SMALL_FIELD_INDEX.edge1_dy) == (vec.LANES - 1, vec.LANES)


class SmallTriangleSpans(Struct):
    """A small triangle within a band, from ``find_small_spans`` for ``draw_small``."""

    triangle: SmallTriangle
    row_inv_z: Pointer[F32] = inline(BAND_ROWS)  # of each row: 1/z at the box's first column
    span_begin_in_box: Pointer[I32] = inline(BAND_ROWS)  # of each row: first covered column, from the box's first on
    span_length: Pointer[I32] = inline(BAND_ROWS)  # of each row: number of covered columns
    # Masks of the blocks with any covered column. Byte r belongs to block row r: its bit k to block k from the left in
    # the first mask, and to block 8 + k in the second one.
    block_masks: Pointer[I64] = inline(2)
    top: I64  # first row of the first group, in the image
    row_count: I64  # number of the groups' rows that are in the band
    aligned_left: I64  # first column of the first block, in the image: a multiple of eight
    aligned_left_in_box: I64  # the same, counted from the box's first column: perhaps negative


class _ScaledEdges(NamedTuple):
    """The three scaled edge functions, and the factors that make column limits of them; in all lanes alike."""

    base: F32x8x3
    """``scaled_edge`` in row 0 of the box."""
    dy: F32x8x3
    """Change per row."""
    left_factor: F32x8x3
    """-1 / scaled_dx for edges that limit columns on the left; NaN, which limits nothing, for others."""
    right_factor: F32x8x3
    """The same for edges on the right."""


@inlined
def find_small_spans(
    frame: RasterFrame, triangle: SmallTriangle, first_row: I64, end_row: I64, spans: SmallTriangleSpans
) -> None:
    """Find the spans and blocks of a triangle in at most BAND_ROWS rows of the image, for ``draw_small``."""
    # The box, cut to band and image.
    box_left, box_top, box_right, box_bottom = box_of(triangle)
    top, bottom = max(box_top, first_row), min(box_bottom, end_row)
    left, right = max(box_left, i64(0)), min(box_right, frame.width)
    # With blocks at multiples of eight pixels, no vector crosses a cache line, and each load reads what one earlier
    # store has written, which processors forward without waiting for the cache.
    aligned_left = left & ~i64(vec.LANES - 1)
    aligned_left_in_box = aligned_left - box_left
    group_count = (bottom - top + _GROUP_ROWS - 1) // _GROUP_ROWS

    # Spans, 1/z and blocks of eight rows at a time. In rows below the box, no column is covered; rows below the band
    # are not drawn.
    edges = _load_edges(triangle)
    inv_z_base, inv_z_dy = vec.f32(triangle.inv_z_base), vec.f32(triangle.inv_z_dy)
    rows_in_box = vec.to_f32(vec.i32(top - box_top) + vec.iota())
    # Limits lie between columns: those right of the left limit and left of the right one are covered.
    box_left_limit, box_right_limit = vec.f32(left - box_left) - vec.f32(0.5), vec.f32(right - box_left) - vec.f32(0.5)
    blocks_0_to_7, block_8 = i64(0), i64(0)
    for group in range(group_count):
        begin_in_box, column_count = _covered_columns(edges, rows_in_box, box_left_limit, box_right_limit)
        vec.store(spans.span_begin_in_box, _GROUP_ROWS * group, begin_in_box)
        vec.store(spans.span_length, _GROUP_ROWS * group, column_count)
        group_masks = _block_masks(begin_in_box - vec.i32(aligned_left_in_box), column_count)
        blocks_0_to_7 |= group_masks[0] << (_BITS_PER_GROUP * group)
        block_8 |= group_masks[1] << (_BITS_PER_GROUP * group)
        vec.store(spans.row_inv_z, _GROUP_ROWS * group, inv_z_base + inv_z_dy * rows_in_box)
        rows_in_box = rows_in_box + vec.f32(float(_GROUP_ROWS))

    spans.triangle = triangle
    spans.block_masks[0], spans.block_masks[1] = blocks_0_to_7, block_8
    spans.top = top
    spans.row_count = min(end_row - top, _GROUP_ROWS * group_count)
    spans.aligned_left, spans.aligned_left_in_box = aligned_left, aligned_left_in_box


@inlined
def draw_small(frame: RasterFrame, layer: Layer, depth_rule: I64, spans: SmallTriangleSpans) -> None:
    """Draw a triangle with the spans of ``find_small_spans``; ``depth_rule`` as for ``depth_test``.

    The loop over the set bits of a mask skips blocks without a covered pixel, about half of a box. A processor
    mispredicts its end once per triangle. It would mispredict the ends of loops over the columns once per row.
    """
    # Both masks in one loop: with a copy of its body for each, draw_band would take longer to compile.
    for mask_index in range(1 if spans.block_masks[1] == 0 else 2):
        blocks = spans.block_masks[mask_index]
        while blocks != 0:
            bit = vec.lowest_bit(blocks)
            blocks &= blocks - 1
            block_row = bit // _BITS_PER_BLOCK_ROW
            block = mask_index * _BITS_PER_BLOCK_ROW + bit % _BITS_PER_BLOCK_ROW
            _draw_block(frame, layer, depth_rule, spans, block_row, block)


@inlined
def _draw_block(
    frame: RasterFrame, layer: Layer, depth_rule: I64, spans: SmallTriangleSpans, block_row: I64, block: I64
) -> None:
    """Draw a block of a block row; both are counted from the first one, at ``top`` and ``aligned_left``."""
    block_top, block_left = block_row * _BLOCK_ROWS, block * vec.LANES
    triangle = spans.triangle
    inv_z_min, inv_z_max, ids = vec.f32(triangle.inv_z_min), vec.f32(triangle.inv_z_max), vec.i32(triangle.id)
    columns_in_box = vec.i32(spans.aligned_left_in_box + block_left) + vec.iota()
    inv_z_from_box_left = vec.f32(triangle.inv_z_dx) * vec.to_f32(columns_in_box)
    row_in_layer = spans.top + block_top - layer.first_row
    pixel = row_in_layer * frame.stride + spans.aligned_left + block_left
    for row in range(block_top, min(block_top + _BLOCK_ROWS, spans.row_count)):
        inv_z = vec.f32(spans.row_inv_z[row]) + inv_z_from_box_left
        inv_z = vec.minimum(vec.maximum(inv_z, inv_z_min), inv_z_max)
        # Unsigned, columns before the span are large numbers: one comparison tests both ends.
        column_in_span = columns_in_box - vec.i32(spans.span_begin_in_box[row])
        covered = vec.less_unsigned(column_in_span, vec.i32(spans.span_length[row]))
        depth_test(frame, layer, depth_rule, pixel, inv_z, covered, ids)
        pixel += frame.stride


@inlined
def _load_edges(triangle: SmallTriangle) -> _ScaledEdges:
    """Return the edge functions of a triangle, in all lanes.

    Two vector loads take a third of the instructions that a load of each field would. Fields that are no edge functions
    are shifted and converted with them, and not used.
    """
    words, shift = i32_at(address(triangle)), vec.i32(SUBPIXEL_BITS)
    first, second = vec.to_f32(vec.load(words, 0) >> shift), vec.to_f32(vec.load(words, vec.LANES) >> shift)
    base0 = _broadcast_lane(first, SMALL_FIELD_INDEX.edge_base)
    base1 = _broadcast_lane(first, SMALL_FIELD_INDEX.edge_base + 1)
    base2 = _broadcast_lane(first, SMALL_FIELD_INDEX.edge_base + 2)
    dx0, dx1 = _broadcast_lane(first, SMALL_FIELD_INDEX.edge_dx), _broadcast_lane(first, SMALL_FIELD_INDEX.edge_dx + 1)
    dy0 = _broadcast_lane(first, SMALL_FIELD_INDEX.edge0_dy)
    dy1 = _broadcast_lane(second, SMALL_FIELD_INDEX.edge1_dy - vec.LANES)
    half, zero, no_limit = vec.f32(0.5), vec.f32(0.0), vec.f32(math.nan)
    dx2, dy2 = zero - dx0 - dx1, zero - dy0 - dy1
    # One division for all three edges, in lanes 0 to 2.
    lane = vec.iota()
    scaled_dx = vec.select(lane == vec.i32(0), dx0, vec.select(lane == vec.i32(1), dx1, dx2))
    factor = vec.f32(-1.0) / scaled_dx
    # A positive scaled_dx limits columns on the left, a negative one on the right. A horizontal edge has 0, and so the
    # factor -inf, on the left. Times a positive scaled_edge it is -inf: all columns are inside. Times a negative one it
    # is +inf: none is. That needs +0: dx2 = 0 - dx0 - dx1 is never -0.
    left = vec.select(scaled_dx >= zero, factor, no_limit)
    right = vec.select(scaled_dx >= zero, no_limit, factor)
    return _ScaledEdges(
        base=(base0 + half, base1 + half, base2 + half),
        dy=(dy0, dy1, dy2),
        left_factor=(_broadcast_lane(left, 0), _broadcast_lane(left, 1), _broadcast_lane(left, 2)),
        right_factor=(_broadcast_lane(right, 0), _broadcast_lane(right, 1), _broadcast_lane(right, 2)),
    )


@inlined
def _broadcast_lane(vector: F32x8, k: I64) -> F32x8:
    """Return lane ``k`` in all lanes."""
    return vec.f32(vec.lane(vector, k))


@inlined
def _covered_columns(edges: _ScaledEdges, rows_in_box: F32x8, box_left_limit: F32x8, box_right_limit: F32x8) -> I32x8x2:
    """Return the first covered column, counted from the box's first, and the number of covered columns of eight rows.

    Column c is covered if left_limit < c < right_limit: from floor(left_limit + 1) to the end floor(right_limit + 1).

    Args:
        rows_in_box: counted from the box's first row.
        box_left_limit, box_right_limit: limits by box and image, integers minus 1/2, from the box's first column on.
    """
    one = vec.f32(1.0)
    left_limit, right_limit = _limit_by_edge(box_left_limit, box_right_limit, edges, 0, rows_in_box)
    left_limit, right_limit = _limit_by_edge(left_limit, right_limit, edges, 1, rows_in_box)
    left_limit, right_limit = _limit_by_edge(left_limit, right_limit, edges, 2, rows_in_box)
    # Nearly horizontal edges may have limits beyond int32, which minimum and maximum keep out. to_i32 rounds toward 0.
    # This is floor here, as no value is negative: left_limit >= box_left_limit >= -1/2.
    begin = vec.to_i32(vec.minimum(left_limit, box_right_limit) + one)
    end = vec.to_i32(vec.maximum(right_limit + one, vec.f32(0.0)))
    return begin, vec.maximum(end - begin, vec.i32(0))


@inlined
def _limit_by_edge(
    left_limit: F32x8, right_limit: F32x8, edges: _ScaledEdges, edge: I64, rows_in_box: F32x8
) -> F32x8x2:
    """Return the column limits of eight rows, narrowed to the inner side of an edge, 0 to 2.

    Why float32 is exact:

    - scaled_dx = edge_dx >> 8 is the height of the edge in grid units: an integer, and at most 129 x 256, since a box
      with 128 rows of pixel centres is less than 129 pixels high.
    - scaled_edge = (edge >> 8) + 1/2 is exact: edge >> 8 is below 2^23, also in the up to seven rows below
      the box that groups of eight rows add (``MAX_SMALL_HEIGHT``). It is positive inside, negative outside, never 0.
    - So the distance of q = -scaled_edge / scaled_dx to any integer is at least (1/2) / |scaled_dx| > 15.1e-6.
      (Horizontal edges, scaled_dx = 0, have limits of -inf or +inf.)
    - q is computed as scaled_edge * (-1 / scaled_dx), with two roundings of 2^-24 each. Where |q| <= 64, the error is
      at most 64 x 2^-23 < 7.7e-6. Where |q| > 64, the limits of the box, within -1/2 .. 63 1/2, replace it.
    - So the distance of the computed q is above 15.1e-6 - 7.7e-6 = 7.4e-6. Adding 1 rounds by at most 2^-18 < 3.9e-6,
      since q + 1 < 128: the floor is right.
    """
    scaled_edge = edges.base[edge] + edges.dy[edge] * rows_in_box
    # NaN limits nothing: if either argument is NaN, minimum and maximum return the second one.
    left_limit = vec.maximum(scaled_edge * edges.left_factor[edge], left_limit)
    return left_limit, vec.minimum(scaled_edge * edges.right_factor[edge], right_limit)


@inlined
def _block_masks(begin_from_aligned_left: I32x8, column_count: I32x8) -> tuple[I64, I64]:
    """Return the two masks, as SmallTriangleSpans.block_masks, of the blocks of eight rows with any covered column.

    Args:
        begin_from_aligned_left: the rows' first covered columns, counted from ``aligned_left``.
        column_count: number of the rows' covered columns.
    """
    log2_columns, zero = vec.i32(_LOG2_BLOCK_COLUMNS), vec.i32(0)
    # Bit b of a lane is block b of a row: ones from the block of the first covered column up to that of the last.
    end_block = (begin_from_aligned_left + column_count + vec.i32(vec.LANES - 1)) >> log2_columns
    blocks = (vec.i32(1) << end_block) - (vec.i32(1) << (begin_from_aligned_left >> log2_columns))
    blocks = vec.select(column_count > zero, blocks, zero)
    # The upper and the lower block row have up to nine blocks each: 0 to 7 go to the first mask, 8 to the second.
    is_upper = vec.iota() < vec.i32(_BLOCK_ROWS)
    upper, lower = vec.or_of(vec.select(is_upper, blocks, zero)), vec.or_of(vec.select(is_upper, zero, blocks))
    blocks_0_to_7 = (upper & 255) | ((lower & 255) << _BITS_PER_BLOCK_ROW)
    return blocks_0_to_7, (upper >> _BITS_PER_BLOCK_ROW) | ((lower >> _BITS_PER_BLOCK_ROW) << _BITS_PER_BLOCK_ROW)
