"""Setup: primitives to the bins of the bands that they touch."""

from __future__ import annotations

import numpy as np
from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import address, allocate, i32_at, release, stack_array, u16_at
from renderers.raster.cluster_culling import VIEW, view_clusters
from renderers.raster.layout import (
    BINNED_BYTES,
    CHUNK,
    DEFERRED_SETUP,
    LINES,
    MAX_BINS,
    SETUP_MEMORY,
    TINY_BIN,
    TINY_PIXELS,
    TINY_ROOM,
    TRIANGLES,
    binned_at,
    deferred_at,
    frame_at,
)
from renderers.raster.primitive_setup import line, point
from renderers.raster.triangle_setup import BAND_SHIFT, set_up_triangles

_new_memory = SETUP_MEMORY.local
_new_view = VIEW.local
_range_array = stack_array(types.int32, 2 * CHUNK)
_column_array = stack_array(types.int32, 16 * vec.LANES)
_request_at = DEFERRED_SETUP.at


@device_function
def _draw_of_primitive(frame, primitive):
    """Return the index of the draw that a drawn primitive belongs to."""
    low = 0
    high = frame.draw_count
    while high - low > 1:
        middle = (low + high) >> 1
        if frame.draws[middle].first_primitive <= primitive:
            low = middle
        else:
            high = middle
    return low


@device_function
def _set_up_line_or_point(frame, draw, primitive, memory, count):
    """Set up a line or a point; return the new ``count``."""
    out = binned_at(memory.binned + BINNED_BYTES * count)
    if draw.topology == LINES:
        first, last = line(frame, draw, primitive, out)
    else:
        first, last = point(frame, draw, primitive, out)
    if last < first:
        return count
    out.id = draw.first_id + primitive
    memory.bin_ranges[2 * count] = first
    memory.bin_ranges[2 * count + 1] = last
    return count + 1


@device_function
def _set_up_deferred(frame, request):
    """Set up a group of deferred back faces."""
    group = deferred_at(request.group)
    index, first = np.int64(group.draw), np.int64(group.first)
    draw = frame.draws[index]
    lanes = min(frame.draws[index + 1].first_primitive - draw.first_primitive - first, vec.LANES)
    view = _new_view()
    view.clusters = 0
    memory = request.memory
    count, pixel_count = set_up_triangles(
        frame, draw, index, first, first + lanes, np.int64(group.lanes), memory, 0, 0, view
    )
    _find_bins(frame, memory.tiny, pixel_count)
    for k in range(0, pixel_count, vec.LANES):
        _store_pixels(request.pixels, k, memory.tiny, k)
    request.count = count
    request.pixel_count = pixel_count


@device_function
def _find_bins(frame, tiny, count):
    """Write the bin of each pixel of tiny triangles, and clear BACK_BIT."""
    # The centre of a pixel: no product is nearer to an integer than half of 1/stride.
    half, row = vec.f64(0.5), vec.f64(1.0 / frame.stride)
    zero, backs = vec.i32(0), vec.i32(frame.bin_count - frame.band_count)
    for k in range(0, count, vec.LANES):
        marked = vec.load(tiny, k)
        pixels = marked & vec.i32(0x7FFFFFFF)
        bins = vec.to_i32((vec.to_f64(pixels) + half) * row) >> vec.i32(BAND_SHIFT)
        vec.store(tiny, k, pixels)
        vec.store(tiny, TINY_BIN + k, vec.select(marked < zero, bins + backs, bins))


@inlined
def _store_pixels(out, at, tiny, k):
    """Write eight pixels as quadruples."""
    w, ids = vec.load(tiny, TINY_ROOM + k), vec.load(tiny, 2 * TINY_ROOM + k)
    vec.store_quads(out, 4 * at, vec.load(tiny, k), w, ids, vec.load(tiny, TINY_BIN + k))


@inlined
def _append_pixel(out, fill, tiny, k):
    """Write a pixel as a quadruple to the end of its bin."""
    to = tiny[TINY_BIN + k]
    at = fill[to]
    fill[to] = at + 1
    for value in range(4):
        out[4 * at + value] = tiny[value * TINY_ROOM + k]


@inlined
def _widen(chunk_bands, band_count, first, last):
    """Widen a chunk's range of bands by the bins ``first .. last``."""
    side = 0
    if first >= band_count:
        side = 2
        first, last = first - band_count, last - band_count
    chunk_bands[side] = min(chunk_bands[side], first)
    chunk_bands[side + 1] = max(chunk_bands[side + 1], last)


@device_function
def _fill_bins(frame, chunk, memory, count, tiny_count, fill):
    """Sort a chunk's primitives and pixels into bins; primitives keep their order.

    ``FRAME.bin_starts`` of the chunk gets: starts of the bins in ``bins``, and their end; starts of the bins in
    ``tiny_pixels``, and their end; number of tall primitives in front, and of all.

    Args:
        fill: bin_count + 1 int32 of scratch.
    """
    bin_count, band_count = frame.bin_count, frame.band_count
    ranges, tiny = memory.bin_ranges, memory.tiny
    starts = i32_at(address(frame.bin_starts) + 4 * chunk * (2 * bin_count + 4))
    bins = u16_at(address(frame.bins) + 2 * chunk * CHUNK * MAX_BINS)
    tall = u16_at(address(frame.tall) + 2 * chunk * CHUNK)
    chunk_bands = i32_at(address(frame.chunk_bands) + 16 * chunk)
    for side in range(2):
        chunk_bands[2 * side] = band_count
        chunk_bands[2 * side + 1] = -1
    for each in range(bin_count):
        fill[each] = 0
    for k in range(count):
        first, last = ranges[2 * k], ranges[2 * k + 1]
        _widen(chunk_bands, band_count, first, last)
        if last - first < MAX_BINS:
            for each in range(first, last + 1):
                fill[each] += 1
    total = 0
    for each in range(bin_count):
        starts[each] = total
        total += fill[each]
        fill[each] = starts[each]
    starts[bin_count] = total
    tall_count = 0
    for k in range(count):
        first, last = ranges[2 * k], ranges[2 * k + 1]
        if last - first < MAX_BINS:
            for each in range(first, last + 1):
                bins[fill[each]] = k
                fill[each] += 1
        elif first < band_count:
            tall[tall_count] = k
            tall_count += 1
    starts[2 * bin_count + 2] = tall_count
    if bin_count > band_count:
        for k in range(count):
            first, last = ranges[2 * k], ranges[2 * k + 1]
            if last - first >= MAX_BINS and first >= band_count:
                tall[tall_count] = k
                tall_count += 1
    starts[2 * bin_count + 3] = tall_count

    pixel_starts = bin_count + 1
    for each in range(bin_count + 1):
        starts[pixel_starts + each] = 0
    # Eight neighbours mostly go to one bin; one by one, each would wait for the one before it.
    whole = tiny_count - tiny_count % vec.LANES
    for k in range(0, whole, vec.LANES):
        to = tiny[TINY_BIN + k]
        if vec.movemask(vec.load(tiny, TINY_BIN + k) == vec.i32(to)) == 255:
            starts[pixel_starts + 1 + to] += vec.LANES
        else:
            for j in range(k, k + vec.LANES):
                starts[pixel_starts + 1 + tiny[TINY_BIN + j]] += 1
    for k in range(whole, tiny_count):
        starts[pixel_starts + 1 + tiny[TINY_BIN + k]] += 1
    for each in range(bin_count):
        here = starts[pixel_starts + each + 1]
        if here != 0:
            _widen(chunk_bands, band_count, each, each)
        fill[each] = starts[pixel_starts + each]
        starts[pixel_starts + each + 1] = fill[each] + here
    out = i32_at(address(frame.tiny_pixels) + 16 * chunk * TINY_PIXELS * CHUNK)
    for k in range(0, whole, vec.LANES):
        to = tiny[TINY_BIN + k]
        if vec.movemask(vec.load(tiny, TINY_BIN + k) == vec.i32(to)) == 255:
            at = fill[to]
            _store_pixels(out, at, tiny, k)
            fill[to] = at + vec.LANES
        else:
            for j in range(k, k + vec.LANES):
                _append_pixel(out, fill, tiny, j)
    for k in range(whole, tiny_count):
        _append_pixel(out, fill, tiny, k)


@kernel("void(int64, int64, int64)")
def setup(frame_address, begin, end):
    """Set up and bin the chunks ``begin .. end`` of the drawn primitives.

    With ``begin`` = -1, ``end`` is the address of a DEFERRED_SETUP that is carried out instead.
    """
    frame = frame_at(frame_address)
    if begin < 0:
        _set_up_deferred(frame, _request_at(end))
        return
    memory, view = _new_memory(), _new_view()
    heap = allocate(4 * (4 * TINY_ROOM + frame.bin_count + 1))
    memory.bin_ranges, memory.columns = _range_array(), _column_array()
    memory.tiny = i32_at(heap)
    fill = i32_at(heap + 16 * TINY_ROOM)
    viewed = -1
    for chunk in range(begin, end):
        if is_set(frame.stop):
            break
        primitive = chunk * CHUNK
        chunk_end = min(primitive + CHUNK, frame.primitive_count)
        memory.binned = frame.binned + chunk * CHUNK * BINNED_BYTES
        count = 0
        tiny_count = 0
        index = _draw_of_primitive(frame, primitive)
        while primitive < chunk_end:
            draw = frame.draws[index]
            stop = min(chunk_end, frame.draws[index + 1].first_primitive)
            offset = draw.first_primitive
            if draw.topology == TRIANGLES:
                if index != viewed:
                    viewed = index
                    view_clusters(frame, draw, view)
                count, tiny_count = set_up_triangles(
                    frame, draw, index, primitive - offset, stop - offset, 0, memory, count, tiny_count, view
                )
            else:
                for k in range(primitive, stop):
                    count = _set_up_line_or_point(frame, draw, k - offset, memory, count)
            primitive = max(primitive, stop)
            index += 1
        _find_bins(frame, memory.tiny, tiny_count)
        _fill_bins(frame, chunk, memory, count, tiny_count, fill)
    release(heap)
