"""Rasterization of a band with one sample per pixel: coverage and depth test of the primitives."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import address, advance, allocate, as_i32, f32_at, i32_at, release, stack_array
from renderers.compiler.structs import I64, Struct
from renderers.raster.chunks import pixels_between, primitives_in_bin
from renderers.raster.depth_test import ANY_ORDER, IN_ORDER, PEELED, depth_test, depth_test_pixel
from renderers.raster.fill import make_fill
from renderers.raster.layout import (
    BACK_BIT,
    HALF_PIXEL,
    KIND_SMALL,
    LAYER,
    SUBPIXEL,
    frame_at,
    small_triangle_at,
)
from renderers.raster.small_triangles import PREPARED, box_of, draw_small, prepare_small
from renderers.visibility_buffer import BAND_ROWS

_TARGET: Final = Struct("Target", {"layer": LAYER, "depth_rule": I64, "prepared": PREPARED})
"""The layer that primitives are drawn into and its depth rule, and memory for a prepared small triangle."""
_new_layer = LAYER.local
_new_target = _TARGET.local
_new_prepared = PREPARED.local
_inv_z_array = stack_array(types.float32, vec.LANES)
_span_array = stack_array(types.int32, 2 * vec.LANES)


@inlined
def _sample_points(frame, row):
    """Return the centres of eight rows."""
    lane = vec.to_f64(vec.iota())
    return vec.f64(0.0), (vec.f64(row) + lane) * vec.f64(float(SUBPIXEL)) + vec.f64(float(HALF_PIXEL))


@inlined
def _draw_span_by(frame, layer, depth_rule, primitive, row, start, stop, base_x, base_y):
    """``_draw_span`` for any rule, or for a constant one."""
    slope = primitive.inv_z_dx
    row_inv_z = primitive.inv_z_base + primitive.inv_z_dy * np.float64(row - base_y)
    inv_z_min, inv_z_max = vec.f32(primitive.inv_z_min), vec.f32(primitive.inv_z_max)
    ids = vec.i32(primitive.id)
    lane = vec.iota()
    lane_inv_z = vec.f32(slope) * vec.to_f32(lane)
    first, end, lanes = vec.i32(start), vec.i32(stop), vec.i32(vec.LANES)
    vector_inv_z = _inv_z_array()
    vector_columns = vec.to_f64(lane * lanes)
    begin = start & ~np.int64(vec.LANES - 1)
    pixel = (row - layer.first_row) * frame.stride + begin
    for column in range(begin, stop, vec.LANES * vec.LANES):
        columns_from_base = vec.f64(column - base_x) + vector_columns
        vec.store(vector_inv_z, 0, vec.to_f32(vec.f64(row_inv_z) + vec.f64(slope) * columns_from_base))
        columns = vec.i32(column) + lane
        for k in range(min((stop - column + vec.LANES - 1) // vec.LANES, vec.LANES)):
            inv_z = vec.minimum(vec.maximum(vec.f32(vector_inv_z[k]) + lane_inv_z, inv_z_min), inv_z_max)
            depth_test(frame, layer, depth_rule, pixel, inv_z, (columns >= first) & (columns < end), ids)
            columns = columns + lanes
            pixel += vec.LANES


@device_function
def _draw_span(frame, target, primitive, row, start, stop, base_x, base_y):
    """Draw the pixels ``start .. stop`` of a row; ``base_x, base_y``: the pixel that ``inv_z_base`` belongs to.

    1/z is exact to float32 at the first of every eight pixels, wherever the span starts.
    """
    if target.depth_rule == IN_ORDER:
        _draw_span_by(frame, target.layer, IN_ORDER, primitive, row, start, stop, base_x, base_y)
    else:
        _draw_span_by(frame, target.layer, target.depth_rule, primitive, row, start, stop, base_x, base_y)


@inlined
def _draw_spans(frame, target, primitive, row, count, start, stop, base_x, base_y):
    """Draw ``count`` rows from ``row`` on, one per lane of ``start`` and ``stop``."""
    spans = _span_array()
    vec.store(spans, 0, start)
    vec.store(spans, vec.LANES, stop)
    for k in range(count):
        first, end = np.int64(spans[k]), np.int64(spans[vec.LANES + k])
        if first < end:
            _draw_span(frame, target, primitive, row + k, first, end, base_x, base_y)


@inlined
def _draw_point(frame, target, primitive, first_row, end_row):
    """Draw a KIND_POINT."""
    xy = primitive.xy
    left, top, right, bottom = np.int64(xy[0]), np.int64(xy[1]), np.int64(xy[2]), np.int64(xy[3])
    for row in range(max(top, first_row), min(bottom, end_row)):
        _draw_span(frame, target, primitive, row, left, right, left, top)


_fill = make_fill(vec.LANES, _sample_points, _draw_spans, _draw_point)


@device_function
def _draw_primitive(frame, target, primitive, first_row, end_row):
    """Draw some rows of a PRIMITIVE."""
    if primitive.kind == KIND_SMALL:
        prepare_small(frame, small_triangle_at(address(primitive)), first_row, end_row, target.prepared)
        if target.depth_rule == IN_ORDER:
            draw_small(frame, target.layer, IN_ORDER, target.prepared)
        else:
            draw_small(frame, target.layer, target.depth_rule, target.prepared)
    elif not is_set(frame.stop):  # a large one may take longer than hundreds of small ones
        _fill(frame, target, primitive, first_row, end_row)


@inlined
def set_band_layer(frame, layer, first_row, band_memory):
    """Set a LAYER to that of a band, which begins with ``first_row``.

    Args:
        band_memory: address of BAND_ROWS x stride int32, the ids, and as many float32, the 1/z; 0: the frame has a
            layer of the whole image.
    """
    if band_memory == 0:
        layer.ids, layer.inv_z, layer.first_row = i32_at(frame.layer_ids), f32_at(frame.layer_inv_z), 0
    else:
        layer.ids, layer.first_row = i32_at(band_memory), first_row
        layer.inv_z = advance(f32_at(band_memory), BAND_ROWS * frame.stride)


@device_function
def _clear_rows(frame, layer, first_row, end_row):
    """Clear a layer's rows."""
    begin, end = (first_row - layer.first_row) * frame.stride, (end_row - layer.first_row) * frame.stride
    # Nothing beyond this 1/z passes the depth test: the far plane needs no test of its own.
    empty_inv_z = vec.f32(np.float32(1.0 / frame.far))
    no_id = vec.i32(-1)
    # One array after the other: consecutive stores to a cache line are combined.
    for pixel in range(begin, end, vec.LANES):
        vec.store(layer.ids, pixel, no_id)
    for pixel in range(begin, end, vec.LANES):
        vec.store(layer.inv_z, pixel, empty_inv_z)


TILE_ROWS: Final = 8


@device_function
def _build_depth_tiles(frame, layer, first_row, end_row, tiles):
    """Write the least 1/z of every tile, TILE_ROWS rows of eight columns. Primitives with less are hidden there.

    Args:
        tiles: pointer to a row of ``stride`` float32 per row of tiles, of which the first of every eight is the result.
    """
    stride = frame.stride
    bits = as_i32(tiles)
    for top in range(first_row, end_row, TILE_ROWS):
        tile_row = (top - first_row) // TILE_ROWS * stride
        rows = min(TILE_ROWS, end_row - top)
        inv_z = advance(layer.inv_z, (top - layer.first_row) * stride)
        for column in range(0, stride, vec.LANES):
            inv_z_min = vec.load(inv_z, column)
            for row in range(1, rows):
                inv_z_min = vec.minimum(inv_z_min, vec.load(inv_z, row * stride + column))
            # Bits are ordered as the values are: none is negative.
            bits[tile_row + column] = vec.minimum_of(vec.float_bits(inv_z_min))


@device_function
def _is_hidden(frame, primitive, tiles, first_row, end_row):
    """Return whether a PRIMITIVE is a KIND_SMALL that lies behind everything in the tiles around its box."""
    if primitive.kind != KIND_SMALL:
        return False
    triangle = small_triangle_at(address(primitive))
    left, box_top, columns, rows = box_of(triangle)
    right = min(left + columns, frame.width)
    top, bottom = max(box_top, first_row) - first_row, min(box_top + rows, end_row) - first_row
    begin = (max(left, 0) >> 3) << 3
    inv_z_max = triangle.inv_z_max
    hidden = True
    for tile in range(top // TILE_ROWS, (bottom + TILE_ROWS - 1) // TILE_ROWS):
        tile_row = tile * frame.stride
        for column in range(tile_row + begin, tile_row + right, vec.LANES):
            hidden = hidden & (inv_z_max < tiles[column])
    return hidden


@device_function
def _draw_pixels(frame, target, chunk, begin, end):
    """Draw the pixels of tiny triangles that are in ``begin .. end``, both with BACK_BIT for back faces."""
    layer, depth_rule = target.layer, target.depth_rule
    first_pixel = layer.first_row * frame.stride
    for k in range(0, chunk.pixel_count, vec.LANES):
        pending = pixels_between(chunk, k, begin, end)
        while pending != 0:
            j = k + vec.lowest_bit(pending)
            pending &= pending - 1
            pixel = np.int64(chunk.pixels[j] & ~BACK_BIT) - first_pixel
            depth_test_pixel(frame, layer, depth_rule, pixel, chunk.pixel_inv_z[j], chunk.pixel_ids[j])


@inlined
def _depth_rule(frame, back_faces):
    """Return the rule of ``depth_test``."""
    if back_faces != 0:
        return ANY_ORDER
    is_bounded = frame.beyond_ids != 0 or frame.before_ids != 0 or frame.earlier_ids != 0
    return PEELED if is_bounded or frame.takes_latest != 0 else IN_ORDER


@device_function
def _draw_chunk(frame, target, chunk, band_index, rows, back_faces, tiles):
    """Draw what a CHUNK has in a band, ``rows``: first and end.

    Primitives are drawn in the order of their ids; pixels of tiny triangles compare ids themselves.
    """
    first_row, end_row = rows
    bin_index, begin_pixel, end_pixel = band_index, first_row * frame.stride, end_row * frame.stride
    if back_faces:
        bin_index += frame.first_back_bin
        begin_pixel, end_pixel = begin_pixel | BACK_BIT, end_pixel | BACK_BIT
    for k in range(0, chunk.count, vec.LANES):
        pending = primitives_in_bin(chunk, k, bin_index)
        while pending != 0:
            primitive = chunk.primitives[k + vec.lowest_bit(pending)]
            pending &= pending - 1
            if not (back_faces and _is_hidden(frame, primitive, tiles, first_row, end_row)):
                _draw_primitive(frame, target, primitive, first_row, end_row)
    _draw_pixels(frame, target, chunk, begin_pixel, end_pixel)


@kernel("void(int64, int64, int64, int64, int64)")
def draw_band(frame_address, first_row, end_row, band_memory, back_faces):
    """Rasterize a band.

    Args:
        frame_address: address of a FRAME.
        first_row, end_row: rows of the image, all of one band.
        band_memory: as for ``set_band_layer``.
        back_faces: 0: draw all but the back faces that are kept, into a cleared layer; 1: draw these on top of it.
    """
    frame = frame_at(frame_address)
    layer, target = _new_layer(), _new_target()
    set_band_layer(frame, layer, first_row, band_memory)
    target.layer, target.prepared, target.depth_rule = layer, _new_prepared(), _depth_rule(frame, back_faces)
    heap = np.int64(0)
    if back_faces == 0:
        _clear_rows(frame, layer, first_row, end_row)
    else:
        heap = allocate(4 * (BAND_ROWS // TILE_ROWS) * frame.stride)
        _build_depth_tiles(frame, layer, first_row, end_row, f32_at(heap))
    band_index = first_row // BAND_ROWS
    for index in range(frame.chunk_count):
        chunk = frame.chunks[index]
        if band_index >= chunk.first_band and band_index <= chunk.last_band:
            if is_set(frame.stop):
                break
            _draw_chunk(frame, target, chunk, band_index, (first_row, end_row), back_faces != 0, f32_at(heap))
    if back_faces != 0:
        release(heap)
