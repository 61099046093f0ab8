"""Rasterization of a band with several samples per pixel.

A triangle is set up once. Its edge functions and its 1/z are linear, so that their values at a sample are those at the
pixel's centre plus an offset that is the same in all pixels. Eight pixels at a time, a primitive that covers all
samples in front of everything takes whole pixels, and one that lies behind is skipped. Only pixels at edges are tested
sample by sample, one sample per lane; of four samples, each takes two lanes. Stored ranges of 1/z may be wider than the
values, which costs time but never changes the image.
"""

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import I64, f64, i64
from renderers.compiler.pointers import address
from renderers.compiler.simd import F64x8x2, I32x8
from renderers.compiler.structs import Struct
from renderers.msaa import SampleBand
from renderers.raster.chunks import primitives_in_bin
from renderers.raster.fill import Pixel, make_fill
from renderers.raster.grid import first_center
from renderers.raster.layout import (
    CHUNK_SIZE,
    HALF_PIXEL,
    KIND_SMALL,
    SUBPIXEL,
    SUBPIXEL_BITS,
    Primitive,
    RasterFrame,
    SmallTriangle,
)
from renderers.raster.msaa.small_triangles import SampleScratch, draw_small_samples
from renderers.raster.msaa.storage import max_inv_z_offset, merge_samples, merge_whole_pixels, sample_inv_z_offsets
from renderers.visibility_buffer import BAND_ROWS

_NO_COLUMN: Final = 1 << 30
"""Start of the empty span of a sample that is not covered, and with the other sign its stop: right of all columns."""


class _SampleTarget(Struct):
    """The band that a primitive is drawn into, and the index of the primitive in RasterFrame.primitives."""

    band: SampleBand
    owner: I64
    scratch: SampleScratch


@inlined
def _sample_points(frame: RasterFrame, row: I64) -> F64x8x2:
    """Return the samples of a row, for ``make_fill``: offsets across and positions down; f64x8, grid units."""
    offsets = frame.sample_offsets
    x, y = vec.to_f64(vec.load(offsets, 0)), vec.to_f64(vec.load(offsets, vec.LANES))
    return x, vec.f64(row * SUBPIXEL + HALF_PIXEL) + y


@device_function
def _draw_span(
    frame: RasterFrame,
    target: _SampleTarget,
    primitive: Primitive,
    row: I64,
    count: I64,
    start: I32x8,
    stop: I32x8,
    base: Pixel,
) -> None:
    """Draw a row in which every sample has its own columns, ``start .. stop``; ``count`` is 1."""
    is_covered = start < stop
    start = vec.select(is_covered, start, vec.i32(_NO_COLUMN))
    stop = vec.select(is_covered, stop, vec.i32(-_NO_COLUMN))
    begin, end = vec.minimum_of(start), vec.maximum_of(stop)
    if begin >= end:
        return
    # Between these columns all samples are covered.
    full_begin, full_end = vec.i32(vec.maximum_of(start)), vec.i32(vec.minimum_of(stop))
    inv_z_dx, inv_z_dy = primitive.inv_z_dx, primitive.inv_z_dy
    row_inv_z = primitive.inv_z_base + inv_z_dy * f64(row - base.y)
    inv_z_offsets = sample_inv_z_offsets(frame, inv_z_dx, inv_z_dy)
    max_offset = vec.f32(max_inv_z_offset(frame, inv_z_dx, inv_z_dy))
    inv_z_min, inv_z_max = vec.f32(primitive.inv_z_min), vec.f32(primitive.inv_z_max)
    ids, owner = vec.i32(primitive.id), target.owner
    band, slot_count = target.band, target.scratch.slot_count
    row_pixel = (row - band.first_row) * frame.stride
    lane = vec.iota()
    for column in range(begin & ~i64(vec.LANES - 1), end, vec.LANES):
        columns = vec.i32(column) + lane
        full = (columns >= full_begin) & (columns < full_end)
        touched = (columns >= vec.i32(begin)) & (columns < vec.i32(end))
        inv_z = vec.to_f32(vec.f64(row_inv_z) + vec.f64(inv_z_dx) * vec.to_f64(columns - vec.i32(base.x)))
        edge_pixels = merge_whole_pixels(band, row_pixel + column, inv_z, max_offset, primitive, owner, full, touched)
        while edge_pixels != 0:  # from here on the lanes are the eight samples of one pixel
            x = column + vec.lowest_bit(edge_pixels)
            edge_pixels &= edge_pixels - 1
            covered = (vec.i32(x) >= start) & (vec.i32(x) < stop)
            inv_z = vec.f32(row_inv_z + inv_z_dx * f64(x - base.x)) + inv_z_offsets
            inv_z = vec.minimum(vec.maximum(inv_z, inv_z_min), inv_z_max)
            slot_count = merge_samples(frame, band, slot_count, row_pixel + x, inv_z, covered, ids)
    target.scratch.slot_count = slot_count


@inlined
def _draw_point(frame: RasterFrame, target: _SampleTarget, primitive: Primitive, first_row: I64, end_row: I64) -> None:
    """Draw a KIND_POINT: the samples in a square of grid units."""
    geometry, reach = primitive.geometry, frame.sample_reach
    x0, y0, x1, y1 = i64(geometry[0]), i64(geometry[1]), i64(geometry[2]), i64(geometry[3])
    top = max(first_center(y0 - reach), first_row)
    bottom = min(first_center(y1 + reach), end_row)
    offsets = frame.sample_offsets
    sample_x, sample_y = vec.load(offsets, 0), vec.load(offsets, vec.LANES)
    # first_center, for samples that lie sample_x beside the pixel's centre.
    round_up, bits = vec.i32(SUBPIXEL - 1 - HALF_PIXEL) - sample_x, vec.i32(SUBPIXEL_BITS)
    start = vec.maximum((vec.i32(x0) + round_up) >> bits, vec.i32(0))
    stop = vec.minimum((vec.i32(x1) + round_up) >> bits, vec.i32(frame.width))
    for row in range(top, bottom):
        y = vec.i32(row * SUBPIXEL + HALF_PIXEL) + sample_y
        inside = (y >= vec.i32(y0)) & (y < vec.i32(y1))
        row_stop = vec.select(inside, stop, vec.i32(-1))
        _draw_span(frame, target, primitive, row, 1, start, row_stop, Pixel(i64(0), i64(0)))


# Draws large primitives: calls _draw_span for one row at a time.
_fill = make_fill(1, _sample_points, _draw_span, _draw_point)


@device_function
def _draw_primitive(frame: RasterFrame, target: _SampleTarget, index: I64, first_row: I64, end_row: I64) -> None:
    """Draw some rows of a primitive; ``index``: that in RasterFrame.primitives."""
    primitive = frame.primitives[index]
    if primitive.kind == KIND_SMALL:
        triangle = SmallTriangle(address(primitive))
        draw_small_samples(frame, target.band, triangle, index, first_row, end_row, target.scratch)
    else:
        target.owner = index
        _fill(frame, target, primitive, first_row, end_row)


@device_function
def draw_sample_rows(frame: RasterFrame, band: SampleBand, first_row: I64, end_row: I64) -> None:
    """Clear the rows, all of one band, and draw everything that touches them.

    Then ``owners`` has -1 where a pixel sees nothing, MIXED where its samples have ids of their own, in ``sample_ids``
    from eight times ``slots`` on, and otherwise ``ids`` has the pixel's primitive id.
    """
    band_index = first_row // BAND_ROWS
    band.first_row = first_row
    # Nothing beyond this 1/z passes the depth test: the far plane needs no test of its own.
    empty_inv_z = vec.f32(frame.inv_z_far)
    none = vec.i32(-1)
    for pixel in range(0, (end_row - first_row) * frame.stride, vec.LANES):
        vec.store(band.owners, pixel, none)
        vec.store(band.slots, pixel, none)
        vec.store(band.far, pixel, empty_inv_z)
        vec.store(band.near, pixel, empty_inv_z)
    scratch = SampleScratch()
    scratch.slot_count = 0
    target = _SampleTarget()
    target.band, target.scratch = band, scratch
    for chunk_index in range(frame.chunk_count):
        chunk = frame.chunks[chunk_index]
        if band_index < chunk.first_band or band_index > chunk.last_band:
            continue
        if is_set(frame.stop):
            break
        for k in range(0, chunk.primitive_count, vec.LANES):
            pending = primitives_in_bin(chunk, k, band_index)
            while pending != 0:
                index = chunk_index * CHUNK_SIZE + k + vec.lowest_bit(pending)
                pending &= pending - 1
                _draw_primitive(frame, target, index, first_row, end_row)
