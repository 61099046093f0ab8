"""Elements to records, and records to the lists of the bands that they touch."""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import as_f32, f32_at, f64_at, i32_at, i64_at, u16_at
from renderers.raster.cluster_culling import V_COLUMNS, look_at
from renderers.raster.layout import (
    CHUNK,
    G_DRAWN,
    G_ELEMENT,
    G_LANES,
    J_BANDS,
    J_ELEMENTS,
    J_INSTANCES,
    J_LISTS,
    J_MICRO,
    J_OFFSETS,
    J_RANGES,
    J_RECORDS,
    J_SMALL,
    J_STOP,
    J_STRIDE,
    J_TABLE,
    J_TALL,
    MICRO_LISTS,
    MICRO_PER_ELEMENT,
    MICRO_ROOM,
    MICRO_VALUES,
    Q_COUNT,
    Q_GROUP,
    Q_MICRO,
    Q_MICROS,
    Q_PIXELS,
    Q_RECORDS,
    Q_SCRATCH,
    Q_SPANS,
    R_ID,
    RECORD_BYTES,
    SMALL_BANDS,
    T_CLUSTERS,
    T_COLUMNS,
    T_ELEMENT,
    T_RECORD,
    T_TOPOLOGY,
)
from renderers.raster.primitive_setup import line, point
from renderers.raster.transform import drawn_at
from renderers.raster.triangle_setup import BAND_SHIFT, triangles


@inner
def _others(job, lens, drawn, element, record, spans, count):
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


@inlined
def _reach(ranges, bands, first, last):
    """Widen a chunk's ranges of bands by the lists ``first .. last``."""
    side = 0
    if first >= bands:
        side = 2
        first, last = first - bands, last - bands
    ranges[side] = min(ranges[side], first)
    ranges[side + 1] = max(ranges[side + 1], last)


@inner
def _late(job, lens, request):
    """Set up a KIND_LATER record's triangles."""
    group = i32_at(request[Q_GROUP])
    drawn, element = np.int64(group[G_DRAWN]), np.int64(group[G_ELEMENT])
    table = i64_at(job[J_TABLE])
    row = drawn * T_COLUMNS
    lanes = min(table[row + T_COLUMNS + T_ELEMENT] - table[row + T_ELEMENT] - element, vec.LANES)
    spans, columns, micro = i32_at(request[Q_SPANS]), i32_at(request[Q_SCRATCH]), i32_at(request[Q_PIXELS])
    records, late = request[Q_RECORDS], np.int64(group[G_LANES])
    count, micros = triangles(
        job, lens, drawn, element, element + lanes, late, records, spans, 0, micro, 0, columns, 0, as_f32(columns)
    )
    _find_lists(job, micro, micros)
    for m in range(0, micros, vec.LANES):
        _store_micros(i32_at(request[Q_MICRO]), m, micro, m)
    request[Q_COUNT] = count
    request[Q_MICROS] = micros


@inner
def _find_lists(job, micro, micros):
    """Say for each of the pixels that ``triangles`` has left which list it belongs to."""
    # Halfway into a pixel: no product is nearer to a whole number than that.
    half, row = vec.f64(0.5), vec.f64(1.0 / np.float64(job[J_STRIDE]))
    zero, apart = vec.i32(0), vec.i32(job[J_LISTS] - job[J_BANDS])
    for m in range(0, micros, vec.LANES):
        marked = vec.load(micro, m)
        pixels = marked & vec.i32(0x7FFFFFFF)
        lists = vec.to_i32((vec.to_f64(pixels) + half) * row) >> vec.i32(BAND_SHIFT)
        vec.store(micro, m, pixels)
        vec.store(micro, MICRO_LISTS * MICRO_ROOM + m, vec.select(marked < zero, lists + apart, lists))


@inlined
def _store_micros(out, place, micro, m):
    """Write eight pixels as quadruples."""
    w, numbers = vec.load(micro, MICRO_ROOM + m), vec.load(micro, 2 * MICRO_ROOM + m)
    vec.store_quads(out, 4 * place, vec.load(micro, m), w, numbers, vec.load(micro, MICRO_LISTS * MICRO_ROOM + m))


@inlined
def _store_micro(out, fill, micro, m):
    """Write a pixel as a quadruple to the end of its list."""
    goal = np.int64(micro[MICRO_LISTS * MICRO_ROOM + m])
    place = np.int64(fill[goal])
    fill[goal] = place + 1
    for value in range(4):
        out[4 * place + value] = micro[value * MICRO_ROOM + m]


@inner
def _distribute(job, chunk, spans, count, micro, micros, fill):
    """Write a chunk's lists, sorted by list; records in their order.

    Args:
        micro, micros: what ``triangles`` and ``_find_lists`` have left.
        fill: pointer to lists + 1 int32 of scratch.
    """
    lists, which = job[J_LISTS], MICRO_LISTS * MICRO_ROOM
    offsets = i32_at(job[J_OFFSETS] + 4 * chunk * (2 * lists + 4))
    small = u16_at(job[J_SMALL] + 2 * chunk * CHUNK * SMALL_BANDS)
    tall = u16_at(job[J_TALL] + 2 * chunk * CHUNK)
    bands = job[J_BANDS]
    ranges = i32_at(job[J_RANGES] + 16 * chunk)
    for side in range(2):
        ranges[2 * side] = bands
        ranges[2 * side + 1] = -1
    for each in range(lists):
        fill[each] = 0
    for k in range(count):
        first, last = spans[2 * k], spans[2 * k + 1]
        _reach(ranges, bands, first, last)
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

    starts = lists + 1
    for each in range(lists + 1):
        offsets[starts + each] = 0
    # Eight neighbours mostly go to one list; one by one each would wait for the one before it.
    whole = micros & ~np.int64(vec.LANES - 1)
    for m in range(0, whole, vec.LANES):
        goal = np.int64(micro[which + m])
        if vec.bits(vec.load(micro, which + m) == vec.i32(goal)) == 255:
            offsets[starts + 1 + goal] += vec.LANES
        else:
            for k in range(m, m + vec.LANES):
                offsets[starts + 1 + micro[which + k]] += 1
    for m in range(whole, micros):
        offsets[starts + 1 + micro[which + m]] += 1
    for each in range(lists):
        here = offsets[starts + each + 1]
        if here != 0:
            _reach(ranges, bands, each, each)
        fill[each] = offsets[starts + each]
        offsets[starts + each + 1] = fill[each] + here
    out = i32_at(job[J_MICRO] + 16 * chunk * MICRO_PER_ELEMENT * CHUNK)
    for m in range(0, whole, vec.LANES):
        goal = np.int64(micro[which + m])
        if vec.bits(vec.load(micro, which + m) == vec.i32(goal)) == 255:
            place = np.int64(fill[goal])
            _store_micros(out, place, micro, m)
            fill[goal] = place + vec.LANES
        else:
            for k in range(m, m + vec.LANES):
                _store_micro(out, fill, micro, k)
    for m in range(whole, micros):
        _store_micro(out, fill, micro, m)


@kernel("void(int64, int64, int64, int64)")
def setup(job_at, lens_at, begin_chunk, end_chunk):
    """Records and band lists of the chunks ``begin_chunk .. end_chunk`` of the drawn elements; or where ``begin_chunk``
    is -1, what the request at the address ``end_chunk`` (Q_GROUP and on) asks for."""
    job = i64_at(job_at)
    lens = f64_at(lens_at)
    if begin_chunk < 0:
        _late(job, lens, i64_at(end_chunk))
        return
    table = i64_at(job[J_TABLE])
    own_spans = np.empty(2 * CHUNK, np.int32)
    own_fill = np.empty(job[J_LISTS] + 1, np.int32)
    own_micro = np.empty(MICRO_VALUES * MICRO_ROOM, np.int32)
    own_columns = np.empty(16 * vec.LANES, np.int32)
    own_view = np.empty(V_COLUMNS, np.float32)
    spans = i32_at(np.int64(own_spans.ctypes.data))
    fill = i32_at(np.int64(own_fill.ctypes.data))
    micro = i32_at(np.int64(own_micro.ctypes.data))
    columns = i32_at(np.int64(own_columns.ctypes.data))
    view = f32_at(np.int64(own_view.ctypes.data))
    viewed, clusters = -1, np.int64(0)
    for chunk in range(begin_chunk, end_chunk):
        if is_set(job[J_STOP]):
            break
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
                begin, last = work - offset, stop - offset
                if drawn != viewed:
                    viewed, clusters = drawn, table[row + T_CLUSTERS]
                    if clusters != 0 and not look_at(job, lens, drawn, view):
                        clusters = np.int64(0)
                count, micros = triangles(
                    job, lens, drawn, begin, last, 0, record, spans, count, micro, micros, columns, clusters, view
                )
            else:
                for k in range(work, stop):
                    count = _others(job, lens, drawn, k - offset, record, spans, count)
            work = max(work, stop)
            drawn += 1
        _find_lists(job, micro, micros)
        _distribute(job, chunk, spans, count, micro, micros, fill)
    # The pointers above do not keep the arrays alive.
    own_spans[0] = own_fill[0] = own_micro[0] = own_columns[0] = 0
    own_view[0] = 0.0
