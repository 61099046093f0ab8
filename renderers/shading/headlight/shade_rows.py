"""Kernel of the headlight looks, which shades rows of an image segment by segment."""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.pointers import address, advance, allocate, i32_at, release
from renderers.shading.headlight.layout import GATHER, UNDER, headlight_job_at
from renderers.shading.headlight.lighting import fill_spans, is_uniform_lambert, shade
from renderers.shading.headlight.output_merge import gather, write_background, write_under
from renderers.shading.interpolation import interpolate
from renderers.shading.packed_rows import write_packed_row
from renderers.shading.span_setup import set_up_spans
from renderers.shading.spans import (
    begin_rows,
    end_rows,
    find_spans,
    new_pixels,
    new_segment,
    new_spans,
    next_part,
    next_segment,
)


@inlined
def _shade_segment(job, segment, first_span, end_span, packed_row):
    """Shade the spans ``first_span .. end_span``, of the selected instance.

    It is done in parts of at most PART pixels, whose attributes stay in the first-level cache.
    """
    starts, is_uniform, span = segment.starts, is_uniform_lambert(job, segment), first_span
    begin, end = np.int64(starts[first_span]), np.int64(starts[end_span])
    while begin < end:
        part_end, part_end_span = next_part(segment, span, begin, end)
        has_constant_normals = set_up_spans(segment, span, part_end_span, end_span)
        if has_constant_normals and is_uniform:
            fill_spans(segment, span, part_end_span, packed_row)
        else:
            interpolate(segment, begin, part_end)
            shade(job, segment, begin, part_end, packed_row)
        if job.mode == GATHER:
            gather(job, segment, begin, part_end)
        elif job.mode == UNDER:
            write_under(job, segment, begin, part_end, packed_row)
        begin, span = part_end, part_end_span


@inlined
def _ids_of_row(job, y):
    """Return the number of primitive ids of a row of the image, and SEGMENT's ``columns`` for them."""
    if job.columns == 0:
        return job.width, np.int64(0)
    row = y - job.first_row
    return np.int64(job.counts[row]), address(advance(i32_at(job.columns), row * job.stride))


@kernel("void(int64, int64, int64, int64)")
def shade_rows(job_address, ids_address, row_begin, row_end):
    """Shade the rows ``row_begin .. row_end`` of the image. Rows are independent of each other.

    Args:
        job_address: address of a HEADLIGHT_JOB. Its arrays of rows begin with its ``first_row``.
        ids_address: address of the primitive ids of row ``row_begin``: int32 per pixel, NO_PRIMITIVE for none. The rows
            are HEADLIGHT_JOB's ``stride`` values apart.
    """
    job = headlight_job_at(job_address)
    packed_row = i32_at(allocate(4 * (job.width + vec.LANES)))  # stores overrun it by up to seven pixels
    segment = new_segment()
    begin_rows(segment, job.shading, job.width, new_spans(), new_pixels())
    span_starts, instance = segment.starts, np.int64(0)
    for y in range(row_begin, row_end):
        id_count, columns = _ids_of_row(job, y)
        ids = advance(i32_at(ids_address), (y - row_begin) * job.stride)
        span_count = find_spans(segment, y, columns, ids, id_count)
        span = np.int64(0)
        while span < span_count:
            end_span, instance, is_background = next_segment(segment, span, span_count, instance)
            if is_background:
                write_background(job, y, np.int64(span_starts[span]), np.int64(span_starts[end_span]), packed_row)
            else:
                _shade_segment(job, segment, span, end_span, packed_row)
            span = end_span
        if job.mode != GATHER:
            write_packed_row(advance(job.color, 3 * (y - job.first_row) * job.width), packed_row, id_count)
    end_rows(segment)
    release(address(packed_row))
