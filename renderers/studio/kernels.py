"""Rows of a layer: what pixels see is gathered by ``surface`` one by one, and lit by ``lighting`` eight at a time."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from renderers.jit import kernel
from renderers.pointers import f32_at, f64_at, i32_at, i64_at, u8_at
from renderers.samples import E_COUNTS, E_MIXED, E_MIXES, E_PLACES, E_RECORDS, E_ROOM, E_WEIGHTS
from renderers.studio.layout import (
    G_ALPHA,
    G_EMITTED,
    G_LIGHT,
    G_ROWS,
    J_COUNT,
    J_FIRST,
    J_INSTANCES,
    J_N,
    J_X,
    PART,
    SCRATCH_VALUES,
    STRIDE,
)
from renderers.studio.lighting import light_up
from renderers.studio.surface import NO_ELEMENT, NOTHING, SHOWN, element_of, look_at
from renderers.studio.tables import II_COLUMNS

ADD: Final = 0
"""Add the layer; whatever its alpha, it covers."""
BENEATH: Final = 1
"""Add the layer behind those that are there already."""
EDGES: Final = 2
"""Add what samples see: ``samples.E_IDS``, where pixels are mixed by its share, and the entries by theirs."""


@njit(nogil=True, error_model="numpy", forceinline=True)
def _add(mode, out, x, rows, row, slot):  # type: ignore[no-untyped-def]
    """Add the colour in the rows from ``row`` on to a pixel of the row ``out``."""
    share = rows[G_ALPHA * STRIDE + slot]
    if mode == BENEATH:
        share *= np.float32(1.0) - out[4 * x + 3]
    for k in range(3):
        out[4 * x + k] += share * rows[(row + k) * STRIDE + slot]
    out[4 * x + 3] += share


@njit(nogil=True, error_model="numpy")
def _light(job, mode, out, places, count, rows, scratch):  # type: ignore[no-untyped-def]
    """Light what was gathered, and add it to the row."""
    light_up(job, rows, count, scratch)
    for slot in range(count):
        _add(mode, out, places[slot], rows, G_LIGHT, slot)


@njit(nogil=True, error_model="numpy")
def _row(job, mode, y, records, columns_at, weights, count, hint, out, places, rows, scratch):  # type: ignore[no-untyped-def]
    """Shade the records of one row and add them to it; returns the instance seen last, a hint for the next row.

    Args:
        records: pointer to ``count`` int32. columns_at: address of their columns, int32; 0: where they lie.
        weights: pointer to their samples of 8, uint8; read only with ``columns_at``.
    """
    first_record = i64_at(job[J_FIRST])
    before, slot = np.int64(-1), 0
    columns, X, N, element = i64_at(job[J_INSTANCES]), f64_at(job[J_X]), f64_at(job[J_N]), NO_ELEMENT
    for k in range(count):
        record = np.int64(records[k])
        x, weight = np.int64(k), np.float32(1.0)
        if columns_at != 0:
            x, weight = np.int64(i32_at(columns_at)[k]), np.float32(weights[k]) * np.float32(0.125)
        if record < 0 or (mode == BENEATH and out[4 * x + 3] >= 1.0):
            continue
        if record != before:
            before = record
            if not (first_record[hint] <= record and record < first_record[hint + 1]):
                low, high = np.int64(0), job[J_COUNT]
                while high - low > 1:
                    middle = (low + high) >> 1
                    if first_record[middle] <= record:
                        low = middle
                    else:
                        high = middle
                hint = low
            columns = i64_at(job[J_INSTANCES] + 8 * II_COLUMNS * hint)
            X, N = f64_at(job[J_X] + 8 * 16 * hint), f64_at(job[J_N] + 8 * 9 * hint)
            element = element_of(columns, X, N, record - first_record[hint])
        found = look_at(job, columns, X, element, record - first_record[hint], x, y, rows, slot)
        if found == NOTHING:
            continue
        if mode != BENEATH:
            rows[G_ALPHA * STRIDE + slot] = weight
        if found == SHOWN:
            _add(mode, out, x, rows, G_EMITTED, slot)
            continue
        places[slot] = x
        slot += 1
        if slot == PART:
            _light(job, mode, out, places, slot, rows, scratch)
            slot = 0
    if slot > 0:
        _light(job, mode, out, places, slot, rows, scratch)
    return hint


@kernel("void(int64, int64, int64, int64, int64, int64, int64, int64, int64)")
def shade_rows(mode, job_at, ids_at, edges_at, stride, width, row_begin, row_end, out_at):  # type: ignore[no-untyped-def]
    """Shades the rows ``row_begin .. row_end - 1`` of a layer; every pixel is independent of all others.

    Args:
        mode: ``ADD``, ``BENEATH`` or ``EDGES``.
        job_at: address of J_COLUMNS int64.
        ids_at: address of the first of the rows: int32 record per pixel, -1 for none, rows ``stride`` values apart.
        edges_at: for ``EDGES``, address of the band's ``samples.E_COLUMNS`` int64.
        out_at: address of (H, width, 4) float32: tone-mapped linear colour times coverage, and coverage. Must be 0 for
            ``ADD`` and ``EDGES``.
    """
    own_rows = np.zeros(G_ROWS * STRIDE, np.float32)
    own_places = np.empty(PART, np.int64)
    own_scratch = np.empty(SCRATCH_VALUES, np.int32)
    job, edges = i64_at(job_at), i64_at(edges_at)
    rows = f32_at(np.int64(own_rows.ctypes.data))
    places = i64_at(np.int64(own_places.ctypes.data))
    scratch = np.int64(own_scratch.ctypes.data)
    hint = np.int64(0)
    for y in range(row_begin, row_end):
        row = y - row_begin
        out = f32_at(out_at + 16 * y * width)
        nothing = u8_at(np.int64(0))
        ids = i32_at(ids_at + 4 * row * stride)
        hint = _row(job, mode, y, ids, np.int64(0), nothing, width, hint, out, places, rows, scratch)
        if mode == EDGES:
            mixes = i32_at(edges[E_MIXES] + 4 * row * stride)
            for k in range(i32_at(edges[E_MIXED])[row]):
                mix = np.int64(mixes[k])
                share = np.float32((mix >> 4) & 15) * np.float32(0.125)
                for c in range(4):
                    out[4 * (mix >> 8) + c] *= share
            skip = row * edges[E_ROOM]
            records, columns_at = i32_at(edges[E_RECORDS] + 4 * skip), edges[E_PLACES] + 4 * skip
            weights, count = u8_at(edges[E_WEIGHTS] + skip), np.int64(i32_at(edges[E_COUNTS])[row])
            hint = _row(job, mode, y, records, columns_at, weights, count, hint, out, places, rows, scratch)
    own_rows[0] = own_places[0] = own_scratch[0] = 0  # the pointers above do not keep the arrays alive
