"""Kernels of the look ``studio``: surfaces are gathered segment by segment, lit together, and added to their pixels."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel, is_set
from renderers.compiler.pointers import address, f32_at, i32_at, i64_at, u8_at
from renderers.msaa import sample_band_at
from renderers.primitive_ids import instance_of
from renderers.shading.interpolation import interpolate, set_up_spans
from renderers.shading.layout import (
    G_COLUMNS,
    G_RECORDS,
    G_STARTS,
    PART,
    S_COUNT,
    S_FIRST,
    STRIDE,
)
from renderers.shading.spans import begin_rows, find_spans, next_part, row_memory, segment_end, select_instance
from renderers.shading.studio.layout import (
    F_BEHIND,
    F_CELLS,
    F_COLOR,
    J_STOP,
    R_ALPHA,
    R_EMITTED,
    R_LIGHT,
    R_VALUES,
    line_in_kernel,
)
from renderers.shading.studio.lighting import light_up
from renderers.shading.studio.material import ALPHA, COLOR, COLOR_AND_ALPHA, put_surface
from renderers.shading.studio.tone_mapping import finish_row

ADD: Final = 0
"""Add the layer; it covers, whatever its alpha."""
BENEATH: Final = 1
"""Add the layer behind those that are there."""
EDGES: Final = 2
"""Add the surfaces that samples see: the ids of a ``msaa.SAMPLE_BAND`` and its entries, weighted by their samples."""
CUT: Final = 3
"""Only write alpha."""


@inlined
def _add_one(mode, out, line, x, rows, row, slot):
    share = rows[R_ALPHA * STRIDE + slot]
    if mode == BENEATH:
        share *= max(np.float32(1.0) - out[3 * line + x], np.float32(0.0))
    for k in range(3):
        out[k * line + x] += share * rows[(row + k) * STRIDE + slot]
    out[3 * line + x] += share


@device_function
def _add(mode, out, line, columns, rows, row, begin, end):
    """Add three rows' values ``begin .. end`` to their pixels.

    Args:
        out: pointer to four lines of ``line`` float32.
        columns: pointer to the values' image columns.
    """
    lane, one, zero = vec.iota(), vec.f32(1.0), vec.f32(0.0)
    for slot in range(begin, end, vec.LANES):
        x, count = np.int64(columns[slot]), end - slot
        here = lane < vec.i32(count)
        if vec.movemask(here & (vec.load(columns, slot) != vec.i32(x) + lane)) != 0:
            for k in range(min(count, vec.LANES)):
                _add_one(mode, out, line, np.int64(columns[slot + k]), rows, row, slot + k)
            continue
        share = vec.load(rows, R_ALPHA * STRIDE + slot)
        covered = vec.load(out, 3 * line + x)
        if mode == BENEATH:
            share = share * vec.maximum(one - covered, zero)
        for k in range(3):
            there = vec.load(out, k * line + x)
            added = share * vec.load(rows, (row + k) * STRIDE + slot)
            vec.store(out, k * line + x, there + vec.select(here, added, zero))
        vec.store(out, 3 * line + x, covered + vec.select(here, share, zero))


@device_function
def _light(job, mode, out, line, columns, count, rows):
    """Light the gathered surfaces and add them to the row."""
    if count > 0:
        light_up(job, rows, count)
        _add(mode, out, line, columns, rows, R_LIGHT, np.int64(0), count)


@device_function
def _put_columns(segment, begin, stop, weights, columns, rows, slot):
    """Fill ``columns`` and, from the samples of 8 that ``weights`` points to, R_ALPHA."""
    one, apart = vec.f32(1.0), segment[G_COLUMNS]
    for x in range(begin, stop, vec.LANES):
        column = vec.i32(x) + vec.iota()
        if apart != 0:
            column = vec.load(i32_at(apart), x)
        vec.store(columns, slot + x - begin, column)
        vec.store(rows, R_ALPHA * STRIDE + slot + x - begin, one)
    if apart != 0:
        for x in range(begin, stop):
            rows[R_ALPHA * STRIDE + slot + x - begin] = np.float32(weights[x]) * np.float32(0.125)


@device_function
def _gather(job, segment, mode, span, end_span, weights, out, line, columns, rows, slot):
    """Gather the spans ``span .. end_span`` of the selected instance from value ``slot`` on; returns where the next
    ones go."""
    wanted = np.int64(COLOR)
    if mode == BENEATH:
        wanted = np.int64(COLOR_AND_ALPHA)
    elif mode == CUT:
        wanted = np.int64(ALPHA)
    starts = i32_at(segment[G_STARTS])
    begin, end = np.int64(starts[span]), np.int64(starts[end_span])
    while begin < end:
        stop, last_span = next_part(segment, span, begin, end)
        if slot + stop - begin > PART:
            _light(job, mode, out, line, columns, slot, rows)
            slot = np.int64(0)
        set_up_spans(segment, span, last_span, end_span)
        interpolate(segment, begin, stop, np.int64(0))
        _put_columns(segment, begin, stop, weights, columns, rows, slot)
        lit = put_surface(job, segment, wanted, stop - begin, rows, slot)
        last = slot + stop - begin
        if mode == CUT:
            for k in range(slot, last):
                out[columns[k]] = rows[R_ALPHA * STRIDE + k]
        elif lit:
            slot = last
        else:
            _add(mode, out, line, columns, rows, R_EMITTED, slot, last)
        begin, span = stop, last_span
    return slot


@device_function
def _row(job, segment, mode, y, records, columns_at, weights, count, instance, ids, out, line, columns, rows):
    """Shade the records of one row and add them to it; returns the last instance, a hint for the next row.

    Args:
        records: pointer to ``count`` int32. columns_at: address of their image columns, int32; 0: the same.
        weights: pointer to their samples of 8, uint8; read only with ``columns_at``.
        out: pointer to four lines of ``line`` float32.
        columns: pointer to STRIDE int32.
    """
    first_record, spans = i64_at(job[S_FIRST]), i32_at(segment[G_RECORDS])
    span_count = find_spans(segment, y, columns_at, records, count, ids)
    span, slot = np.int64(0), np.int64(0)
    while span < span_count:
        record = np.int64(spans[span])
        if record < 0:
            span = segment_end(segment, span, span_count, np.int64(-1), np.int64(0))
            continue
        instance = instance_of(first_record, job[S_COUNT], record, instance)
        end_span = segment_end(segment, span, span_count, first_record[instance], first_record[instance + 1])
        select_instance(job, segment, instance)
        slot = _gather(job, segment, mode, span, end_span, weights, out, line, columns, rows, slot)
        span = end_span
    _light(job, mode, out, line, columns, slot, rows)
    return instance


@kernel("void(int64, int64, int64, int64, int64, int64, int64, int64, int64, int64)")
def shade_rows(mode, job_at, ids_at, edges_at, stride, width, row_begin, row_end, out_at, finish_at):
    """Shade the rows ``row_begin .. row_end - 1`` of a layer. Rows are independent of each other.

    Args:
        mode: ``ADD``, ``BENEATH``, ``EDGES`` or ``CUT``.
        job_at: address of J_COLUMNS int64.
        ids_at: address of the first of the rows: int32 record per pixel, -1 for none, rows ``stride`` values apart.
        edges_at: for ``EDGES``, address of the band's ``msaa.SAMPLE_BAND``.
        out_at: address of (H, 4, line_of(width)) float32, to which is added: tone-mapped linear colour times coverage,
            and coverage. For ``CUT`` of (H, line_of(width)) float32, into which alpha is written where the layer is
            seen. 0: the rows are finished at once.
        finish_at: address of F_COLUMNS int64; read only without ``out_at``.
    """
    line = line_in_kernel(width)
    job, edges, finish = i64_at(job_at), sample_band_at(edges_at), i64_at(finish_at)
    room = width
    if mode == EDGES:
        room = max(width, edges.room)
    own_memory = np.empty(row_memory(room), np.int64)
    own_rows = np.zeros(R_VALUES, np.float32)
    own_columns = np.zeros(STRIDE, np.int32)
    own_out = np.zeros(4 * line, np.float32)
    own_bytes = np.empty(3 * line + 4, np.uint8)
    rows, columns = f32_at(np.int64(own_rows.ctypes.data)), i32_at(np.int64(own_columns.ctypes.data))
    out, spare = f32_at(np.int64(own_out.ctypes.data)), u8_at(np.int64(own_bytes.ctypes.data))
    segment, records = begin_rows(job, np.int64(own_memory.ctypes.data), room, np.int64(1))
    none, nothing, instance = np.int64(0), u8_at(np.int64(0)), np.int64(0)
    for y in range(row_begin, row_end):
        if is_set(job[J_STOP]):
            break
        row = y - row_begin
        if out_at != 0:
            out = f32_at(out_at + (4 if mode == CUT else 16) * y * line)
        else:
            for x in range(0, 4 * line, vec.LANES):
                vec.store(out, x, vec.f32(0.0))
        seen = i32_at(ids_at + 4 * row * stride)
        instance = _row(
            job, segment, mode, y, seen, none, nothing, width, instance, records, out, line, columns, rows
        )  # fmt: skip
        if mode == EDGES:
            mixes = i32_at(address(edges.mixed) + 4 * row * stride)
            for k in range(edges.mixed_counts[row]):
                mix = np.int64(mixes[k])
                share = np.float32((mix >> 4) & 15) * np.float32(0.125)
                for c in range(4):
                    out[c * line + (mix >> 8)] *= share
            skip = row * edges.room
            seen, columns_at = i32_at(address(edges.entry_ids) + 4 * skip), address(edges.entry_columns) + 4 * skip
            weights, count = u8_at(address(edges.entry_weights) + skip), np.int64(edges.counts[row])
            instance = _row(
                job, segment, mode, y, seen, columns_at, weights, count, instance, records, out, line, columns, rows
            )  # fmt: skip
        if out_at == 0:
            finish_row(
                out, line, f32_at(finish[F_BEHIND]), finish[F_CELLS], width, spare, finish[F_COLOR] + 3 * y * width
            )
    # The pointers above do not keep the arrays alive.
    own_rows[0] = own_columns[0] = own_out[0] = own_bytes[0] = own_memory[0] = 0


B_SHADE: Final = 0  # address of shade_rows
B_JOB: Final = 1
B_WIDTH: Final = 2
B_FINISH: Final = 3
B_COLUMNS: Final = 4


@kernel("void(int64, int64, int64, int64, int64)")
def shade_edges(own_at, edges_at, stride, row_begin, row_end):
    """Shade a band's pixels and those at edges, and finish its rows; see ``visibility_buffer.SampledShader``.

    Args:
        own_at: address of B_COLUMNS int64.
    """
    own, ids = i64_at(own_at), address(sample_band_at(edges_at).ids)
    call_kernel(
        own[B_SHADE],
        (EDGES, own[B_JOB], ids, edges_at, stride, own[B_WIDTH], row_begin, row_end, np.int64(0), own[B_FINISH]),
    )
