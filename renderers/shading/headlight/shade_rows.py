"""Kernel of the headlight looks: shades rows of an image segment by segment."""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.pointers import f32_at, i32_at, i64_at
from renderers.primitive_ids import instance_of
from renderers.shading.headlight.layout import S_COUNTS, S_MODE, S_PLACES, S_STRIDE, S_WIDTH
from renderers.shading.headlight.lighting import fill_spans, is_uniform_phong, shade
from renderers.shading.headlight.output_merge import DIRECT, GATHER, gather, put_line, write_background, write_under
from renderers.shading.interpolation import interpolate
from renderers.shading.layout import (
    G_MATERIAL_FLOATS,
    G_MATERIAL_INTEGERS,
    G_PIXELS,
    G_RECORDS,
    G_STARTS,
    S_COUNT,
    S_FIRST,
)
from renderers.shading.materials import MF_CUTOFF, MI_ALPHA_MODE
from renderers.shading.span_setup import set_up_spans
from renderers.shading.spans import begin_rows, find_spans, next_part, row_memory, segment_end, select_instance


@device_function
def _shade_segment(job, segment, y, span, end_span, line):
    """Shade the spans ``span .. end_span`` of the selected instance."""
    starts, uniform = i32_at(segment[G_STARTS]), is_uniform_phong(job, segment)
    begin, end = np.int64(starts[span]), np.int64(starts[end_span])
    mi, mf = i64_at(segment[G_MATERIAL_INTEGERS]), f32_at(segment[G_MATERIAL_FLOATS])
    pixels, mode = f32_at(segment[G_PIXELS]), job[S_MODE]
    while begin < end:
        stop, last_span = next_part(segment, span, begin, end)
        constant = set_up_spans(segment, span, last_span, end_span)
        if constant and uniform:
            fill_spans(segment, span, last_span, line)
        else:
            interpolate(segment, begin, stop, np.int64(0))
            shade(job, segment, begin, stop, line)
        if mode == GATHER:
            gather(job, mi[MI_ALPHA_MODE], mf[MF_CUTOFF], y, begin, stop, pixels)
        elif mode != DIRECT:
            write_under(job, y, begin, stop, pixels, line)
        begin, span = stop, last_span


@inlined
def _row_records(job, y):
    """Number of records of a row, and the address of their image columns; 0: record k is in column k."""
    if job[S_PLACES] == 0:
        return job[S_WIDTH], np.int64(0)
    return np.int64(i32_at(job[S_COUNTS])[y]), job[S_PLACES] + 4 * y * job[S_STRIDE]


@kernel("void(int64, int64, int64, int64)")
def shade_rows(job_at, ids_at, row_begin, row_end):
    """Shade the rows ``row_begin .. row_end - 1``. Rows are independent of each other.

    Args:
        job_at: address of S_COLUMNS int64.
        ids_at: address of (H, S_STRIDE) int32, the record of every pixel, -1 for none.
    """
    job = i64_at(job_at)
    own_memory = np.empty(row_memory(job[S_WIDTH]), np.int64)
    own_line = np.empty(job[S_WIDTH] + 2 * vec.LANES, np.int32)
    line = i32_at(np.int64(own_line.ctypes.data))
    segment, ids = begin_rows(job, np.int64(own_memory.ctypes.data), job[S_WIDTH], np.int64(0))
    starts, records, first_record = i32_at(segment[G_STARTS]), i32_at(segment[G_RECORDS]), i64_at(job[S_FIRST])
    instance = np.int64(0)
    for y in range(row_begin, row_end):
        width, columns = _row_records(job, y)
        count = find_spans(segment, y, columns, i32_at(ids_at + 4 * y * job[S_STRIDE]), width, ids)
        span = np.int64(0)
        while span < count:
            record = np.int64(records[span])
            if record < 0:
                last_span = segment_end(segment, span, count, np.int64(-1), np.int64(0))
                write_background(job, y, np.int64(starts[span]), np.int64(starts[last_span]), line)
            else:
                instance = instance_of(first_record, job[S_COUNT], record, instance)
                last_span = segment_end(segment, span, count, first_record[instance], first_record[instance + 1])
                select_instance(job, segment, instance)
                _shade_segment(job, segment, y, span, last_span, line)
            span = last_span
        if job[S_MODE] != GATHER:
            put_line(job, y, width, line)
    own_memory[0] = own_line[0] = 0  # the pointers above do not keep the arrays alive
