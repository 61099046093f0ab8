"""Rows of a layer: what pixels see is gathered by instance and looked at, lit and added eight at a time."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel, is_set
from renderers.compiler.pointers import address, f32_at, i32_at, i64_at, u8_at
from renderers.msaa import sample_band_at
from renderers.primitive_ids import instance_of
from renderers.shading.studio.layout import (
    F_BEHIND,
    F_CELLS,
    F_COLOR,
    G_ALPHA,
    G_EMITTED,
    G_LIGHT,
    G_ROWS,
    J_COUNT,
    J_FIRST,
    J_INSTANCES,
    J_STOP,
    PART,
    STRIDE,
    line_in_kernel,
)
from renderers.shading.studio.lighting import light_up
from renderers.shading.studio.material import ALPHA, COLOR, COLOR_AND_ALPHA, SHOWN, look_at
from renderers.shading.studio.tables import II_COLUMNS
from renderers.shading.studio.tone_mapping import finish_row

ADD: Final = 0
"""Add the layer; whatever its alpha, it covers."""
BENEATH: Final = 1
"""Add the layer behind those that are there already."""
CUT: Final = 3
"""Only mark where the layer is not cut out."""
EDGES: Final = 2
"""Add what samples see: ``msaa.SAMPLE_BAND``, where pixels are mixed by its share, and the entries by theirs."""


@inlined
def _add_one(mode, out, line, x, rows, row, slot):
    share = rows[G_ALPHA * STRIDE + slot]
    if mode == BENEATH:
        share *= np.float32(1.0) - out[3 * line + x]
    for k in range(3):
        out[k * line + x] += share * rows[(row + k) * STRIDE + slot]
    out[3 * line + x] += share


@inner
def _add(mode, out, line, places, rows, row, begin, end):
    """Add the colours of slots in the rows from ``row`` on to their pixels.

    Args:
        out: pointer to four lines of ``line`` float32.
    """
    lane, one, zero = vec.iota(), vec.f32(1.0), vec.f32(0.0)
    for slot in range(begin, end, vec.LANES):
        x, count = np.int64(places[slot]), end - slot
        here = lane < vec.i32(count)
        if vec.bits(here & (vec.load(places, slot) != vec.i32(x) + lane)) != 0:
            for k in range(min(count, vec.LANES)):
                _add_one(mode, out, line, np.int64(places[slot + k]), rows, row, slot + k)
            continue
        share = vec.load(rows, G_ALPHA * STRIDE + slot)
        covered = vec.load(out, 3 * line + x)
        if mode == BENEATH:
            share = share * (one - covered)
        for k in range(3):
            there = vec.load(out, k * line + x)
            added = share * vec.load(rows, (row + k) * STRIDE + slot)
            vec.store(out, k * line + x, there + vec.select(here, added, zero))
        vec.store(out, 3 * line + x, covered + vec.select(here, share, zero))


@inner
def _look(job, mode, instance, elements, places, begin, end, y, out, line, rows):
    """Look at the slots ``begin .. end`` of one instance; returns the end of those that are to be lit."""
    if begin == end:
        return end
    columns = i64_at(job[J_INSTANCES] + 8 * II_COLUMNS * instance)
    for k in range(vec.LANES):  # the last eight are whole
        elements[end + k], places[end + k] = elements[end - 1], places[end - 1]
    kind, wanted = SHOWN, COLOR
    if mode == BENEATH:
        wanted = COLOR_AND_ALPHA
    elif mode == CUT:
        wanted = ALPHA
    for slot in range(begin, end, vec.LANES):
        kind = look_at(job, columns, instance, wanted, elements, places, slot, y, rows)
    if mode == CUT:
        for slot in range(begin, end):
            out[places[slot]] = rows[G_ALPHA * STRIDE + slot]
        return begin
    if kind == SHOWN:
        _add(mode, out, line, places, rows, G_EMITTED, begin, end)
        return begin
    return end


@inner
def _light(job, mode, out, line, places, count, rows):
    """Light what was gathered, and add it to the row."""
    if count > 0:
        light_up(job, rows, count)
        _add(mode, out, line, places, rows, G_LIGHT, 0, count)


@inner
def _row(job, mode, y, records, columns_at, weights, count, hint, out, line, elements, places, rows):
    """Shade the records of one row and add them to it; returns the instance seen last, a hint for the next row.

    Args:
        records: pointer to ``count`` int32. columns_at: address of their columns, int32; 0: where they lie.
        weights: pointer to their samples of 8, uint8; read only with ``columns_at``.
        out: pointer to four lines of ``line`` float32.
        elements, places: pointers to STRIDE int32.
    """
    first_record = i64_at(job[J_FIRST])
    begin, slot = np.int64(0), np.int64(0)
    first, last = first_record[hint], first_record[hint + 1]
    lane, eight = vec.iota(), np.int64(vec.LANES)
    k = np.int64(0)
    while k < count:
        if columns_at == 0 and mode != BENEATH and mode != CUT and k + eight <= count and slot + eight <= PART:
            # Mostly, neighbours see one instance.
            here = vec.load(records, k)
            if vec.bits((here >= vec.i32(first)) & (here < vec.i32(last))) == 255:
                vec.store(elements, slot, here - vec.i32(first))
                vec.store(places, slot, vec.i32(k) + lane)
                vec.store(rows, G_ALPHA * STRIDE + slot, vec.f32(1.0))
                slot += eight
                k += eight
                continue
        record = np.int64(records[k])
        x, weight = np.int64(k), np.float32(1.0)
        if columns_at != 0:
            x, weight = np.int64(i32_at(columns_at)[k]), np.float32(weights[k]) * np.float32(0.125)
        if record < 0 or (mode == BENEATH and out[3 * line + x] >= 1.0):
            k += 1
            continue
        full = slot == PART
        if full or not (first <= record and record < last):
            begin = slot = _look(job, mode, hint, elements, places, begin, slot, y, out, line, rows)
            if full:
                _light(job, mode, out, line, places, slot, rows)
                begin = slot = np.int64(0)
            if not (first <= record and record < last):
                hint = instance_of(first_record, job[J_COUNT], record, hint)
                first, last = first_record[hint], first_record[hint + 1]
        elements[slot] = record - first
        places[slot] = x
        if mode in (ADD, EDGES):
            rows[G_ALPHA * STRIDE + slot] = weight
        slot += 1
        k += 1
    slot = _look(job, mode, hint, elements, places, begin, slot, y, out, line, rows)
    _light(job, mode, out, line, places, slot, rows)
    return hint


@kernel("void(int64, int64, int64, int64, int64, int64, int64, int64, int64, int64)")
def shade_rows(mode, job_at, ids_at, edges_at, stride, width, row_begin, row_end, out_at, finish_at):
    """Shades the rows ``row_begin .. row_end - 1`` of a layer; every pixel is independent of all others.

    Args:
        mode: ``ADD``, ``BENEATH``, ``EDGES`` or ``CUT``.
        job_at: address of J_COLUMNS int64.
        ids_at: address of the first of the rows: int32 record per pixel, -1 for none, rows ``stride`` values apart.
        edges_at: for ``EDGES``, address of the band's ``samples.E_COLUMNS`` int64.
        out_at: address of (H, 4, line_of(width)) float32, to which is added: tone-mapped linear colour times coverage,
            and coverage. For ``CUT`` of (H, line_of(width)) float32, into which alpha is put where the layer is seen.
            0: the rows are finished at once.
        finish_at: address of F_COLUMNS int64; read only without ``out_at``.
    """
    line = line_in_kernel(width)
    own_rows = np.zeros(G_ROWS * STRIDE, np.float32)
    own_slots = np.zeros(2 * STRIDE, np.int32)
    own_out = np.zeros(4 * line, np.float32)
    own_bytes = np.empty(3 * line + 4, np.uint8)
    job, edges, finish = i64_at(job_at), sample_band_at(edges_at), i64_at(finish_at)
    rows = f32_at(np.int64(own_rows.ctypes.data))
    elements = i32_at(np.int64(own_slots.ctypes.data))
    places = i32_at(np.int64(own_slots.ctypes.data) + 4 * STRIDE)
    out = f32_at(np.int64(own_out.ctypes.data))
    spare = u8_at(np.int64(own_bytes.ctypes.data))
    hint = np.int64(0)
    for y in range(row_begin, row_end):
        if is_set(job[J_STOP]):
            break
        row = y - row_begin
        if out_at != 0:
            out = f32_at(out_at + (4 if mode == CUT else 16) * y * line)
        else:
            for x in range(0, 4 * line, vec.LANES):
                vec.store(out, x, vec.f32(0.0))
        nothing = u8_at(np.int64(0))
        ids = i32_at(ids_at + 4 * row * stride)
        hint = _row(job, mode, y, ids, np.int64(0), nothing, width, hint, out, line, elements, places, rows)
        if mode == EDGES:
            mixes = i32_at(address(edges.mixed) + 4 * row * stride)
            for k in range(edges.mixed_counts[row]):
                mix = np.int64(mixes[k])
                share = np.float32((mix >> 4) & 15) * np.float32(0.125)
                for c in range(4):
                    out[c * line + (mix >> 8)] *= share
            skip = row * edges.room
            records, columns_at = i32_at(address(edges.entry_ids) + 4 * skip), address(edges.entry_columns) + 4 * skip
            weights, count = u8_at(address(edges.entry_weights) + skip), np.int64(edges.counts[row])
            hint = _row(job, mode, y, records, columns_at, weights, count, hint, out, line, elements, places, rows)
        if out_at == 0:
            finish_row(
                out, line, f32_at(finish[F_BEHIND]), finish[F_CELLS], width, spare, finish[F_COLOR] + 3 * y * width
            )
    # The pointers above do not keep the arrays alive.
    own_rows[0] = own_slots[0] = own_out[0] = own_bytes[0] = 0


B_SHADE: Final = 0  # address of shade_rows
B_JOB: Final = 1
B_WIDTH: Final = 2
B_FINISH: Final = 3
B_COLUMNS: Final = 4


@kernel("void(int64, int64, int64, int64, int64)")
def shade_edges(own_at, edges_at, stride, row_begin, row_end):
    """Shades a band's pixels and those at edges, and finishes its rows; see ``visibility.SampledShader``.

    Args:
        own_at: address of B_COLUMNS int64.
    """
    own, ids = i64_at(own_at), address(sample_band_at(edges_at).ids)
    call_kernel(
        own[B_SHADE],
        (EDGES, own[B_JOB], ids, edges_at, stride, own[B_WIDTH], row_begin, row_end, np.int64(0), own[B_FINISH]),
    )
