"""Small triangles with several samples per pixel, eight neighbouring pixels at a time."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.raster.layout import SUBPIXEL_BITS
from renderers.raster.msaa.storage import (
    max_inv_z_offset,
    merge_samples,
    merge_whole_pixels,
    sample_inv_z_offsets,
)
from renderers.raster.small_triangles import box_of


class SampleEdges(NamedTuple):
    """Edge functions of a SMALL_TRIANGLE's three edges, and how they vary among the samples of a pixel."""

    first: Any
    """At the first pixel centre of the box, three int64."""
    dx: Any
    """Change per column, three int64."""
    dy: Any
    """Change per row, three int64."""
    offsets: Any
    """At the samples minus at the centre, three i32x8."""
    max_offset: Any
    """Maximum over the samples, three int64."""
    range: Any
    """From the least to the greatest of the samples, in all lanes; three i32x8."""


@inlined
def _sample_edges(frame, triangle):
    """Return the SAMPLE_EDGES of a SMALL_TRIANGLE."""
    e0_dx, e1_dx = np.int64(triangle.edge_dx[0]), np.int64(triangle.edge_dx[1])
    e0_dy, e1_dy = np.int64(triangle.edge0_dy), np.int64(triangle.edge1_dy)
    e2_dx, e2_dy = -e0_dx - e1_dx, -e0_dy - e1_dy
    # Changes are per pixel, sample offsets are grid units.
    x, y = vec.load(frame.sample_offsets, 0), vec.load(frame.sample_offsets, vec.LANES)
    offsets0 = vec.i32(e0_dx >> SUBPIXEL_BITS) * x + vec.i32(e0_dy >> SUBPIXEL_BITS) * y
    offsets1 = vec.i32(e1_dx >> SUBPIXEL_BITS) * x + vec.i32(e1_dy >> SUBPIXEL_BITS) * y
    offsets2 = vec.i32(e2_dx >> SUBPIXEL_BITS) * x + vec.i32(e2_dy >> SUBPIXEL_BITS) * y
    max0, max1, max2 = vec.maximum_of(offsets0), vec.maximum_of(offsets1), vec.maximum_of(offsets2)
    return SampleEdges(
        first=(np.int64(triangle.edges[0]), np.int64(triangle.edges[1]), np.int64(triangle.edges[2])),
        dx=(e0_dx, e1_dx, e2_dx),
        dy=(e0_dy, e1_dy, e2_dy),
        offsets=(offsets0, offsets1, offsets2),
        max_offset=(max0, max1, max2),
        range=(
            vec.i32(max0 - vec.minimum_of(offsets0)),
            vec.i32(max1 - vec.minimum_of(offsets1)),
            vec.i32(max2 - vec.minimum_of(offsets2)),
        ),
    )


@device_function
def draw_small_samples(frame, band, triangle, owner, first_row, end_row, slot_count):
    """Draw some rows of a SMALL_TRIANGLE.

    Args:
        band: a SAMPLE_BAND.
        owner: index of the primitive.
        slot_count: number of slots in use.

    Returns:
        The new ``slot_count``.
    """
    box_x, box_y, box_columns, box_rows = box_of(triangle)
    begin, end = max(box_x, 0) & ~np.int64(vec.LANES - 1), min(box_x + box_columns, frame.width)
    edges, zero, ids = _sample_edges(frame, triangle), vec.i32(0), vec.i32(triangle.id)
    inv_z_dx, inv_z_min, inv_z_max = triangle.inv_z_dx, vec.f32(triangle.inv_z_min), vec.f32(triangle.inv_z_max)
    inv_z_offsets = sample_inv_z_offsets(frame, inv_z_dx, triangle.inv_z_dy)
    max_offset = vec.f32(max_inv_z_offset(frame, inv_z_dx, triangle.inv_z_dy))
    for y in range(max(box_y, first_row), min(box_y + box_rows, end_row)):
        row = y - box_y
        row_inv_z = triangle.inv_z_base + triangle.inv_z_dy * np.float32(row)
        row_e0, row_e1, row_e2 = (
            edges.first[0] + row * edges.dy[0],
            edges.first[1] + row * edges.dy[1],
            edges.first[2] + row * edges.dy[2],
        )
        for x in range(begin, end, vec.LANES):
            columns = vec.i32(x - box_x) + vec.iota()
            # The greatest values among the samples of each pixel.
            e0 = vec.i32(row_e0 + edges.max_offset[0]) + columns * vec.i32(edges.dx[0])
            e1 = vec.i32(row_e1 + edges.max_offset[1]) + columns * vec.i32(edges.dx[1])
            e2 = vec.i32(row_e2 + edges.max_offset[2]) + columns * vec.i32(edges.dx[2])
            touched = (e0 | e1 | e2) >= zero
            if vec.movemask(touched) == 0:
                continue
            full = (e0 >= edges.range[0]) & (e1 >= edges.range[1]) & (e2 >= edges.range[2])
            inv_z = vec.f32(row_inv_z) + vec.f32(inv_z_dx) * vec.to_f32(columns)
            first_pixel = (y - band.first_row) * frame.stride + x
            edge_pixels = merge_whole_pixels(band, first_pixel, inv_z, max_offset, triangle, owner, full, touched)
            while edge_pixels != 0:
                lane = vec.lowest_bit(edge_pixels)
                edge_pixels &= edge_pixels - 1
                column = x + lane - box_x
                e0 = vec.i32(row_e0 + column * edges.dx[0]) + edges.offsets[0]
                e1 = vec.i32(row_e1 + column * edges.dx[1]) + edges.offsets[1]
                e2 = vec.i32(row_e2 + column * edges.dx[2]) + edges.offsets[2]
                covered = (e0 | e1 | e2) >= zero
                inv_z = vec.f32(row_inv_z + inv_z_dx * np.float32(column)) + inv_z_offsets
                inv_z = vec.minimum(vec.maximum(inv_z, inv_z_min), inv_z_max)
                slot_count = merge_samples(frame, band, slot_count, first_pixel + lane, inv_z, covered, ids)
    return slot_count
