"""Rows of a layer: what pixels see is gathered by ``surface`` one by one, and lit by ``lighting`` eight at a time."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from renderers.jit import kernel
from renderers.pointers import f32_at, f64_at, i64_at, u8_at
from renderers.studio.layout import (
    G_ALPHA,
    G_EMITTED,
    G_LIGHT,
    G_ROWS,
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
"""Add the layer, weighted by how many of a pixel's samples see it; whatever its alpha, it covers."""
BENEATH: Final = 1
"""Add the layer behind those that are there already."""


@njit(nogil=True, error_model="numpy", forceinline=True)
def _add(mode, out, counts, weight, x, rows, row, slot):  # type: ignore[no-untyped-def]
    """Add the colour in the rows from ``row`` on to a pixel of the row ``out``."""
    share = weight * counts[x] if mode == ADD else (1.0 - out[4 * x + 3]) * rows[G_ALPHA * STRIDE + slot]
    for k in range(3):
        out[4 * x + k] += np.float32(share * rows[(row + k) * STRIDE + slot])
    out[4 * x + 3] += np.float32(share)


@njit(nogil=True, error_model="numpy")
def _light(job, mode, out, counts, weight, places, count, rows, scratch):  # type: ignore[no-untyped-def]
    """Light what was gathered, and add it to the row."""
    light_up(job, rows, count, scratch)
    for slot in range(count):
        _add(mode, out, counts, weight, places[slot], rows, G_LIGHT, slot)


@kernel("void(int64, int64[::1], int32[:,::1], uint8[:,::1], float64, int64[::1], int64, int64, float32[:,:,::1])")
def shade_rows(mode, own_job, ids, own_counts, weight, first_record, row_begin, row_end, own_out):  # type: ignore[no-untyped-def]
    """Shades the rows ``row_begin .. row_end - 1`` of a layer; every pixel is independent of all others.

    Args:
        mode: ``ADD`` or ``BENEATH``.
        own_job: (J_COLUMNS,) int64.
        ids: (H, W) int32 record per pixel, -1 for none.
        own_counts: (H, W) uint8, for ``ADD``: how many samples see it, each of the share ``weight``.
        first_record: (I + 1,) int64.
        own_out: (H, W, 4) float32: tone-mapped linear colour times coverage, and coverage.
    """
    own_rows = np.zeros(G_ROWS * STRIDE, np.float32)
    own_places = np.empty(PART, np.int64)
    own_scratch = np.empty(SCRATCH_VALUES, np.int32)
    job = i64_at(np.int64(own_job.ctypes.data))
    rows = f32_at(np.int64(own_rows.ctypes.data))
    places = i64_at(np.int64(own_places.ctypes.data))
    scratch = np.int64(own_scratch.ctypes.data)
    width = ids.shape[1]
    hint = 0
    for y in range(row_begin, row_end):
        out = f32_at(np.int64(own_out.ctypes.data) + 16 * y * width)
        counts = u8_at(np.int64(own_counts.ctypes.data) + y * width)
        before, slot = -1, 0
        columns, X, N, element = i64_at(job[J_INSTANCES]), f64_at(job[J_X]), f64_at(job[J_N]), NO_ELEMENT
        for x in range(width):
            record = ids[y, x]
            if record < 0 or (mode == BENEATH and out[4 * x + 3] >= 1.0):
                continue
            if record != before:
                before = record
                if not first_record[hint] <= record < first_record[hint + 1]:
                    low, high = 0, first_record.shape[0] - 1
                    while high - low > 1:
                        middle = (low + high) >> 1
                        if first_record[middle] <= record:
                            low = middle
                        else:
                            high = middle
                    hint = low
                columns = i64_at(job[J_INSTANCES] + 8 * II_COLUMNS * hint)
                X, N = f64_at(job[J_X] + 8 * 16 * hint), f64_at(job[J_N] + 8 * 9 * hint)
                element = element_of(job, columns, X, record - first_record[hint])
            found = look_at(job, columns, X, N, element, record - first_record[hint], x, y, rows, slot)
            if found == NOTHING:
                continue
            if found == SHOWN:
                _add(mode, out, counts, weight, x, rows, G_EMITTED, slot)
                continue
            places[slot] = x
            slot += 1
            if slot == PART:
                _light(job, mode, out, counts, weight, places, slot, rows, scratch)
                slot = 0
        if slot > 0:
            _light(job, mode, out, counts, weight, places, slot, rows, scratch)
    own_rows[0] = own_places[0] = own_scratch[0] = 0  # the pointers above do not keep the arrays alive
