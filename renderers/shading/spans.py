"""Spans: up to PART neighbouring pixels of a row that see one primitive. Segments: neighbouring spans of one instance.

primitive ids   7 7 7 7 3 3 9 9 9 . . 7     instance A has the ids 0 to 8, B those from 9 on; PART is 4 here
start bits      1 0 0 0 1 0 1 0 1 1 0 1     ``find_spans``: the id differs from the one before, or a PART-th pixel
spans           |7      |3  |9  |9|.  |7
segments        |A          |B    |   |A    ``next_segment``, which binds an instance and its material
parts           |       |   |   | |   |     ``next_part``: at most PART pixels are shaded at a time; cuts at multiples
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    PART,
    UNLIT,
    ShadedPixels,
    ShadingContext,
    ShadingInputs,
    Spans,
)

NO_PRIMITIVE: Final = -1
"""Primitive id of pixels that see the background."""
_ID_BEYOND_ROW: Final = -(2**31)
"""Id of pixels beyond the row; differs from every primitive id and from NO_PRIMITIVE."""
_WORD: Final = 64
"""Pixels whose start bits are one int64."""
assert PART % _WORD == 0  # multiples of PART begin a word, so that one bit there begins a span
_ALL_BITS: Final = -1
_HIGHEST_BIT: Final = -(2**63)


class NextSegment(NamedTuple):
    """A segment that ``next_segment`` has found."""

    end_span: I64
    """The span after it."""
    instance_index: I64
    """Index of the instance that it sees; for the background, that of the segment before."""
    is_background: bool
    """True: it sees no primitive, and no instance is bound."""


class PartEnd(NamedTuple):
    """End of a part of a segment."""

    end_pixel: I64
    end_span: I64


def _span_offsets() -> NDArray[np.int32]:
    starts = np.arange(128)[:, None] >> np.arange(7) & 1
    return np.ascontiguousarray(np.pad(np.cumsum(starts, axis=1), ((0, 0), (1, 0))), np.int32)


SPAN_OFFSETS: Final = _span_offsets()
"""(128, 8): for eight pixels, the index of each pixel's span, counted from the first pixel's span. Its first index has
the start bits of pixels 1 to 7: bit k - 1 is that of pixel k."""


@device_function
def begin_rows(context: ShadingContext, job: ShadingInputs, width: I64, spans: Spans, pixels: ShadedPixels) -> None:
    """Give a ShadingContext its working memory for rows of at most ``width`` pixels; ``end_rows`` frees it."""
    max_spans = width + 4 * vec.LANES  # a span has a pixel at least; vectors are accessed whole
    context.job, context.spans, context.pixels = job, spans, pixels
    context.start_bits = i64_at(allocate(8 * (width // _WORD + 3)))
    context.span_starts, context.span_ids = i32_at(allocate(4 * max_spans)), i32_at(allocate(4 * max_spans))
    context.row_ids = i32_at(allocate(4 * (width + _WORD + 2 * vec.LANES)))


@device_function
def end_rows(context: ShadingContext) -> None:
    """Free the memory of ``begin_rows``."""
    release(address(context.start_bits))
    release(address(context.span_starts))
    release(address(context.span_ids))
    release(address(context.row_ids))


@device_function
def find_spans(context: ShadingContext, y: I64, columns: Address, pixel_ids: Pointer[I32], width: I64) -> I64:
    """Find the spans of a row of pixels; return their number.

    A span also begins at every PART-th pixel of the row, so that the parts of a segment are whole spans, and float32 is
    accurate along a span.

    Args:
        columns: as in ShadingContext. If it is not 0, each pixel is a span of its own.
        pixel_ids: primitive ids of ``width`` pixels, NO_PRIMITIVE for none.
    """
    context.y, context.columns = y, columns
    _copy_ids(context.row_ids, pixel_ids, width)
    count = i64(0)
    for x in range(0, width, _WORD):
        bits = i64(_ALL_BITS) if columns != 0 else _start_bits(context.row_ids, x)
        context.start_bits[x // _WORD] = bits
        if width - x < _WORD:
            bits &= (i64(1) << (width - x)) - 1
        _append_spans(context, x, bits, count)
        count += vec.count_bits(bits)
    # Beyond the row: a word of start bits, and ``width`` as the start of one more span, where the last one ends.
    context.start_bits[(width + _WORD - 1) // _WORD] = _ALL_BITS
    vec.store(context.span_starts, count, vec.i32(width))
    return count


@inlined
def _copy_ids(row_ids: Pointer[I32], pixel_ids: Pointer[I32], width: I64) -> None:
    """Copy a row's primitive ids, with a vector of _ID_BEYOND_ROW before them, and a word and a vector of it behind."""
    vec.store(row_ids, 0, vec.i32(_ID_BEYOND_ROW))
    ids = advance(row_ids, vec.LANES)
    for x in range(width):
        ids[x] = pixel_ids[x]
    for x in range(width, width + _WORD + vec.LANES, vec.LANES):
        vec.store(ids, x, vec.i32(_ID_BEYOND_ROW))


@inlined
def _start_bits(row_ids: Pointer[I32], x: I64) -> I64:
    """Return a bit for each of the _WORD pixels from ``x`` on, set where a span begins: the pixel before differs."""
    ids, ids_before = advance(row_ids, vec.LANES), advance(row_ids, vec.LANES - 1)
    bits = i64(x % PART == 0)
    for k in range(0, _WORD, vec.LANES):
        bits |= vec.movemask(vec.load(ids, x + k) != vec.load(ids_before, x + k)) << k
    return bits


@inlined
def _append_spans(context: ShadingContext, x: I64, bits: I64, count: I64) -> None:
    """Append the spans that begin where bits are set, in the _WORD pixels from ``x`` on, to the ``count`` found so far.

    Eight at a time, since a branch per span would be unpredictable. What is stored beyond the last span is never used.
    """
    ids, starts, span_ids = advance(context.row_ids, vec.LANES), context.span_starts, context.span_ids
    for first in range(count, count + vec.count_bits(bits), vec.LANES):
        for k in range(first, first + vec.LANES):
            start = x + vec.lowest_bit(bits | _HIGHEST_BIT)  # lowest_bit of 0 is undefined
            starts[k], span_ids[k] = start, ids[start]
            bits &= bits - 1


@inlined
def next_part(context: ShadingContext, span: I64, begin: I64, end: I64) -> PartEnd:
    """Return the end of the next part of a segment.

    Args:
        span: the part's first span.
        begin: index in the row of the part's first pixel.
        end: index after the segment's last pixel.
    """
    end_span, part_end = span, min(end, (begin & -PART) + PART)
    for x in range(begin & -_WORD, part_end, _WORD):
        bits = context.start_bits[x // _WORD]
        if x < begin:
            bits &= i64(_ALL_BITS) << (begin - x)
        if part_end - x < _WORD:
            bits &= (i64(1) << (part_end - x)) - 1
        end_span += vec.count_bits(bits)
    return PartEnd(part_end, end_span)


@device_function
def next_segment(context: ShadingContext, span: I64, span_count: I64, instance_index: I64) -> NextSegment:
    """Bind the instance that a span sees, and find the end of its segment.

    Args:
        span: index of the segment's first span in the row.
        span_count: number of spans of the row.
        instance_index: that of the instance that is tried first.
    """
    job, span_ids = context.job, context.span_ids
    primitive_id = i64(span_ids[span])
    first_id, end_id = (
        i64(NO_PRIMITIVE),
        i64(NO_PRIMITIVE + 1),
    )  # the background counts as an instance with this id alone
    is_background = primitive_id < 0
    if not is_background:
        instance_index = instance_of(job.first_ids, job.instance_count, primitive_id, instance_index)
        _bind_instance(context, instance_index)
        first_id, end_id = context.first_id, context.end_id
    for first in range(span, span_count, vec.LANES):
        ids = vec.load(span_ids, first)
        other_instance = vec.movemask((ids < vec.i32(first_id)) | (ids >= vec.i32(end_id)))
        if other_instance != 0:
            return NextSegment(min(first + vec.lowest_bit(other_instance), span_count), instance_index, is_background)
    return NextSegment(i64(span_count), instance_index, is_background)


@device_function
def _bind_instance(context: ShadingContext, index: I64) -> None:
    """Set the fields of a ShadingContext that depend on the instance, given by its index in the draw list."""
    job = context.job
    instance = job.instances[index]
    material = job.materials[instance.material]
    context.first_id, context.end_id = job.first_ids[index], job.first_ids[index + 1]
    context.instance, context.material = instance, material
    context.matrices = job.matrices[index]
    context.X_camera_mesh = advance(job.X_camera_mesh, 16 * index)
    read_attributes = HAS_COLORS
    if material.lighting != UNLIT:
        read_attributes |= HAS_NORMALS
    if material.normal_texture >= 0:
        read_attributes |= HAS_TANGENTS
    if material.uv_sets & 1:
        read_attributes |= HAS_UV0
    if material.uv_sets & 2:
        read_attributes |= HAS_UV1
    context.attributes = instance.attributes & read_attributes
