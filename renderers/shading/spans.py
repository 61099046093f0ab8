"""Spans: neighbouring pixels of a row that see one primitive. Segments: neighbouring spans of one instance.

primitive ids   7 7 7 7 3 3 9 9 9 . . 7     instance A has the ids 0 to 8, B those from 9 on; MAX_PART_PIXELS is 4 here
start bits      1 0 0 0 1 0 1 0 1 1 0 1     ``find_spans``: the id differs from the one before, or pixel 0, 4, 8, ...
spans           |7      |3  |9  |9|.  |7    a . is the background, whose segments have no instance
segments        |A          |B    |   |A    ``bind_next_segment`` selects the segment's instance and material
parts           |       |   |   | |   |     ``find_part_end`` cuts segments at pixels 4, 8, ...; parts are shaded

The ``shade_rows`` of a look calls these functions in this order.
"""

from typing import Final, NamedTuple

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import I32, I64, Address, Pointer, i64
from renderers.compiler.pointers import address, advance, allocate, i32_at, i64_at, release
from renderers.primitive_ids import instance_of
from renderers.shading.layout import (
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    MAX_PART_PIXELS,
    UNLIT,
    PartPixels,
    PartSpans,
    ShadingContext,
    ShadingInputs,
)

NO_PRIMITIVE: Final = -1
"""Primitive id of pixels that see the background."""
_ID_BEYOND_ROW: Final = -(2**31)
"""Id of pixels beyond the row; differs from every primitive id and from NO_PRIMITIVE."""
_PIXELS_PER_WORD: Final = 64
"""Pixels whose start bits are one int64."""
assert MAX_PART_PIXELS % _PIXELS_PER_WORD == 0  # so that every MAX_PART_PIXELS-th pixel has the first bit of a word
assert MAX_PART_PIXELS & (MAX_PART_PIXELS - 1) == 0
_ALL_BITS: Final = -1
_HIGHEST_BIT: Final = -(2**63)


class NextSegment(NamedTuple):
    """A segment that ``bind_next_segment`` has found."""

    end_span: I64
    """Index of the span after its last one."""
    instance_index: I64
    """Index of the instance that it sees; for the background, that of the segment before."""
    is_background: bool
    """True: it sees no primitive, and no instance is bound."""


class PartEnd(NamedTuple):
    """End of a part: indices in the row of the pixel after its last one, and of the span after its last one."""

    end_pixel: I64
    end_span: I64


_START_BITS: Final = (np.arange(128)[:, None] >> np.arange(7)) & 1
SPAN_INDEX_OF_START_BITS: Final = np.pad(np.cumsum(_START_BITS, axis=1, dtype=np.int32), ((0, 0), (1, 0)))
"""(128, 8): the span of each of eight pixels, counted from that of the first, for ``interpolate``. A row's index has a
start bit for each of the other seven pixels: bit 0 is the second pixel's. In row 0b101, spans begin at the second and
the fourth pixel: 0 1 1 2 2 2 2 2."""


@device_function
def allocate_row_memory(
    context: ShadingContext, inputs: ShadingInputs, max_pixels: I64, part_spans: PartSpans, pixels: PartPixels
) -> None:
    """Set inputs and memory of a ShadingContext, for rows of at most ``max_pixels``; ``free_row_memory`` frees it."""
    context.inputs, context.part_spans, context.pixels = inputs, part_spans, pixels
    # One word more than the row has: ``interpolation`` reads the next one, too.
    context.start_bits = i64_at(allocate(8 * (max_pixels // _PIXELS_PER_WORD + 2)))
    # A row has at most one span per pixel. ``find_spans`` stores whole vectors, so one vector more.
    context.span_starts = i32_at(allocate(4 * (max_pixels + vec.LANES)))
    context.span_primitive_ids = i32_at(allocate(4 * (max_pixels + vec.LANES)))
    # A vector before the row and a word's pixels after it, for ``_pad_ids``.
    context.padded_ids = i32_at(allocate(4 * (vec.LANES + max_pixels + _PIXELS_PER_WORD)))


@device_function
def free_row_memory(context: ShadingContext) -> None:
    """Free the memory of ``allocate_row_memory``."""
    release(address(context.start_bits))
    release(address(context.span_starts))
    release(address(context.span_primitive_ids))
    release(address(context.padded_ids))


@device_function
def find_spans(context: ShadingContext, y: I64, columns: Address, pixel_ids: Pointer[I32], pixel_count: I64) -> I64:
    """Find the spans of a row of ``pixel_count`` pixels; return their number.

    A span also begins at every MAX_PART_PIXELS-th pixel of the row, so that the parts of a segment are whole spans, and
    float32 is accurate along a span. With ``columns``, which may have gaps, each pixel is a span of its own.
    """
    context.y, context.columns = y, columns
    _pad_ids(context.padded_ids, pixel_ids, pixel_count)
    span_count = i64(0)
    for word_start in range(0, pixel_count, _PIXELS_PER_WORD):
        bits = i64(_ALL_BITS) if columns != 0 else _start_bits(context.padded_ids, word_start)
        context.start_bits[word_start // _PIXELS_PER_WORD] = bits  # those beyond the row are not used
        bits &= _first_bits(pixel_count - word_start)
        _append_spans(context, word_start, bits, span_count)
        span_count += vec.count_bits(bits)
    vec.store(context.span_starts, span_count, vec.i32(pixel_count))  # where the last span ends
    return span_count


@inlined
def _first_bits(count: I64) -> I64:
    """Return a word whose first ``count`` bits are set; all of them for more than it has."""
    return (i64(1) << count) - 1 if count < _PIXELS_PER_WORD else i64(_ALL_BITS)


@inlined
def _pad_ids(padded_ids: Pointer[I32], pixel_ids: Pointer[I32], pixel_count: I64) -> None:
    """Copy a row's primitive ids, with a vector of _ID_BEYOND_ROW before them, and _PIXELS_PER_WORD of it after."""
    vec.store(padded_ids, 0, vec.i32(_ID_BEYOND_ROW))
    ids = advance(padded_ids, vec.LANES)
    for k in range(pixel_count):
        ids[k] = pixel_ids[k]
    for k in range(pixel_count, pixel_count + _PIXELS_PER_WORD, vec.LANES):
        vec.store(ids, k, vec.i32(_ID_BEYOND_ROW))


@inlined
def _start_bits(padded_ids: Pointer[I32], word_start: I64) -> I64:
    """Return a word of start bits: a bit for each pixel from ``word_start`` on, set where a span begins."""
    ids, ids_before = advance(padded_ids, vec.LANES), advance(padded_ids, vec.LANES - 1)
    bits = i64(word_start % MAX_PART_PIXELS == 0)
    for k in range(0, _PIXELS_PER_WORD, vec.LANES):
        bits |= vec.movemask(vec.load(ids, word_start + k) != vec.load(ids_before, word_start + k)) << k
    return bits


@inlined
def _append_spans(context: ShadingContext, word_start: I64, bits: I64, span_count: I64) -> None:
    """Append the spans of a word of start bits to ``span_count`` spans. Its bit k is pixel ``word_start + k``'s.

    Eight at a time, since a branch per span would be unpredictable. What is stored beyond the last span is never used.
    """
    ids, starts = advance(context.padded_ids, vec.LANES), context.span_starts
    for first_span in range(span_count, span_count + vec.count_bits(bits), vec.LANES):
        for k in range(first_span, first_span + vec.LANES):
            start = word_start + vec.lowest_bit(bits | _HIGHEST_BIT)  # lowest_bit(0) is undefined
            starts[k], context.span_primitive_ids[k] = start, ids[start]
            bits &= bits - 1


@device_function
def bind_next_segment(context: ShadingContext, span: I64, span_count: I64, instance_index: I64) -> NextSegment:
    """Find the end of the segment that begins with a span; set its instance and material in the ShadingContext.

    ``instance_index`` is that of the instance that is tried first.
    """
    inputs, span_primitive_ids = context.inputs, context.span_primitive_ids
    primitive_id = i64(span_primitive_ids[span])
    # The background counts as an instance with this id alone.
    first_id, end_id = i64(NO_PRIMITIVE), i64(NO_PRIMITIVE + 1)
    is_background = primitive_id < 0
    if not is_background:
        instance_index = instance_of(inputs.first_ids, inputs.instance_count, primitive_id, instance_index)
        _bind_instance(context, instance_index)
        first_id, end_id = context.first_id, context.end_id
    for first_span in range(span, span_count, vec.LANES):
        ids = vec.load(span_primitive_ids, first_span)
        other_lanes = vec.movemask((ids < vec.i32(first_id)) | (ids >= vec.i32(end_id)))
        if other_lanes != 0:
            return NextSegment(min(first_span + vec.lowest_bit(other_lanes), span_count), instance_index, is_background)
    return NextSegment(i64(span_count), instance_index, is_background)


@device_function
def _bind_instance(context: ShadingContext, index: I64) -> None:
    """Set the fields of a ShadingContext that depend on the instance, given by its index in the draw list."""
    inputs = context.inputs
    instance = inputs.instances[index]
    material = inputs.materials[instance.material_index]
    context.first_id, context.end_id = inputs.first_ids[index], inputs.first_ids[index + 1]
    context.instance, context.material = instance, material
    context.matrices = inputs.matrices[index]
    context.X_camera_mesh = advance(inputs.X_camera_mesh, 16 * index)
    read_attributes = HAS_COLORS  # they change the base colour of every material
    if material.lighting != UNLIT:
        read_attributes |= HAS_NORMALS
    if material.normal_texture >= 0:
        read_attributes |= HAS_TANGENTS
    if material.uv_sets & 1:
        read_attributes |= HAS_UV0
    if material.uv_sets & 2:
        read_attributes |= HAS_UV1
    context.used_attribute_bits = instance.attribute_bits & read_attributes


@inlined
def find_part_end(context: ShadingContext, span: I64, begin_pixel: I64, segment_end_pixel: I64) -> PartEnd:
    """Return the end of the next part of a segment, which begins with this span and pixel of the row."""
    end_pixel = min(segment_end_pixel, (begin_pixel & -MAX_PART_PIXELS) + MAX_PART_PIXELS)
    end_span = span  # and one more for each start bit of the part
    for word_start in range(begin_pixel & -_PIXELS_PER_WORD, end_pixel, _PIXELS_PER_WORD):
        bits = context.start_bits[word_start // _PIXELS_PER_WORD]
        if word_start < begin_pixel:
            bits &= i64(_ALL_BITS) << (begin_pixel - word_start)
        end_span += vec.count_bits(bits & _first_bits(end_pixel - word_start))
    return PartEnd(end_pixel, end_span)
