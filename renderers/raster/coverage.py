"""Rasterization of a band with one sample per pixel: coverage and depth test of what setup has binned."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_calls import call_kernel, is_set
from renderers.compiler.pointers import (
    address,
    allocate,
    as_f32,
    as_i32,
    f32_at,
    i32_at,
    release,
    stack_array,
    u16_at,
)
from renderers.compiler.structs import I64, Struct
from renderers.raster.depth_test import ANY_ORDER, IN_ORDER, PEELED, depth_test, depth_test_pixel
from renderers.raster.fill import filler
from renderers.raster.layout import (
    BINNED_BYTES,
    CHUNK,
    DEFERRED,
    DEFERRED_SETUP,
    HALF,
    LAYER,
    MAX_BINS,
    SETUP_MEMORY,
    SMALL,
    SUBPIXEL,
    TINY,
    TINY_PIXELS,
    TINY_ROOM,
    binned_at,
    small_at,
)
from renderers.raster.small_triangles import PREPARED_VALUES, box_of, draw_small, prepare_small
from renderers.visibility_buffer import BAND_ROWS

BAND: Final = Struct("Band", {"layer": LAYER, "prepared": I64, "free": I64})
"""What a band is drawn into, and addresses of two arrays of PREPARED_VALUES int32: a small triangle that waits to be
drawn, and room for the next one."""
new_band: Final = BAND.local
_prepared_array = stack_array(types.int32, 2 * PREPARED_VALUES)
_starts_array = stack_array(types.float32, vec.LANES)
_columns_array = stack_array(types.int32, 2 * vec.LANES)
_layer_at = LAYER.at


@inlined
def _points(frame, row):
    """Return the centres of eight rows."""
    lane = vec.to_f64(vec.iota())
    return vec.f64(0.0), (vec.f64(row) + lane) * vec.f64(float(SUBPIXEL)) + vec.f64(float(HALF))


@inlined
def _draw_span_by(frame, band, rule, primitive, row, start, stop, box_x, box_y):
    """``_draw_span`` for any rule, or for a constant one."""
    layer = band.layer
    slope = primitive.dx
    base = primitive.base + primitive.dy * np.float64(row - box_y)
    low, high = vec.f32(primitive.low), vec.f32(primitive.high)
    ids = vec.i32(primitive.id)
    lane = vec.iota()
    rising = vec.f32(slope) * vec.to_f32(lane)
    first, last, eight = vec.i32(start), vec.i32(stop), vec.i32(vec.LANES)
    every = lane == lane
    starts = _starts_array()
    blocks = vec.to_f64(lane * eight)
    begin = start & ~np.int64(vec.LANES - 1)
    pixel = row * frame.stride + begin
    for column in range(begin, stop, vec.LANES * vec.LANES):
        at = vec.f64(column - box_x) + blocks
        vec.store(starts, 0, vec.to_f32(vec.f64(base) + vec.f64(slope) * at))
        if column >= start and column + vec.LANES * vec.LANES <= stop:
            for k in range(vec.LANES):
                w = vec.minimum(vec.maximum(vec.f32(starts[k]) + rising, low), high)
                depth_test(frame, layer, rule, pixel + vec.LANES * k, w, every, ids)
            pixel += vec.LANES * vec.LANES
        else:
            here = vec.i32(column) + lane
            for k in range(min((stop - column + vec.LANES - 1) // vec.LANES, vec.LANES)):
                w = vec.minimum(vec.maximum(vec.f32(starts[k]) + rising, low), high)
                depth_test(frame, layer, rule, pixel, w, (here >= first) & (here < last), ids)
                here = here + eight
                pixel += vec.LANES


@device_function
def _draw_span(frame, band, rule, primitive, row, start, stop, box_x, box_y):
    """Draw the pixels ``start .. stop`` of a row; ``box_x, box_y`` is the pixel that ``primitive.base`` belongs to.

    1/z is exact to float32 at the first of every eight pixels, wherever the span starts.
    """
    if rule == IN_ORDER:
        _draw_span_by(frame, band, IN_ORDER, primitive, row, start, stop, box_x, box_y)
    else:
        _draw_span_by(frame, band, rule, primitive, row, start, stop, box_x, box_y)


@inlined
def _draw_spans(frame, band, rule, primitive, row, count, start, stop, box_x, box_y):
    """Draw ``count`` rows from ``row`` on, one per lane."""
    columns = _columns_array()
    vec.store(columns, 0, start)
    vec.store(columns, vec.LANES, stop)
    for k in range(count):
        begin, end = np.int64(columns[k]), np.int64(columns[vec.LANES + k])
        if begin < end:
            _draw_span(frame, band, rule, primitive, row + k, begin, end, box_x, box_y)


@inlined
def _draw_point(frame, band, rule, primitive, first_row, last_row):
    """Draw a POINT."""
    xy = primitive.xy
    left, top, right, bottom = np.int64(xy[0]), np.int64(xy[1]), np.int64(xy[2]), np.int64(xy[3])
    for row in range(max(top, first_row), min(bottom, last_row)):
        _draw_span(frame, band, rule, primitive, row, left, right, left, top)


_fill = filler(vec.LANES, _points, _draw_spans, _draw_point)


@device_function
def _draw(frame, band, rule, place, first_row, last_row):
    """Draw the part of a binned primitive, at address ``place``, that lies in the rows ``first_row .. last_row``."""
    primitive = binned_at(place)
    if primitive.kind == SMALL:
        free = i32_at(band.free)
        prepare_small(frame, small_at(place), first_row, last_row, free)
        draw_small(frame, band.layer, rule, free)
    elif not is_set(frame.stop):  # a large one may take longer than hundreds of small ones
        _fill(frame, band, rule, primitive, first_row, last_row)


@device_function
def clear_rows(frame, layer, first_row, last_row):
    """Clear a layer's rows."""
    stride = frame.stride
    # Nothing at or beyond this 1/z passes the depth test: the far plane needs no test of its own.
    empty = vec.f32(np.nextafter(np.float32(1.0 / frame.far), np.float32(-1.0)))
    no_id = vec.i32(-1)
    # One array after the other: consecutive stores to a cache line are combined.
    for pixel in range(first_row * stride, last_row * stride, vec.LANES):
        vec.store(layer.ids, pixel, no_id)
    for pixel in range(first_row * stride, last_row * stride, vec.LANES):
        vec.store(layer.inv_z, pixel, empty)


TILE_ROWS: Final = 8


@device_function
def _build_depth_tiles(frame, layer, first_row, last_row, tiles):
    """Write the least 1/z of every tile, TILE_ROWS rows of eight columns: what lies farther is hidden there.

    Args:
        tiles: a row of ``stride`` float32 per row of tiles, of which the first of every eight is the result.
    """
    stride = frame.stride
    bits = as_i32(tiles)
    for top in range(first_row, last_row, TILE_ROWS):
        out = (top - first_row) // TILE_ROWS * stride
        bottom = min(top + TILE_ROWS, last_row)
        for column in range(0, stride, vec.LANES):
            least = vec.load(layer.inv_z, top * stride + column)
            for row in range(top + 1, bottom):
                least = vec.minimum(least, vec.load(layer.inv_z, row * stride + column))
            # Bits are ordered as the values are: none is negative but that of empty pixels.
            bits[out + column] = vec.minimum_of(vec.float_bits(least))


@device_function
def _is_hidden(frame, place, tiles, first_row, last_row):
    """Return whether a SMALL or DEFERRED primitive lies behind everything in the tiles around its box."""
    primitive = small_at(place)
    if primitive.kind != SMALL and primitive.kind != DEFERRED:
        return False
    left, box_top, columns, rows = box_of(primitive)
    right = min(left + columns, frame.width)
    top, bottom = max(box_top, first_row) - first_row, min(box_top + rows, last_row) - first_row
    begin = (max(left, 0) >> 3) << 3
    high = primitive.high
    hidden = True
    for tile in range(top // TILE_ROWS, (bottom + TILE_ROWS - 1) // TILE_ROWS):
        row = tile * frame.stride
        for column in range(row + begin, row + right, vec.LANES):
            hidden = hidden & (high < tiles[column])
    return hidden


_request = DEFERRED_SETUP.local
_setup_memory = SETUP_MEMORY.local
_group_binned_array = stack_array(types.int64, vec.LANES * BINNED_BYTES // 8)
_group_ranges_array = stack_array(types.int32, 2 * vec.LANES)
_group_columns_array = stack_array(types.int32, 16 * vec.LANES)
_group_pixels_array = stack_array(types.int32, 4 * vec.LANES * TINY * TINY)


@device_function
def _draw_deferred(frame, band, rule, place, bin_index, first_row, last_row, tiny):
    """Set up a group of deferred back faces and draw the part of it that lies in the band.

    Args:
        bin_index: the band's bin of back faces. tiny: 4 * TINY_ROOM int32 of scratch.
    """
    request, memory = _request(), _setup_memory()
    memory.binned = address(_group_binned_array())
    memory.bin_ranges, memory.columns, memory.tiny = _group_ranges_array(), _group_columns_array(), tiny
    request.group = place
    request.memory = memory
    request.pixels = _group_pixels_array()
    call_kernel(frame.setup_kernel, (address(frame), np.int64(-1), address(request)))
    for k in range(request.count):
        _draw(frame, band, rule, memory.binned + k * BINNED_BYTES, first_row, last_row)
    pixels = request.pixels
    for k in range(request.pixel_count):
        if pixels[4 * k + 3] == bin_index:
            _draw_pixels_in_rows(frame, band.layer, rule, pixels, k, k + 1, first_row, last_row)


@device_function
def _draw_pixels(frame, layer, rule, pixels, begin, end):
    """Draw the pixels ``begin .. end`` of tiny triangles."""
    inverse = as_f32(pixels)
    for k in range(begin, end):
        depth_test_pixel(frame, layer, rule, np.int64(pixels[4 * k]), inverse[4 * k + 1], pixels[4 * k + 2])


@device_function
def _draw_pixels_in_rows(frame, layer, rule, pixels, begin, end, first_row, last_row):
    """``_draw_pixels``, of those in some rows."""
    first, last = first_row * frame.stride, last_row * frame.stride
    for k in range(begin, end):
        if pixels[4 * k] >= first and pixels[4 * k] < last:
            _draw_pixels(frame, layer, rule, pixels, k, k + 1)


_PRIMITIVES_AHEAD: Final = 6
"""Binned primitives that are prefetched."""
_LINES_AHEAD: Final = 4
"""Cache lines of pixels of tiny triangles that are prefetched; hardware goes on by itself."""


@inlined
def _prefetch_chunk(frame, chunk, bin_index, step):
    """Prefetch what a band needs of a later chunk: bin starts (step 0), the bin (1), its first primitives (2).

    A band needs only a few values of every chunk, each in a cache line of its own.
    """
    chunk = min(chunk, frame.chunk_count - 1)
    bin_count = frame.bin_count
    starts = i32_at(address(frame.bin_starts) + 4 * chunk * (2 * bin_count + 4))
    if step == 0:
        vec.prefetch(starts, bin_index)
        vec.prefetch(starts, bin_count + 1 + bin_index)
        vec.prefetch(starts, 2 * bin_count + 2)
        return
    begin = np.int64(starts[bin_index])
    bins = u16_at(address(frame.bins) + 2 * chunk * CHUNK * MAX_BINS)
    if step == 1:
        vec.prefetch(bins, begin)
        pixels = i32_at(address(frame.tiny_pixels) + 16 * chunk * TINY_PIXELS * CHUNK)
        first = 4 * np.int64(starts[bin_count + 1 + bin_index])
        for cache_line in range(_LINES_AHEAD):
            vec.prefetch(pixels, first + 16 * cache_line)
        return
    primitives = i32_at(frame.binned + chunk * CHUNK * BINNED_BYTES)
    last = max(np.int64(starts[bin_index + 1]) - 1, 0)
    for k in range(_PRIMITIVES_AHEAD):
        vec.prefetch(primitives, BINNED_BYTES // 4 * np.int64(bins[min(begin + k, last)]))


@inlined
def _next_primitive(bins, k, end, tall, t, tall_end):
    """Merge a bin and its chunk's tall primitives: return the lowest index left and the new positions in both.

    Not both may be at their ends.
    """
    if t >= tall_end or (k < end and bins[k] < tall[t]):
        return np.int64(bins[k]), k + 1, t
    return np.int64(tall[t]), k, t + 1


@device_function
def _has_kept_backs(frame, band_index):
    """Return whether any chunk has kept back faces in a band."""
    reached = False
    for chunk in range(frame.chunk_count):
        bands = i32_at(address(frame.chunk_bands) + 16 * chunk + 8)
        reached = reached | ((band_index >= bands[0]) & (band_index <= bands[1]))
    return reached


@device_function
def draw_rows(frame, layer, first_row, last_row, back):
    """Draw everything that touches the rows of a band, or of a part of one.

    Primitives are drawn in the order of their ids; pixels of tiny triangles compare ids themselves.

    Args:
        back: draw the back faces that were kept apart, on top of the others.
    """
    band_index = first_row // BAND_ROWS
    whole = last_row - first_row == min(BAND_ROWS, frame.height - band_index * BAND_ROWS)
    band = new_band()
    band.layer = layer
    band.prepared = address(_prepared_array())
    band.free = band.prepared + 4 * PREPARED_VALUES
    rule = IN_ORDER
    if frame.beyond_ids != 0 or frame.before_ids != 0:
        rule = PEELED
    bin_count = frame.bin_count
    bin_index = band_index
    heap = np.int64(0)
    if back:
        if not _has_kept_backs(frame, band_index):
            return
        rule = ANY_ORDER
        bin_index += frame.band_count
        heap = allocate(16 * TINY_ROOM + 4 * (BAND_ROWS // TILE_ROWS) * frame.stride)
    tiny, tiles = i32_at(heap), f32_at(heap + 16 * TINY_ROOM)
    if back:
        _build_depth_tiles(frame, layer, first_row, last_row, tiles)
    chunk_bands = i32_at(address(frame.chunk_bands) + (8 if back else 0))
    for chunk in range(frame.chunk_count):
        if band_index < chunk_bands[4 * chunk] or band_index > chunk_bands[4 * chunk + 1]:
            continue
        if is_set(frame.stop):
            break
        for step in range(3):
            _prefetch_chunk(frame, chunk + 3 - step, bin_index, step)
        starts = i32_at(address(frame.bin_starts) + 4 * chunk * (2 * bin_count + 4))
        k, end = np.int64(starts[bin_index]), np.int64(starts[bin_index + 1])
        t, tall_end = np.int64(0), np.int64(starts[2 * bin_count + 2])
        if back:
            t, tall_end = tall_end, np.int64(starts[2 * bin_count + 3])
        bins = u16_at(address(frame.bins) + 2 * chunk * CHUNK * MAX_BINS)
        tall = u16_at(address(frame.tall) + 2 * chunk * CHUNK)
        primitives = frame.binned + chunk * CHUNK * BINNED_BYTES
        if back or rule != IN_ORDER:
            while k < end or t < tall_end:
                index, k, t = _next_primitive(bins, k, end, tall, t, tall_end)
                place = primitives + index * BINNED_BYTES
                if back and _is_hidden(frame, place, tiles, first_row, last_row):
                    continue
                if binned_at(place).kind == DEFERRED:
                    _draw_deferred(frame, band, rule, place, bin_index, first_row, last_row, tiny)
                else:
                    _draw(frame, band, rule, place, first_row, last_row)
        else:
            # A small triangle is prepared before the previous one is drawn: their loops' lengths are known early.
            ready = False
            while ready or k < end or t < tall_end:
                place, is_small, was_ready = np.int64(0), False, ready
                if k < end or t < tall_end:
                    index, k, t = _next_primitive(bins, k, end, tall, t, tall_end)
                    later = np.int64(bins[max(min(k + _PRIMITIVES_AHEAD, end - 1), 0)])
                    vec.prefetch(i32_at(primitives), BINNED_BYTES // 4 * later)
                    place = primitives + index * BINNED_BYTES
                    is_small = binned_at(place).kind == SMALL
                    if is_small:
                        prepare_small(frame, small_at(place), first_row, last_row, i32_at(band.free))
                if was_ready:
                    draw_small(frame, layer, IN_ORDER, i32_at(band.prepared))
                if place != 0 and not is_small:
                    _draw(frame, band, rule, place, first_row, last_row)
                ready = is_small
                band.free, band.prepared = band.prepared, band.free
        pixels = i32_at(address(frame.tiny_pixels) + 16 * chunk * TINY_PIXELS * CHUNK)
        begin, end = np.int64(starts[bin_count + 1 + bin_index]), np.int64(starts[bin_count + 2 + bin_index])
        if whole:
            _draw_pixels(frame, layer, rule, pixels, begin, end)
        else:
            _draw_pixels_in_rows(frame, layer, rule, pixels, begin, end, first_row, last_row)
    if back:
        release(heap)
