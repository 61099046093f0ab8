"""Small triangles with several samples per pixel, eight neighbouring pixels at a time."""

from typing import NamedTuple

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, I32, I64, Pointer, f32, i64
from renderers.compiler.simd import F32x8, F32x8x2, I32x8, I32x8x2, I32x8x3
from renderers.compiler.structs import Struct, inline
from renderers.msaa import SampleBand
from renderers.raster.grid import box_of
from renderers.raster.layout import MAX_SMALL_WIDTH, SUBPIXEL_BITS, RasterFrame, SmallTriangle
from renderers.raster.msaa.storage import max_inv_z_offset, merge_samples, merge_whole_pixels, sample_inv_z_offsets
from renderers.visibility_buffer import BAND_ROWS


class SampleScratch(Struct):
    """Working memory of a thread for a band."""

    slot_count: I64  # slots of the band in use
    edge_pixels: Pointer[I32] = inline((MAX_SMALL_WIDTH + 3 * vec.LANES) * BAND_ROWS)  # as from _packed_in_box
    batch_e0: Pointer[I32] = inline(vec.LANES)  # first edge function of eight of the edge pixels
    batch_e1: Pointer[I32] = inline(vec.LANES)  # second edge function
    batch_pixels: Pointer[I32] = inline(vec.LANES)  # index in the band
    batch_inv_z: Pointer[F32] = inline(vec.LANES)
    row_inv_z: Pointer[F32] = inline(BAND_ROWS + vec.LANES)  # 1/z at the box's first column
    first_rows: Pointer[I32] = inline(vec.LANES)  # of eight block columns
    last_rows: Pointer[I32] = inline(vec.LANES)


@inlined
def _packed_in_box(row: I64, column: I64) -> I64:
    """Return a pixel in ``edge_pixels``; row and column are counted from the box's first, columns from -8 on."""
    return (row << 8) + column + vec.LANES


@inlined
def _limit_rows(edge: I64, edge_dx: I64, edge_dy: I64, columns: I32x8, min_row: F32x8, max_row: F32x8) -> F32x8x2:
    """Return the first and last row, limited by ``min_row`` and ``max_row``, that may be on the inner side of an edge.

    Args:
        edge, edge_dx, edge_dy: the edge function in row 0 and its changes per column and row.
        columns: the first column of each block column, which is eight pixels wide.
    """
    # An edge function is greatest in a block's first or last column.
    block_max = vec.i32(edge + max(7 * edge_dx, 0)) + columns * vec.i32(edge_dx)
    # The slack is far above the rounding of crossings in the band: three times 2^-24 of at most 32 rows.
    zero, slack = vec.f32(0.0), vec.f32(0.01)
    dy = f32(edge_dy)
    scale = f32(1.0) / dy if edge_dy != 0 else f32(0.0)
    crossing = zero - vec.to_f32(block_max) * vec.f32(scale)
    min_row = vec.select(vec.f32(dy) > zero, vec.maximum(crossing - slack, min_row), min_row)
    return min_row, vec.select(vec.f32(dy) < zero, vec.minimum(crossing + slack, max_row), max_row)


@inlined
def _is_hidden(far: Pointer[F32], stride: I64, left: I64, right: I64, top: I64, bottom: I64, inv_z_max: F32) -> bool:
    """Return whether all pixels of a box are nearer than a triangle with the greatest 1/z ``inv_z_max``.

    ``far`` is SampleBand.far. Rows are counted from the band's first.
    """
    limit, lane = vec.f32(inv_z_max), vec.iota()
    # The middle first: most visible triangles are visible there.
    column = max(min((left + right - vec.LANES) >> 1, stride - vec.LANES), 0)
    pixel = ((top + bottom) >> 1) * stride + column
    columns = vec.i32(column) + lane
    inside = (columns >= vec.i32(left)) & (columns < vec.i32(right))
    if vec.movemask((vec.load(far, pixel) <= limit) & inside) != 0:
        return False
    last = bottom - top - 1
    for start in range(left, right, 2 * vec.LANES):
        # Two vectors and four rows at a time; those at the margins are tested twice. Columns left of the box are tested
        # too: that may only make a hidden triangle visible, which costs time.
        first, second = min(start, stride - vec.LANES), min(start + vec.LANES, stride - vec.LANES)
        first_far, second_far = vec.f32(np.inf), vec.f32(np.inf)
        for row in range(0, last + 1, 4):
            for k in range(4):
                pixel = (top + min(row + k, last)) * stride
                first_far = vec.minimum(vec.load(far, pixel + first), first_far)
                second_far = vec.minimum(vec.load(far, pixel + second), second_far)
        end = vec.i32(right)
        is_visible = (first_far <= limit) & (vec.i32(first) + lane < end)
        is_visible = is_visible | ((second_far <= limit) & (vec.i32(second) + lane < end))
        if vec.movemask(is_visible) != 0:
            return False
    return True


class SampleEdges(NamedTuple):
    """Edge functions of a SmallTriangle's three edges, and how they vary among the samples of a pixel."""

    first: tuple[I64, I64, I64]
    """At the first pixel centre of the box, three int64."""
    dx: tuple[I64, I64, I64]
    """Change per column, three int64."""
    dy: tuple[I64, I64, I64]
    """Change per row, three int64."""
    offsets: I32x8x2
    """At the samples minus at the centre, of the first two edges, i32x8 each."""
    top: tuple[I64, I64, I64]
    """Maximum over the samples of a pixel in the first row that is drawn and the box's first column, three int64."""
    range: I32x8x3
    """Greatest minus least of a pixel's samples, in all lanes; three i32x8."""


@inlined
def _sample_edges(frame: RasterFrame, triangle: SmallTriangle, skipped_rows: I64) -> SampleEdges:
    """Return the SampleEdges of a SmallTriangle, of whose box ``skipped_rows`` rows are not drawn."""
    first = i64(triangle.edge_base[0]), i64(triangle.edge_base[1]), i64(triangle.edge_base[2])
    e0_dx, e1_dx = i64(triangle.edge_dx[0]), i64(triangle.edge_dx[1])
    e0_dy, e1_dy = i64(triangle.edge0_dy), i64(triangle.edge1_dy)
    e2_dx, e2_dy = -e0_dx - e1_dx, -e0_dy - e1_dy
    # Changes are per pixel, sample offsets are grid units.
    x, y = vec.load(frame.sample_offsets, 0), vec.load(frame.sample_offsets, vec.LANES)
    offsets0 = vec.i32(e0_dx >> SUBPIXEL_BITS) * x + vec.i32(e0_dy >> SUBPIXEL_BITS) * y
    offsets1 = vec.i32(e1_dx >> SUBPIXEL_BITS) * x + vec.i32(e1_dy >> SUBPIXEL_BITS) * y
    offsets2 = vec.i32(e2_dx >> SUBPIXEL_BITS) * x + vec.i32(e2_dy >> SUBPIXEL_BITS) * y
    max0, max1, max2 = vec.maximum_of(offsets0), vec.maximum_of(offsets1), vec.maximum_of(offsets2)
    return SampleEdges(
        first=first,
        dx=(e0_dx, e1_dx, e2_dx),
        dy=(e0_dy, e1_dy, e2_dy),
        offsets=(offsets0, offsets1),
        top=(
            first[0] + max0 + skipped_rows * e0_dy,
            first[1] + max1 + skipped_rows * e1_dy,
            first[2] + max2 + skipped_rows * e2_dy,
        ),
        range=(
            vec.i32(max0 - vec.minimum_of(offsets0)),
            vec.i32(max1 - vec.minimum_of(offsets1)),
            vec.i32(max2 - vec.minimum_of(offsets2)),
        ),
    )


@inlined
def _limit_block_rows(edges: SampleEdges, columns: I32x8, rows: I64, is_wide: bool, scratch: SampleScratch) -> None:
    """Store which of ``rows`` rows each of eight block columns may cover, in ``first_rows`` and ``last_rows``.

    Half of the box of a wide triangle lies outside it. Other triangles have all rows.
    """
    min_row, max_row = vec.f32(0.0), vec.f32(rows - 1)
    if is_wide:
        min_row, max_row = _limit_rows(edges.top[0], edges.dx[0], edges.dy[0], columns, min_row, max_row)
        min_row, max_row = _limit_rows(edges.top[1], edges.dx[1], edges.dy[1], columns, min_row, max_row)
        min_row, max_row = _limit_rows(edges.top[2], edges.dx[2], edges.dy[2], columns, min_row, max_row)
    first, last = vec.ceil(vec.minimum(min_row, vec.f32(rows))), vec.floor(vec.maximum(max_row, vec.f32(-1.0)))
    vec.store(scratch.first_rows, 0, vec.to_i32(first))
    vec.store(scratch.last_rows, 0, vec.to_i32(last))


@inlined
def _draw_block(
    frame: RasterFrame,
    band: SampleBand,
    triangle: SmallTriangle,
    owner: I64,
    edges: SampleEdges,
    max_offset: F32x8,
    top: I64,
    start: I64,
    block: I64,
    scratch: SampleScratch,
    count: I64,
) -> I64:
    """Draw the whole pixels of a block column; append its other ones to ``count`` edge pixels, and return their number.

    Args:
        top: first row that is drawn, to which ``edges.top`` belongs.
        start: first column of the block, which is a vector wide.
        block: index in ``first_rows`` and ``last_rows``.
    """
    box_left, box_top, _, _ = box_of(triangle)
    stride, zero = frame.stride, vec.i32(0)
    # A block at the right margin is moved left: pixels that were drawn are not drawn again.
    column = min(start, stride - vec.LANES)
    valid = i64(255) << (start - column)
    columns = vec.i32(column - box_left) + vec.iota()
    first_row, end_row = i64(scratch.first_rows[block]), i64(scratch.last_rows[block]) + 1
    e0 = vec.i32(edges.top[0] + first_row * edges.dy[0]) + columns * vec.i32(edges.dx[0])
    e1 = vec.i32(edges.top[1] + first_row * edges.dy[1]) + columns * vec.i32(edges.dx[1])
    e2 = vec.i32(edges.top[2] + first_row * edges.dy[2]) + columns * vec.i32(edges.dx[2])
    inv_z_from_box_left = vec.f32(triangle.inv_z_dx) * vec.to_f32(columns)
    pixel = (top + first_row - band.first_row) * stride + column
    edge_pixel = _packed_in_box(top - box_top + first_row, column - box_left)
    for row in range(first_row, end_row):
        # Maxima over a pixel's samples: some sample may be inside, and minima: all are.
        touched = (e0 | e1 | e2) >= zero
        full = (e0 >= edges.range[0]) & (e1 >= edges.range[1]) & (e2 >= edges.range[2])
        e0, e1, e2 = e0 + vec.i32(edges.dy[0]), e1 + vec.i32(edges.dy[1]), e2 + vec.i32(edges.dy[2])
        inv_z = vec.f32(scratch.row_inv_z[row]) + inv_z_from_box_left
        mask = valid & merge_whole_pixels(band, pixel, inv_z, max_offset, triangle, owner, full, touched)
        lanes = vec.load(frame.lanes_of_mask, vec.LANES * mask)
        vec.store(scratch.edge_pixels, count, lanes + vec.i32(edge_pixel))
        count += vec.count_bits(mask)
        pixel += stride
        edge_pixel += _packed_in_box(1, -vec.LANES)  # to the same column of the next row
    return count


@inlined
def _load_edge_pixels(
    frame: RasterFrame,
    band: SampleBand,
    triangle: SmallTriangle,
    edges: SampleEdges,
    batch: I64,
    scratch: SampleScratch,
) -> None:
    """Fill the ``batch_`` fields of a SampleScratch for eight edge pixels, of which ``batch`` is the first."""
    box_left, box_top, _, _ = box_of(triangle)
    in_box = vec.load(scratch.edge_pixels, batch)  # as ``_packed_in_box``
    rows, columns = in_box >> vec.i32(8), (in_box & vec.i32(255)) - vec.i32(vec.LANES)
    e0 = vec.i32(edges.first[0]) + rows * vec.i32(edges.dy[0]) + columns * vec.i32(edges.dx[0])
    e1 = vec.i32(edges.first[1]) + rows * vec.i32(edges.dy[1]) + columns * vec.i32(edges.dx[1])
    vec.store(scratch.batch_e0, 0, e0)
    vec.store(scratch.batch_e1, 0, e1)
    pixels = (rows + vec.i32(box_top - band.first_row)) * vec.i32(frame.stride) + (columns + vec.i32(box_left))
    vec.store(scratch.batch_pixels, 0, pixels)
    row_inv_z = vec.f32(triangle.inv_z_base) + vec.f32(triangle.inv_z_dy) * vec.to_f32(rows)
    vec.store(scratch.batch_inv_z, 0, row_inv_z + vec.f32(triangle.inv_z_dx) * vec.to_f32(columns))


@inlined
def _draw_edge_pixels(
    frame: RasterFrame,
    band: SampleBand,
    triangle: SmallTriangle,
    edges: SampleEdges,
    count: I64,
    scratch: SampleScratch,
) -> None:
    """Draw the samples of the first ``count`` edge pixels."""
    inv_z_min, inv_z_max = vec.f32(triangle.inv_z_min), vec.f32(triangle.inv_z_max)
    inv_z_offsets = sample_inv_z_offsets(frame, triangle.inv_z_dx, triangle.inv_z_dy)
    edge_sum = vec.i32(edges.first[0] + edges.first[1] + edges.first[2])  # the same at all points
    slot_count, ids, zero = scratch.slot_count, vec.i32(triangle.id), vec.i32(0)
    for batch in range(0, count, vec.LANES):
        _load_edge_pixels(frame, band, triangle, edges, batch, scratch)
        for k in range(min(count - batch, vec.LANES)):
            e0, e1 = vec.i32(scratch.batch_e0[k]) + edges.offsets[0], vec.i32(scratch.batch_e1[k]) + edges.offsets[1]
            covered = (e0 | e1 | (edge_sum - e0 - e1)) >= zero
            inv_z = vec.minimum(vec.maximum(vec.f32(scratch.batch_inv_z[k]) + inv_z_offsets, inv_z_min), inv_z_max)
            slot_count = merge_samples(frame, band, slot_count, i64(scratch.batch_pixels[k]), inv_z, covered, ids)
    scratch.slot_count = slot_count


@device_function
def draw_small_samples(
    frame: RasterFrame,
    band: SampleBand,
    triangle: SmallTriangle,
    owner: I64,
    first_row: I64,
    end_row: I64,
    scratch: SampleScratch,
) -> None:
    """Draw a SmallTriangle, eight pixels at a time; ``owner``: index in RasterFrame.primitives."""
    box_left, box_top, box_right, box_bottom = box_of(triangle)
    top, bottom = max(box_top, first_row), min(box_bottom, end_row)
    left, right = max(box_left, 0), min(box_right, frame.width)
    if _is_hidden(band.far, frame.stride, left, right, top - first_row, bottom - first_row, triangle.inv_z_max):
        return
    skipped_rows, rows = top - box_top, bottom - top
    edges = _sample_edges(frame, triangle, skipped_rows)
    for row in range(0, rows, vec.LANES):
        box_row = vec.to_f32(vec.i32(skipped_rows + row) + vec.iota())
        vec.store(scratch.row_inv_z, row, vec.f32(triangle.inv_z_base) + vec.f32(triangle.inv_z_dy) * box_row)
    max_offset = vec.f32(max_inv_z_offset(frame, triangle.inv_z_dx, triangle.inv_z_dy))
    # The blocks of a wide triangle begin where vectors do, so that each lies in one cache line.
    is_wide = right - left > 2 * vec.LANES
    begin = left - (left & (vec.LANES - 1) if is_wide else 0)
    count = 0
    for group in range(begin, right, vec.LANES * vec.LANES):
        columns = vec.i32(group - box_left) + (vec.iota() << vec.i32(3))
        _limit_block_rows(edges, columns, rows, is_wide, scratch)
        for block in range(min((right - group + vec.LANES - 1) >> 3, vec.LANES)):
            start = group + vec.LANES * block
            count = _draw_block(frame, band, triangle, owner, edges, max_offset, top, start, block, scratch, count)
    _draw_edge_pixels(frame, band, triangle, edges, count, scratch)
