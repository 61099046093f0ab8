"""Segments under the look ``pbr`` whose materials are nothing but factors. Normals are linear along a run, as in
``plain``, but side by side in rows: light takes so long there that every lane must belong to a pixel. Long runs of flat
surfaces need neither.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.linked import inlined, inner
from renderers.shading.flat import SHORTEST, changes_slowly, show_flat
from renderers.shading.head import colors_of
from renderers.shading.layout import A_NORMAL, HAS_NORMALS
from renderers.shading.planes import (
    AHEAD,
    PL_FACING,
    along,
    bounded_normals,
    corners_of,
    look_up,
    pixel_of,
    planes_of,
    set_up,
    stand_in,
    strays,
)
from renderers.shading.surface import UNIFORM, light_pbr

PART: Final = 256
"""Pixels shaded at a time: their rows of attributes stay in the first-level cache."""


@inner
def light_up(job, has, mi, mf, maps, y, places, rows, stride, begin, end, line, steep):
    """Shade the pixels ``begin .. end`` from the normals in the rows, as ``show_plain_pbr`` has them."""
    for part in range(begin, end, PART):
        stop = min(part + PART, end)
        light_pbr(job, has, mi, mf, maps, y, places, UNIFORM, True, rows, stride, part, stop, line, steep)


@inlined
def _put(rows, stride, x, nx, ny, towards):
    at = A_NORMAL * stride + x
    vec.store(rows, at, nx)
    vec.store(rows, at + stride, ny)
    vec.store(rows, at + 2 * stride, towards)


@inner
def _bounded(columns, maps, element, facing, start, slope, begin, end, rows, stride):
    """A run that ``strays``."""
    a, b, c = corners_of(columns, element)
    lane, seen = vec.to_f32(vec.iota()), vec.f32(facing)
    for x in range(begin, end, vec.LANES):
        nx, ny, nz = bounded_normals(maps, a, b, c, start, slope, lane + vec.f32(x - begin))
        _put(rows, stride, x, nx * seen, ny * seen, -(nz * seen))


@inner
def show_plain_pbr(
    job, columns, m, maps, lens, y, first, many, mi, mf, ids, starts, runs, rows, stride, line, memory, steep
):  # fmt: skip
    """Pixels of ``runs`` runs of one instance's triangles, whose mesh has normals.

    Args:
        columns, m, lens, y, first, many, ids, starts: as for ``resolve.resolve_triangles``; rows: its rows of
            ``stride`` values, 16 more than the row has pixels: what is written behind a run is overwritten later.
        maps, mi, mf: the instance's and the material's rows of values. memory: see ``planes.forget``.
        line: pointer to the row's packed pixels; up to seven behind the last run are overwritten.
        steep: see ``surface.row_schlick``.
    """
    colors, none = colors_of(mf), np.int64(0)
    lane, eight = vec.to_f32(vec.iota()), vec.f32(8.0)
    shown = np.int64(starts[0])
    for batch in range(0, runs, AHEAD):
        stop = min(batch + AHEAD, runs)
        missing = look_up(ids, starts, none, batch, stop, memory)
        for k in range(0, missing, vec.LANES):
            set_up(columns, m, maps, lens, y, first, many, True, colors, memory, k, missing)
        for r in range(batch, stop):
            begin, end = np.int64(starts[r]), np.int64(starts[r + 1])
            record = np.int64(ids[begin])
            stand_in(columns, m, maps, lens, y, first, True, colors, memory, record, begin)
            planes = planes_of(memory, record)
            if end - begin >= SHORTEST and pixel_of(memory, record) >= 0 and changes_slowly(mf, lens):
                light_up(job, HAS_NORMALS, mi, mf, maps, y, none, rows, stride, shown, begin, line, steep)
                shown = begin
                if show_flat(job, mf, lens, y, planes, rows, stride, begin, end, line, steep):
                    shown = end
                    continue
            start, slope = along(planes, y, begin)
            if strays(start, slope, end - begin):
                facing = np.float32(planes[PL_FACING])
                _bounded(columns, maps, record - first, facing, start, slope, begin, end, rows, stride)
                continue
            nx = vec.spread0(start) + vec.spread0(slope) * lane
            ny = vec.spread1(start) + vec.spread1(slope) * lane
            nz = vec.spread2(start) + vec.spread2(slope) * lane
            further = slope * eight
            dx, dy, dz = vec.spread0(further), vec.spread1(further), vec.spread2(further)
            _put(rows, stride, begin, nx, ny, nz)
            nx, ny, nz = nx + dx, ny + dy, nz + dz
            # Whether a run has more than eight pixels cannot be predicted.
            _put(rows, stride, begin + vec.LANES, nx, ny, nz)
            for x in range(begin + 2 * vec.LANES, end, vec.LANES):
                nx, ny, nz = nx + dx, ny + dy, nz + dz
                _put(rows, stride, x, nx, ny, nz)
    light_up(job, HAS_NORMALS, mi, mf, maps, y, none, rows, stride, shown, np.int64(starts[runs]), line, steep)
