"""Spans: neighbouring pixels of a row that see one primitive. Segments: neighbouring spans of one instance."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import I32, I64, Pointer, i64
from renderers.compiler.pointers import address, advance, allocate, f64_at, i32_at, i64_at, release
from renderers.primitive_ids import instance_of
from renderers.shading.layout import (
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    PART,
    UNLIT,
    Segment,
    ShadedPixels,
    ShadingInputs,
    Spans,
)

NO_PRIMITIVE: Final = -1
"""Primitive id of pixels that see the background."""
_BEYOND_ROW: Final = -(2**31)
"""Id of pixels beyond the row; differs from every primitive id and from NO_PRIMITIVE."""
_HIGHEST_BIT: Final = -(2**63)


def _span_offsets() -> NDArray[np.int32]:
    starts = np.arange(128)[:, None] >> np.arange(7) & 1
    return np.ascontiguousarray(np.pad(np.cumsum(starts, axis=1), ((0, 0), (1, 0))), np.int32)


SPAN_OFFSETS: Final = _span_offsets()
"""(128, 8) int32: for eight pixels, the index of each pixel's span, counted from the first pixel's span. The row of the
table is a mask of seven bits: bit k - 1 is set if a span begins at pixel k, 1 <= k <= 7."""


@device_function
def begin_rows(segment: Segment, job: ShadingInputs, width: I64, spans: Spans, pixels: ShadedPixels) -> None:
    """Give a Segment its working memory for rows of at most ``width`` pixels; ``end_rows`` frees it.

    Args:
        spans, pixels: the segment's Spans and ShadedPixels.
    """
    max_spans = width + width // PART + 4 * vec.LANES
    segment.job, segment.spans, segment.pixels = job, spans, pixels
    segment.masks = i64_at(allocate(8 * (width // 64 + 3)))
    segment.starts, segment.ids = i32_at(allocate(4 * max_spans)), i32_at(allocate(4 * max_spans))
    segment.row_ids = i32_at(allocate(4 * (width + 64 + 2 * vec.LANES)))


@device_function
def end_rows(segment: Segment) -> None:
    """Free the memory of ``begin_rows``."""
    release(address(segment.masks))
    release(address(segment.starts))
    release(address(segment.ids))
    release(address(segment.row_ids))


@device_function
def find_spans(segment: Segment, y: I64, columns: I64, pixel_ids: Pointer[I32], width: I64) -> I64:
    """Find the spans of a row of pixels.

    A span also begins at every PART-th pixel, so that the parts of a segment are whole spans, and float32 is accurate
    along a span.

    Args:
        columns: as in Segment. If it is not 0, each pixel is a span of its own.
        pixel_ids: pointer to the primitive ids of ``width`` pixels, NO_PRIMITIVE for none.

    Returns:
        Number of spans.
    """
    segment.y, segment.columns = y, columns
    masks, starts, span_ids, row_ids = segment.masks, segment.starts, segment.ids, segment.row_ids
    vec.store(row_ids, 0, vec.i32(_BEYOND_ROW))
    ids = advance(row_ids, vec.LANES)
    for x in range(width):
        ids[x] = pixel_ids[x]
    for x in range(width, width + 64 + vec.LANES, vec.LANES):
        vec.store(ids, x, vec.i32(_BEYOND_ROW))
    count = i64(0)
    for x in range(0, width, 64):
        mask = i64(-1)
        if columns == 0:
            mask = i64(x % PART == 0)
            for k in range(0, 64, vec.LANES):
                mask |= vec.movemask(vec.load(ids, x + k) != vec.load(row_ids, x + k + vec.LANES - 1)) << k
        masks[x >> 6] = mask
        if width - x < 64:
            mask &= (i64(1) << (width - x)) - 1
        new_spans = vec.count_bits(mask)
        # Eight at a time, since a branch per span would be unpredictable.
        for first in range(count, count + new_spans, vec.LANES):
            for k in range(vec.LANES):
                starts[first + k] = x + vec.lowest_bit(mask | _HIGHEST_BIT)
                mask &= mask - 1
            vec.store(span_ids, first, vec.gather(ids, vec.load(starts, first)))
        count += new_spans
    masks[(width >> 6) + ((width & 63) != 0)] = -1
    vec.store(starts, count, vec.i32(width))
    return count


@inlined
def next_part(segment: Segment, span: I64, begin: I64, end: I64) -> tuple[I64, I64]:
    """Return the end of the next part of a segment: the pixel and the span after it.

    Args:
        begin: index in the row of the part's first pixel.
        end: index after the segment's last pixel.
    """
    part_end = min(end, (begin & -PART) + PART)
    masks = segment.masks
    for x in range(begin & -64, part_end, 64):
        mask = masks[x >> 6]
        if x < begin:
            mask &= i64(-1) << (begin - x)
        if part_end - x < 64:
            mask &= (i64(1) << (part_end - x)) - 1
        span += vec.count_bits(mask)
    return part_end, span


@device_function
def next_segment(segment: Segment, span: I64, span_count: I64, instance: I64) -> tuple[I64, I64, bool]:
    """Select the instance that a span sees, and find the end of its segment.

    Args:
        span: index of the segment's first span in the row.
        span_count: number of spans of the row.
        instance: index of the instance that is tried first.

    Returns:
        end_span: the span after the segment.
        instance: index of the selected instance; unchanged for the background.
        is_background: True if the segment sees no primitive, and no instance is selected.
    """
    job, span_ids = segment.job, segment.ids
    primitive_id = i64(span_ids[span])
    first_id, end_id = i64(NO_PRIMITIVE), i64(NO_PRIMITIVE + 1)
    is_background = primitive_id < 0
    if not is_background:
        instance = instance_of(job.first_ids, job.instance_count, primitive_id, instance)
        first_id, end_id = job.first_ids[instance], job.first_ids[instance + 1]
        _select_instance(segment, instance)
    for first in range(span, span_count, vec.LANES):
        ids = vec.load(span_ids, first)
        outside = vec.movemask((ids < vec.i32(first_id)) | (ids >= vec.i32(end_id)))
        if outside != 0:
            return min(first + vec.lowest_bit(outside), span_count), instance, is_background
    return i64(span_count), instance, is_background


@device_function
def _select_instance(segment: Segment, index: I64) -> None:
    """Set the fields of a segment that depend on the instance, given by its index in the draw list."""
    job = segment.job
    instance = job.instances[index]
    material = job.materials[instance.material]
    segment.first_id = job.first_ids[index]
    segment.instance, segment.material = instance, material
    segment.matrices = job.matrices[index]
    segment.X_camera_mesh = f64_at(address(job.X_camera_mesh) + 8 * 16 * index)
    read_attributes = HAS_COLORS
    if material.lighting != UNLIT:
        read_attributes |= HAS_NORMALS
    if material.normal_texture >= 0:
        read_attributes |= HAS_TANGENTS
    if material.uv_sets & 1:
        read_attributes |= HAS_UV0
    if material.uv_sets & 2:
        read_attributes |= HAS_UV1
    segment.attributes = instance.attributes & read_attributes
