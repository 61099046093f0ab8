"""Segments under the look ``pbr`` whose materials are nothing but factors. Normals are linear along a run, as in
``plain``.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inner
from renderers.compiler.pointers import f32_at, i32_at
from renderers.shading.brdf import cosines
from renderers.shading.layout import A_NORMAL
from renderers.shading.material import finish_uniform, put_cosines
from renderers.shading.span_attributes import (
    B_STRAYS,
    bounded_normals,
    changes_after,
    lanes_of,
    normals_beside,
    passed,
)

PART: Final = 256
"""Pixels shaded at a time: their rows of attributes stay in the first-level cache."""


@inner
def light_up(job, mf, lens, y, places, rows, stride, begin, end, line, steep):
    """Shade the pixels ``begin .. end`` from their normals in the rows, on the side that is seen, with minus their
    z."""
    for part in range(begin, end, PART):
        stop = min(part + PART, end)
        put_cosines(lens, y, places, rows, stride, part, stop)
        finish_uniform(job, mf, y, places, rows, stride, part, stop, line, steep)


@inner
def put_cosines_of_runs(lens, y, starts, run, stop, masks, beside, room, rows, stride):
    """Write ``lights.cosines`` of the runs ``run .. stop``, of any number of instances, to the rows."""
    values = f32_at(beside)
    lane = vec.to_f32(vec.iota())
    left, across = vec.f32(0.5 - lens[2]), vec.f32(1.0 / lens[0])
    dy = vec.f32((y + 0.5 - lens[3]) / lens[1])
    high = dy * dy + vec.f32(1.0)
    for x in range(np.int64(starts[run]), np.int64(starts[stop]), vec.LANES):
        changed = changes_after(masks, x)
        nx, ny, towards = normals_beside(values, room, run, lanes_of(changed), x)
        at, dx = A_NORMAL * stride + x, (vec.f32(x) + lane + left) * across
        n_l, n_v, v_l = cosines(nx, ny, towards, dx, dy, high)
        vec.store(rows, at, n_l)
        vec.store(rows, at + stride, n_v)
        vec.store(rows, at + 2 * stride, v_l)
        run += vec.count_bits(changed)


@inner
def _put_stray(columns, maps, lens, y, element, begin, end, beside, room, run, rows, stride):
    """Write ``lights.cosines`` of a single run to the rows, and nothing behind its end."""
    lane = vec.to_f32(vec.iota())
    left, across = vec.f32(0.5 - lens[2]), vec.f32(1.0 / lens[0])
    dy = vec.f32((y + 0.5 - lens[3]) / lens[1])
    for x in range(begin, end, vec.LANES):
        offset = vec.f32(x - begin) + lane
        nx, ny, towards = bounded_normals(columns, maps, f32_at(beside), room, run, element, offset)
        dx = (vec.f32(x) + lane + left) * across
        at, inside = A_NORMAL * stride + x, vec.iota() < vec.i32(end - x)
        n_l, n_v, v_l = cosines(nx, ny, towards, dx, dy, dy * dy + vec.f32(1.0))
        vec.store_where(rows, at, inside, n_l)
        vec.store_where(rows, at + stride, inside, n_v)
        vec.store_where(rows, at + 2 * stride, inside, v_l)


@inner
def show_plain_pbr(
    job, columns, maps, lens, y, first, mf, records, starts, run, last_run, beside, room, stray, rows, stride, line,
    steep,
):  # fmt: skip
    """Pixels of the runs ``run .. last_run`` of one instance's triangles, whose mesh has normals.

    Args:
        columns .. stray: as for ``plain.show_plain``.
        rows: rows of ``stride`` values, 16 more than the row has pixels, filled by ``put_cosines_of_runs``.
        line: pointer to the row's packed pixels; up to seven behind the last run are overwritten.
        steep: see ``surface.row_schlick``.

    Returns:
        ``stray`` of the next segment.
    """
    whole = i32_at(beside)
    stray = passed(whole, B_STRAYS * room, stray, run)
    while whole[B_STRAYS * room + stray] < last_run:
        number = np.int64(whole[B_STRAYS * room + stray])
        stray += 1
        begin, end, element = np.int64(starts[number]), np.int64(starts[number + 1]), records[number] - first
        _put_stray(columns, maps, lens, y, element, begin, end, beside, room, number, rows, stride)
    begin, end = np.int64(starts[run]), np.int64(starts[last_run])
    for part in range(begin, end, PART):
        finish_uniform(job, mf, y, np.int64(0), rows, stride, part, min(part + PART, end), line, steep)
    return stray
