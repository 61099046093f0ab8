"""Small triangles with several samples per pixel, eight neighbouring pixels at a time."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.structs import F32, I32, I64, Struct, array_of
from renderers.raster.layout import MAX_SMALL_WIDTH
from renderers.raster.msaa.storage import (
    max_inv_z_offset,
    merge_samples,
    merge_whole_pixels,
    sample_inv_z_offsets,
)
from renderers.raster.small_triangles import box_of
from renderers.visibility_buffer import BAND_ROWS

SCRATCH: Final = Struct(
    "SampleScratch",
    {
        "slot_count": I64,  # slots of the band in use
        "edge_pixels": array_of(
            I32, (MAX_SMALL_WIDTH + 3 * vec.LANES) * BAND_ROWS
        ),  # row << 8 | column + 8, in the box
        "batch_e0": array_of(I32, vec.LANES),  # first edge function of eight of the edge pixels
        "batch_e1": array_of(I32, vec.LANES),  # second edge function
        "batch_pixels": array_of(I32, vec.LANES),  # index in the band
        "batch_inv_z": array_of(F32, vec.LANES),
        "row_inv_z": array_of(F32, BAND_ROWS + vec.LANES),  # 1/z at the box's first column
        "first_rows": array_of(I32, vec.LANES),  # of eight block columns
        "last_rows": array_of(I32, vec.LANES),
    },
)
"""Working memory of a thread for a band."""


@inlined
def _limit_rows(edge, edge_dx, edge_dy, columns, min_row, max_row):
    """Narrow the rows in which block columns, eight pixels wide, may be on the inner side of an edge; f32x8.

    Args:
        edge, edge_dx, edge_dy: the edge function in row 0, grid units, and its changes per column and row.
        columns: i32x8, the first column of each block column.
    """
    block_max = vec.i32(edge + max(7 * edge_dx, 0)) + columns * vec.i32(edge_dx)
    zero, slack = vec.f32(0.0), vec.f32(0.01)
    dy = np.float32(edge_dy)
    scale = np.float32(1.0) / dy if edge_dy != 0 else np.float32(0.0)
    crossing = zero - vec.to_f32(block_max) * vec.f32(scale)
    min_row = vec.select(vec.f32(dy) > zero, vec.maximum(crossing - slack, min_row), min_row)
    return min_row, vec.select(vec.f32(dy) < zero, vec.minimum(crossing + slack, max_row), max_row)


@inlined
def _is_hidden(far, stride, left, right, top, bottom, inv_z_max):
    """Return whether all pixels of a box are nearer than a triangle with the greatest 1/z ``inv_z_max``.

    Args:
        far: pointer to SAMPLE_BAND.far.
        left .. bottom: first column and row of the box, and those after the last.
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
        # Two vectors and four rows at a time; those at the margins are tested twice.
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


@device_function
def draw_small_samples(frame, band, triangle, owner, first_row, end_row, scratch):
    """Draw a SMALL_TRIANGLE, eight pixels at a time.

    Args:
        band: a SAMPLE_BAND.
        owner: index of the binned primitive.
        scratch: a SCRATCH.
    """
    box_x, box_y, box_columns, box_rows = box_of(triangle)
    top = max(box_y, first_row)
    bottom = min(box_y + box_rows, end_row)
    if top >= bottom:  # one of the chunk's tall primitives
        return
    left = max(box_x, 0)
    right = min(box_x + box_columns, frame.width)
    stride = frame.stride
    if _is_hidden(band.far, stride, left, right, top, bottom, triangle.inv_z_max):
        return
    inv_z_base, inv_z_dx, inv_z_dy = triangle.inv_z_base, triangle.inv_z_dx, triangle.inv_z_dy
    inv_z_min, inv_z_max = vec.f32(triangle.inv_z_min), vec.f32(triangle.inv_z_max)
    inv_z_offsets = sample_inv_z_offsets(frame, inv_z_dx, inv_z_dy)
    max_offset = vec.f32(max_inv_z_offset(frame, inv_z_dx, inv_z_dy))
    e0, e1, e2 = np.int64(triangle.edges[0]), np.int64(triangle.edges[1]), np.int64(triangle.edges[2])
    e0_dx, e1_dx = np.int64(triangle.edge_dx[0]), np.int64(triangle.edge_dx[1])
    e0_dy, e1_dy = np.int64(triangle.edge0_dy), np.int64(triangle.edge1_dy)
    e2_dx, e2_dy = -e0_dx - e1_dx, -e0_dy - e1_dy
    edge_sum = vec.i32(e0 + e1 + e2)  # the same at all points
    # Edge functions at the samples minus those at the centre. Changes are per pixel, sample offsets are grid units.
    samples = frame.sample_offsets
    sample_x, sample_y = vec.load(samples, 0), vec.load(samples, vec.LANES)
    e0_offsets = vec.i32(e0_dx >> 8) * sample_x + vec.i32(e0_dy >> 8) * sample_y
    e1_offsets = vec.i32(e1_dx >> 8) * sample_x + vec.i32(e1_dy >> 8) * sample_y
    e2_offsets = vec.i32(e2_dx >> 8) * sample_x + vec.i32(e2_dy >> 8) * sample_y
    e0_max, e1_max, e2_max = vec.maximum_of(e0_offsets), vec.maximum_of(e1_offsets), vec.maximum_of(e2_offsets)
    # From the least to the greatest of a pixel's samples.
    e0_range = vec.i32(e0_max - vec.minimum_of(e0_offsets))
    e1_range = vec.i32(e1_max - vec.minimum_of(e1_offsets))
    e2_range = vec.i32(e2_max - vec.minimum_of(e2_offsets))
    lane, zero = vec.iota(), vec.i32(0)
    skipped_rows, rows = top - box_y, bottom - top
    lane_lists, edge_pixel_count = frame.lane_lists, 0
    for row in range(0, rows, vec.LANES):
        box_row = vec.to_f32(vec.i32(skipped_rows + row) + lane)
        vec.store(scratch.row_inv_z, row, vec.f32(inv_z_base) + vec.f32(inv_z_dy) * box_row)
    # Half of the box of a wide triangle lies outside it: the rows of each block column are limited. Its blocks begin
    # where vectors do, so that each lies in one cache line.
    is_wide = right - left > 2 * vec.LANES
    begin = left - (left & (vec.LANES - 1) if is_wide else 0)
    # The greatest values among a pixel's samples, in the first row.
    top_e0, top_e1, top_e2 = (
        e0 + e0_max + skipped_rows * e0_dy,
        e1 + e1_max + skipped_rows * e1_dy,
        e2 + e2_max + skipped_rows * e2_dy,
    )
    for group in range(begin, right, vec.LANES * vec.LANES):
        min_row, max_row = vec.f32(0.0), vec.f32(rows - 1)
        if is_wide:
            columns = vec.i32(group - box_x) + (lane << vec.i32(3))
            min_row, max_row = _limit_rows(top_e0, e0_dx, e0_dy, columns, min_row, max_row)
            min_row, max_row = _limit_rows(top_e1, e1_dx, e1_dy, columns, min_row, max_row)
            min_row, max_row = _limit_rows(top_e2, e2_dx, e2_dy, columns, min_row, max_row)
        first, last = vec.ceil(vec.minimum(min_row, vec.f32(rows))), vec.floor(vec.maximum(max_row, vec.f32(-1.0)))
        vec.store(scratch.first_rows, 0, vec.to_i32(first))
        vec.store(scratch.last_rows, 0, vec.to_i32(last))
        for block in range(min((right - group + vec.LANES - 1) >> 3, vec.LANES)):
            start = group + vec.LANES * block
            # A block at the right margin is moved left: pixels that were drawn are not drawn again.
            column = min(start, stride - vec.LANES)
            valid = np.int64(255) << (start - column)
            columns = vec.i32(column - box_x) + lane
            block_row, block_end_row = np.int64(scratch.first_rows[block]), np.int64(scratch.last_rows[block]) + 1
            c0 = vec.i32(top_e0 + block_row * e0_dy) + columns * vec.i32(e0_dx)
            c1 = vec.i32(top_e1 + block_row * e1_dy) + columns * vec.i32(e1_dx)
            c2 = vec.i32(top_e2 + block_row * e2_dy) + columns * vec.i32(e2_dx)
            column_inv_z = vec.f32(inv_z_dx) * vec.to_f32(columns)
            pixel = (top + block_row) * stride + column
            edge_pixel = ((skipped_rows + block_row) << 8) + column - box_x + 8
            for row in range(block_row, block_end_row):
                touched = (c0 | c1 | c2) >= zero
                full = (c0 >= e0_range) & (c1 >= e1_range) & (c2 >= e2_range)
                c0, c1, c2 = c0 + vec.i32(e0_dy), c1 + vec.i32(e1_dy), c2 + vec.i32(e2_dy)
                inv_z = vec.f32(scratch.row_inv_z[row]) + column_inv_z
                mask = valid & merge_whole_pixels(band, pixel, inv_z, max_offset, triangle, owner, full, touched)
                lanes = vec.load(lane_lists, vec.LANES * mask)
                vec.store(scratch.edge_pixels, edge_pixel_count, lanes + vec.i32(edge_pixel))
                edge_pixel_count += vec.count_bits(mask)
                pixel += stride
                edge_pixel += 1 << 8
    slot_count = scratch.slot_count
    ids = vec.i32(triangle.id)
    for batch in range(0, edge_pixel_count, vec.LANES):
        edge_pixels = vec.load(scratch.edge_pixels, batch)
        box_rows_down, columns = edge_pixels >> vec.i32(8), (edge_pixels & vec.i32(255)) - vec.i32(8)
        vec.store(scratch.batch_e0, 0, vec.i32(e0) + box_rows_down * vec.i32(e0_dy) + columns * vec.i32(e0_dx))
        vec.store(scratch.batch_e1, 0, vec.i32(e1) + box_rows_down * vec.i32(e1_dy) + columns * vec.i32(e1_dx))
        pixels = (box_rows_down + vec.i32(box_y)) * vec.i32(stride) + (columns + vec.i32(box_x))
        vec.store(scratch.batch_pixels, 0, pixels)
        row_inv_z = vec.f32(inv_z_base) + vec.f32(inv_z_dy) * vec.to_f32(box_rows_down)
        vec.store(scratch.batch_inv_z, 0, row_inv_z + vec.f32(inv_z_dx) * vec.to_f32(columns))
        for k in range(min(edge_pixel_count - batch, vec.LANES)):
            c0, c1 = vec.i32(scratch.batch_e0[k]) + e0_offsets, vec.i32(scratch.batch_e1[k]) + e1_offsets
            covered = (c0 | c1 | (edge_sum - c0 - c1)) >= zero
            inv_z = vec.minimum(vec.maximum(vec.f32(scratch.batch_inv_z[k]) + inv_z_offsets, inv_z_min), inv_z_max)
            slot_count = merge_samples(frame, band, slot_count, np.int64(scratch.batch_pixels[k]), inv_z, covered, ids)
    scratch.slot_count = slot_count
