"""Setup, the second phase of a frame: culls primitives, sets them up, and finds the bands that they touch."""

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import I64, Address, i64
from renderers.compiler.pointers import advance, as_f32
from renderers.raster.chunks import append_primitive, bins_of
from renderers.raster.layout import (
    CHUNK_SIZE,
    CHUNK_WORDS,
    FRAGMENT_CAPACITY,
    KEPT_BACK_BIT,
    LINE_VERTICES,
    TRIANGLE_VERTICES,
    Chunk,
    Draw,
    RasterFrame,
    draw_of,
)
from renderers.raster.primitive_setup import set_up_line, set_up_point
from renderers.raster.triangle_setup import set_up_triangles
from renderers.visibility_buffer import BAND_ROWS


@inlined
def _begin_chunk(frame: RasterFrame, index: I64) -> Chunk:
    """Return Chunk ``index``, empty. Its memory holds ranges of bins, then pixels, the pixels' 1/z and the pixels' ids.

    Its primitives are the slice of RasterFrame.primitives from ``index * CHUNK_SIZE`` on: assigning sets the pointer.
    """
    chunk = frame.chunks[index]
    chunk.primitives = frame.primitives[index * CHUNK_SIZE]
    chunk.bin_ranges = advance(frame.chunk_memory, index * CHUNK_WORDS)
    chunk.fragment_pixels = advance(chunk.bin_ranges, CHUNK_SIZE)
    fragment_inv_z = advance(chunk.fragment_pixels, FRAGMENT_CAPACITY)
    chunk.fragment_inv_z, chunk.fragment_ids = as_f32(fragment_inv_z), advance(fragment_inv_z, FRAGMENT_CAPACITY)
    chunk.primitive_count = chunk.fragment_count = 0
    return chunk


@device_function
def _set_up_line_or_point(frame: RasterFrame, draw: Draw, primitive_in_mesh: I64, chunk: Chunk) -> None:
    """Set up a line or a point, and append it to a Chunk if it may be visible."""
    primitive = chunk.primitives[chunk.primitive_count]  # append_primitive keeps it only if it touches a bin
    if draw.vertices_per_primitive == LINE_VERTICES:
        first_bin, last_bin = set_up_line(frame, draw, primitive_in_mesh, primitive)
    else:  # a point
        first_bin, last_bin = set_up_point(frame, draw, primitive_in_mesh, primitive)
    primitive.id = draw.first_id + primitive_in_mesh
    append_primitive(chunk, first_bin, last_bin)


@inlined
def _set_up_primitives(frame: RasterFrame, chunk: Chunk, begin: I64, end: I64) -> None:
    """Set up primitives, and append what may be visible to a Chunk; ``begin``, ``end``: range of drawn indices."""
    draw_index = draw_of(frame, begin, False)
    draw_begin = begin
    while draw_begin < end:
        draw = frame.draws[draw_index]
        draw_end = min(end, frame.draws[draw_index + 1].first_frame_primitive)
        first_of_draw = draw.first_frame_primitive
        if draw.vertices_per_primitive == TRIANGLE_VERTICES:
            set_up_triangles(frame, draw_index, draw_begin - first_of_draw, draw_end - first_of_draw, chunk)
        else:
            for frame_primitive in range(draw_begin, draw_end):
                _set_up_line_or_point(frame, draw, frame_primitive - first_of_draw, chunk)
        draw_begin = draw_end
        draw_index += 1


@device_function
def _find_bands(frame: RasterFrame, chunk: Chunk) -> None:
    """Set the first and last band of a Chunk."""
    first_band, last_band = frame.band_count, i64(-1)
    for k in range(chunk.primitive_count):
        first_bin, last_bin = bins_of(chunk, k)
        # A primitive is in front bins or in back bins only. ``first_back_bin`` is band_count if back faces are kept. If
        # none are (it is 0), no bin reaches band_count.
        base_bin = frame.band_count if first_bin >= frame.band_count else 0
        first_band = min(first_band, first_bin - base_bin)
        last_band = max(last_band, last_bin - base_bin)
    if chunk.fragment_count != 0:
        first_pixel = last_pixel = chunk.fragment_pixels[0] & ~KEPT_BACK_BIT
        for k in range(1, chunk.fragment_count):
            pixel = chunk.fragment_pixels[k] & ~KEPT_BACK_BIT
            first_pixel, last_pixel = min(first_pixel, pixel), max(last_pixel, pixel)
        first_band = min(first_band, first_pixel // (BAND_ROWS * frame.stride))
        last_band = max(last_band, last_pixel // (BAND_ROWS * frame.stride))
    chunk.first_band, chunk.last_band = first_band, last_band


@kernel
def setup(frame_address: Address, begin_chunk: I64, end_chunk: I64) -> None:
    """Set up the chunks ``begin_chunk .. end_chunk`` of the drawn primitives of the RasterFrame at an address."""
    frame = RasterFrame(frame_address)
    for index in range(begin_chunk, end_chunk):
        if is_set(frame.stop):
            break
        chunk = _begin_chunk(frame, index)
        first = index * CHUNK_SIZE
        _set_up_primitives(frame, chunk, first, min(first + CHUNK_SIZE, frame.primitive_count))
        _find_bands(frame, chunk)
