"""Elements to records, and records to the lists of the bands that they touch."""

from __future__ import annotations

import numpy as np
from numba import njit

from renderers import simd as vec
from renderers.cpu.elements import line, point
from renderers.cpu.layout import (
    CHUNK,
    J_BANDS,
    J_ELEMENTS,
    J_INSTANCES,
    J_LISTS,
    J_MICRO,
    J_OFFSETS,
    J_RECORDS,
    J_SMALL,
    J_TABLE,
    J_TALL,
    MICRO_PER_ELEMENT,
    R_ID,
    RECORD_BYTES,
    SMALL_BANDS,
    T_COLUMNS,
    T_ELEMENT,
    T_RECORD,
    T_TOPOLOGY,
)
from renderers.cpu.transform import drawn_at
from renderers.cpu.triangles import triangles
from renderers.jit import kernel
from renderers.pointers import f64_at, i32_at, i64_at, u16_at


@njit(nogil=True, error_model="numpy")
def _others(job, lens, drawn, element, record, spans, count):  # type: ignore[no-untyped-def]
    """A line or a point; returns the new ``count`` as ``triangles`` does."""
    row = drawn * T_COLUMNS
    table = i64_at(job[J_TABLE])
    place = record + RECORD_BYTES * count
    if table[row + T_TOPOLOGY] == 2:
        first, last = line(job, lens, drawn, element, place)
    else:
        first, last = point(job, drawn, element, place)
    if last < first:
        return count
    i32_at(place)[R_ID] = table[row + T_RECORD] + element
    spans[2 * count] = first
    spans[2 * count + 1] = last
    return count + 1


@njit(nogil=True, error_model="numpy")
def _distribute(job, chunk, spans, count, micro, micros, fill):  # type: ignore[no-untyped-def]
    """Write a chunk's lists, sorted by list and in the order of records."""
    lists = job[J_LISTS]
    offsets = i32_at(job[J_OFFSETS] + 4 * chunk * (2 * lists + 4))
    small = u16_at(job[J_SMALL] + 2 * chunk * CHUNK * SMALL_BANDS)
    tall = u16_at(job[J_TALL] + 2 * chunk * CHUNK)
    for each in range(lists):
        fill[each] = 0
    for k in range(count):
        first, last = spans[2 * k], spans[2 * k + 1]
        if last - first < SMALL_BANDS:
            for each in range(first, last + 1):
                fill[each] += 1
    total = 0
    for each in range(lists):
        offsets[each] = total
        total += fill[each]
        fill[each] = offsets[each]
    offsets[lists] = total
    talls = 0
    for k in range(count):
        first, last = spans[2 * k], spans[2 * k + 1]
        if last - first < SMALL_BANDS:
            for each in range(first, last + 1):
                small[fill[each]] = k
                fill[each] += 1
        elif first < job[J_BANDS]:
            tall[talls] = k
            talls += 1
    offsets[2 * lists + 2] = talls
    if lists > job[J_BANDS]:
        for k in range(count):
            first, last = spans[2 * k], spans[2 * k + 1]
            if last - first >= SMALL_BANDS and first >= job[J_BANDS]:
                tall[talls] = k
                talls += 1
    offsets[2 * lists + 3] = talls

    sorted_micro = i32_at(job[J_MICRO] + 12 * chunk * MICRO_PER_ELEMENT * CHUNK)
    starts = lists + 1
    for each in range(lists + 1):
        offsets[starts + each] = 0
    for k in range(micros):
        offsets[starts + 1 + micro[4 * k + 3]] += 1
    for each in range(lists):
        offsets[starts + each + 1] += offsets[starts + each]
        fill[each] = offsets[starts + each]
    for k in range(micros):
        place = np.int64(fill[micro[4 * k + 3]])
        fill[micro[4 * k + 3]] += 1
        for value in range(3):
            sorted_micro[3 * place + value] = micro[4 * k + value]


@kernel("void(int64, int64, int64, int64)")
def setup(job_at, lens_at, begin_chunk, end_chunk):  # type: ignore[no-untyped-def]
    """Records and band lists of the chunks ``begin_chunk .. end_chunk`` of the drawn elements."""
    job = i64_at(job_at)
    lens = f64_at(lens_at)
    table = i64_at(job[J_TABLE])
    own_spans = np.empty(2 * CHUNK, np.int32)
    own_fill = np.empty(job[J_LISTS] + 1, np.int32)
    own_micro = np.empty(4 * MICRO_PER_ELEMENT * CHUNK, np.int32)
    own_columns = np.empty(16 * vec.LANES, np.int32)
    spans = i32_at(np.int64(own_spans.ctypes.data))
    fill = i32_at(np.int64(own_fill.ctypes.data))
    micro = i32_at(np.int64(own_micro.ctypes.data))
    columns = i32_at(np.int64(own_columns.ctypes.data))
    for chunk in range(begin_chunk, end_chunk):
        work = chunk * CHUNK
        end = min(work + CHUNK, job[J_ELEMENTS])
        record = job[J_RECORDS] + chunk * CHUNK * RECORD_BYTES
        count = 0
        micros = 0
        drawn = drawn_at(table, job[J_INSTANCES], T_ELEMENT, work)
        while work < end:
            row = drawn * T_COLUMNS
            stop = min(end, table[row + T_COLUMNS + T_ELEMENT])
            offset = table[row + T_ELEMENT]
            if table[row + T_TOPOLOGY] == 3:
                for k in range(work, stop, vec.LANES):
                    lanes = min(stop - k, vec.LANES)
                    count, micros = triangles(
                        job, lens, drawn, k - offset, lanes, record, spans, count, micro, micros, columns
                    )
            else:
                for k in range(work, stop):
                    count = _others(job, lens, drawn, k - offset, record, spans, count)
            work = max(work, stop)
            drawn += 1
        _distribute(job, chunk, spans, count, micro, micros, fill)
    # The pointers above do not keep the arrays alive.
    own_spans[0] = own_fill[0] = own_micro[0] = own_columns[0] = 0
