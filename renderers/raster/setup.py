"""Setup, the second phase of a frame: culls and sets up primitives, and sorts them into the bins of bands."""

from __future__ import annotations

from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import advance, allocate, i32_at, release, stack_array
from renderers.raster.chunks import bands_of, bin_starts_of, bins_of, primitives_of, tall_of, tiny_pixels_of
from renderers.raster.layout import (
    CHUNK,
    MAX_BINS,
    SETUP_MEMORY,
    TINY_BINS,
    TINY_STRIDE,
    TOPOLOGY_LINES,
    TOPOLOGY_TRIANGLES,
    frame_at,
)
from renderers.raster.primitive_setup import set_up_line, set_up_point
from renderers.raster.triangle_setup import BAND_SHIFT, set_up_triangles

_new_memory = SETUP_MEMORY.local
_range_array = stack_array(types.int32, 2 * CHUNK)
_column_array = stack_array(types.int32, 16 * vec.LANES)


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
def _set_up_line_or_point(frame, draw, primitive, memory):
    """Set up a line or a point.

    Args:
        primitive: index in its mesh.
    """
    count = memory.count
    out = memory.binned[count]
    if draw.topology == TOPOLOGY_LINES:
        first_bin, last_bin = set_up_line(frame, draw, primitive, out)
    else:
        first_bin, last_bin = set_up_point(frame, draw, primitive, out)
    if first_bin <= last_bin:
        out.id = draw.first_id + primitive
        memory.bin_ranges[2 * count] = first_bin
        memory.bin_ranges[2 * count + 1] = last_bin
        memory.count = count + 1


@device_function
def _find_pixel_bins(frame, memory):
    """Write the bin of each pixel of tiny triangles, and clear BACK_BIT."""
    pixels = memory.tiny_pixels
    # Half a pixel is added so that no product is nearer to an integer than half of 1/stride.
    half, rows_per_pixel = vec.f64(0.5), vec.f64(1.0 / frame.stride)
    zero, back_bins = vec.i32(0), vec.i32(frame.bin_count - frame.band_count)
    for k in range(0, memory.tiny_count, vec.LANES):
        marked = vec.load(pixels, k)
        pixel = marked & vec.i32(0x7FFFFFFF)
        bins = vec.to_i32((vec.to_f64(pixel) + half) * rows_per_pixel) >> vec.i32(BAND_SHIFT)
        vec.store(pixels, k, pixel)
        vec.store(pixels, TINY_BINS + k, vec.select(marked < zero, bins + back_bins, bins))


@inlined
def _store_pixels(out, position, pixels, k):
    """Write the eight pixels from ``k`` on to ``out`` as quadruples, from ``position`` on."""
    inv_z, ids = vec.load(pixels, TINY_STRIDE + k), vec.load(pixels, 2 * TINY_STRIDE + k)
    vec.store_quads(out, 4 * position, vec.load(pixels, k), inv_z, ids, vec.load(pixels, TINY_BINS + k))


@inlined
def _append_pixel(out, bin_ends, pixels, k):
    """Write pixel ``k`` to the end of its bin."""
    bin_index = pixels[TINY_BINS + k]
    position = bin_ends[bin_index]
    bin_ends[bin_index] = position + 1
    for field in range(4):
        out[4 * position + field] = pixels[field * TINY_STRIDE + k]


@inlined
def _widen(chunk_bands, band_count, first_bin, last_bin):
    """Widen a chunk's range of bands to contain some bins."""
    faces = 0
    if first_bin >= band_count:  # of back faces that are kept
        faces = 2
        first_bin, last_bin = first_bin - band_count, last_bin - band_count
    chunk_bands[faces] = min(chunk_bands[faces], first_bin)
    chunk_bands[faces + 1] = max(chunk_bands[faces + 1], last_bin)


@inlined
def _share_bin(pixels, k):
    """Return whether the eight pixels from ``k`` on are in one bin."""
    return vec.movemask(vec.load(pixels, TINY_BINS + k) == vec.i32(pixels[TINY_BINS + k])) == 255


@inlined
def _list_tall(ranges, count, begin_bin, end_bin, tall, tall_count):
    """Append the primitives of more than MAX_BINS bins whose first one is in a range; return the new ``tall_count``."""
    for k in range(count):
        first_bin, last_bin = ranges[2 * k], ranges[2 * k + 1]
        if last_bin - first_bin >= MAX_BINS and first_bin >= begin_bin and first_bin < end_bin:
            tall[tall_count] = k
            tall_count += 1
    return tall_count


@device_function
def _bin_primitives(frame, chunk, memory, bin_ends):
    """Sort a chunk's primitives into bins, in which they keep their order; ``bin_ends``: bin_count int32 of scratch."""
    bin_count, band_count, count, ranges = frame.bin_count, frame.band_count, memory.count, memory.bin_ranges
    starts, bins = bin_starts_of(frame, chunk), bins_of(frame, chunk)
    tall, chunk_bands = tall_of(frame, chunk), bands_of(frame, chunk)
    for faces in range(2):
        chunk_bands[2 * faces] = band_count
        chunk_bands[2 * faces + 1] = -1
    for k in range(bin_count):
        bin_ends[k] = 0
    for k in range(count):
        first_bin, last_bin = ranges[2 * k], ranges[2 * k + 1]
        _widen(chunk_bands, band_count, first_bin, last_bin)
        if last_bin - first_bin < MAX_BINS:
            for bin_index in range(first_bin, last_bin + 1):
                bin_ends[bin_index] += 1
    total = 0
    for k in range(bin_count):
        starts[k] = total
        total += bin_ends[k]
        bin_ends[k] = starts[k]
    starts[bin_count] = total
    for k in range(count):
        first_bin, last_bin = ranges[2 * k], ranges[2 * k + 1]
        if last_bin - first_bin < MAX_BINS:
            for bin_index in range(first_bin, last_bin + 1):
                bins[bin_ends[bin_index]] = k
                bin_ends[bin_index] += 1
    tall_count = _list_tall(ranges, count, 0, band_count, tall, 0)
    starts[2 * bin_count + 2] = tall_count
    if bin_count > band_count:
        tall_count = _list_tall(ranges, count, band_count, bin_count, tall, tall_count)
    starts[2 * bin_count + 3] = tall_count


@device_function
def _bin_tiny_pixels(frame, chunk, memory, bin_ends):
    """Sort a chunk's pixels of tiny triangles into bins; arguments as for ``_bin_primitives``, which comes first."""
    bin_count, count, pixels = frame.bin_count, memory.tiny_count, memory.tiny_pixels
    starts = advance(bin_starts_of(frame, chunk), bin_count + 1)
    chunk_bands, out = bands_of(frame, chunk), tiny_pixels_of(frame, chunk)
    for k in range(bin_count + 1):
        starts[k] = 0
    # Eight neighbours mostly go to one bin; one by one, each would wait for the one before it.
    whole = count - count % vec.LANES
    for k in range(0, whole, vec.LANES):
        if _share_bin(pixels, k):
            starts[1 + pixels[TINY_BINS + k]] += vec.LANES
        else:
            for j in range(k, k + vec.LANES):
                starts[1 + pixels[TINY_BINS + j]] += 1
    for k in range(whole, count):
        starts[1 + pixels[TINY_BINS + k]] += 1
    for k in range(bin_count):
        size = starts[k + 1]
        if size != 0:
            _widen(chunk_bands, frame.band_count, k, k)
        bin_ends[k] = starts[k]
        starts[k + 1] = bin_ends[k] + size
    for k in range(0, whole, vec.LANES):
        bin_index = pixels[TINY_BINS + k]
        if _share_bin(pixels, k):
            position = bin_ends[bin_index]
            _store_pixels(out, position, pixels, k)
            bin_ends[bin_index] = position + vec.LANES
        else:
            for j in range(k, k + vec.LANES):
                _append_pixel(out, bin_ends, pixels, j)
    for k in range(whole, count):
        _append_pixel(out, bin_ends, pixels, k)


@kernel("void(int64, int64, int64)")
def setup(frame_address, begin, end):
    """Set up and bin the chunks ``begin .. end`` of the drawn primitives."""
    frame = frame_at(frame_address)
    memory = _new_memory()
    heap = allocate(4 * (4 * TINY_STRIDE + frame.bin_count + 1))
    memory.bin_ranges, memory.columns = _range_array(), _column_array()
    memory.tiny_pixels = i32_at(heap)
    bin_ends = advance(memory.tiny_pixels, 4 * TINY_STRIDE)
    for chunk in range(begin, end):
        if is_set(frame.stop):
            break
        memory.binned = primitives_of(frame, chunk)
        memory.count = memory.tiny_count = 0
        primitive = chunk * CHUNK
        chunk_end = min(primitive + CHUNK, frame.primitive_count)
        draw_index = _draw_of_primitive(frame, primitive)
        while primitive < chunk_end:
            draw = frame.draws[draw_index]
            draw_end = min(chunk_end, frame.draws[draw_index + 1].first_primitive)
            first = draw.first_primitive
            if draw.topology == TOPOLOGY_TRIANGLES:
                set_up_triangles(frame, draw_index, primitive - first, draw_end - first, memory)
            else:
                for k in range(primitive, draw_end):
                    _set_up_line_or_point(frame, draw, k - first, memory)
            primitive = max(primitive, draw_end)
            draw_index += 1
        _find_pixel_bins(frame, memory)
        _bin_primitives(frame, chunk, memory, bin_ends)
        _bin_tiny_pixels(frame, chunk, memory, bin_ends)
    release(heap)
