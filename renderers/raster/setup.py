"""Setup, the second phase of a frame: culls primitives, sets them up, and finds the bands that they touch."""

from __future__ import annotations

import numpy as np

from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import advance, as_f32
from renderers.raster.layout import (
    BACK_BIT,
    CHUNK_SIZE,
    CHUNK_VALUES,
    PIXEL_ROOM,
    TOPOLOGY_LINES,
    TOPOLOGY_TRIANGLES,
    frame_at,
)
from renderers.raster.primitive_setup import set_up_line, set_up_point
from renderers.raster.triangle_setup import set_up_triangles
from renderers.visibility_buffer import BAND_ROWS


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
def _set_up_line_or_point(frame, draw, primitive, chunk):
    """Set up a line or a point, and append it to a CHUNK if it may be visible.

    Args:
        primitive: index in its mesh.
    """
    count = chunk.count
    out = chunk.primitives[count]
    if draw.topology == TOPOLOGY_LINES:
        first_bin, last_bin = set_up_line(frame, draw, primitive, out)
    else:
        first_bin, last_bin = set_up_point(frame, draw, primitive, out)
    if first_bin <= last_bin:
        out.id = draw.first_id + primitive
        chunk.bins[count] = last_bin << 16 | first_bin
        chunk.count = count + 1


@device_function
def _find_bands(frame, chunk):
    """Set the first and last band of a CHUNK."""
    first_band, last_band = frame.band_count, np.int64(-1)
    for k in range(chunk.count):
        first_bin, last_bin = np.int64(chunk.bins[k] & 0xFFFF), np.int64(chunk.bins[k] >> 16)
        bin_of_band_0 = frame.first_back_bin if first_bin >= frame.band_count else 0
        first_band = min(first_band, first_bin - bin_of_band_0)
        last_band = max(last_band, last_bin - bin_of_band_0)
    if chunk.pixel_count != 0:
        first_pixel = last_pixel = chunk.pixels[0] & ~BACK_BIT
        for k in range(1, chunk.pixel_count):
            pixel = chunk.pixels[k] & ~BACK_BIT
            first_pixel, last_pixel = min(first_pixel, pixel), max(last_pixel, pixel)
        first_band = min(first_band, first_pixel // (BAND_ROWS * frame.stride))
        last_band = max(last_band, last_pixel // (BAND_ROWS * frame.stride))
    chunk.first_band, chunk.last_band = first_band, last_band


@kernel("void(int64, int64, int64)")
def setup(frame_address, begin, end):
    """Set up the chunks ``begin .. end`` of the drawn primitives."""
    frame = frame_at(frame_address)
    for index in range(begin, end):
        if is_set(frame.stop):
            break
        chunk, primitive = frame.chunks[index], index * CHUNK_SIZE
        chunk.primitives, chunk.bins = frame.primitives[primitive], advance(frame.chunk_memory, index * CHUNK_VALUES)
        chunk.pixels = advance(chunk.bins, CHUNK_SIZE)
        chunk.pixel_inv_z = as_f32(advance(chunk.pixels, PIXEL_ROOM))
        chunk.pixel_ids = advance(chunk.pixels, 2 * PIXEL_ROOM)
        chunk.count = chunk.pixel_count = 0
        chunk_end = min(primitive + CHUNK_SIZE, frame.primitive_count)
        draw_index = _draw_of_primitive(frame, primitive)
        while primitive < chunk_end:
            draw = frame.draws[draw_index]
            draw_end = min(chunk_end, frame.draws[draw_index + 1].first_primitive)
            first = draw.first_primitive
            if draw.topology == TOPOLOGY_TRIANGLES:
                set_up_triangles(frame, draw_index, primitive - first, draw_end - first, chunk)
            else:
                for k in range(primitive, draw_end):
                    _set_up_line_or_point(frame, draw, k - first, chunk)
            primitive = max(primitive, draw_end)
            draw_index += 1
        _find_bands(frame, chunk)
