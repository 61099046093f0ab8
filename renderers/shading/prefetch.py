"""Fetching what shading will read. Meshes of many triangles lie in no cache of a core, and whatever sees one waits for
an element and then for its three vertices."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, u32_at
from renderers.shading.layout import II_ELEMENTS, II_VERTICES, V_COLUMNS

_VERTICES: Final = 16
_ELEMENTS: Final = 32
"""Records ahead: two and four vectors."""


@inlined
def look_ahead(records, at, end, first, elements, vertices):
    """Fetch for the eight records from ``at`` on, and some behind them.

    Args:
        records: pointer to int32, readable up to ``at`` + 39; those before ``end`` are elements' numbers plus
            ``first``.
        elements: pointer to (M, 3) uint32. vertices: pointer to (N, V_COLUMNS) float32.
    """
    if at + _VERTICES + vec.LANES <= end:
        for k in range(vec.LANES):
            element = 3 * (np.int64(records[at + _VERTICES + k]) - first)
            for corner in range(3):
                vec.prefetch(vertices, np.int64(elements[element + corner]) * V_COLUMNS)
    for k in range(vec.LANES):  # those behind the end are fetched in vain
        vec.prefetch(elements, 3 * (np.int64(records[at + _ELEMENTS + k]) - first))


@inner
def look_ahead_of_runs(columns, first, ids, starts, run, last_run):
    """Fetch what ``resolve.set_up`` will read of the next eight runs, and the elements of the eight after these."""
    elements, vertices = u32_at(columns[II_ELEMENTS]), f32_at(columns[II_VERTICES])
    for k in range(run + vec.LANES, min(run + 2 * vec.LANES, last_run)):
        element = 3 * (np.int64(ids[starts[k]]) - first)
        for corner in range(3):
            vec.prefetch(vertices, np.int64(elements[element + corner]) * V_COLUMNS)
    for k in range(run + 2 * vec.LANES, min(run + 3 * vec.LANES, last_run)):
        vec.prefetch(elements, 3 * (np.int64(ids[starts[k]]) - first))
