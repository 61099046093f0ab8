"""Normals of segments under the look ``pbr`` whose materials are nothing but factors: linear along a run, as in
``plain``, but side by side in rows. Light takes so long there that every lane must belong to a pixel."""

from __future__ import annotations

import numpy as np

from renderers import simd as vec
from renderers.linked import inlined, inner
from renderers.shading.head import colors_of
from renderers.shading.layout import A_NORMAL
from renderers.shading.planes import (
    AHEAD,
    PL_FACING,
    along,
    bounded_normals,
    corners_of,
    look_up,
    planes_of,
    set_up,
    stand_in,
    strays,
)


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
def lay_normals(columns, m, maps, lens, y, first, many, mf, ids, starts, runs, rows, stride, memory):
    """Put the normals of ``runs`` runs of one instance's triangles, whose mesh has normals, into the rows A_NORMAL: in
    the optical frame, of any length, on the side that is seen, with minus their z.

    Args:
        columns, m, lens, y, first, many, ids, starts: as for ``resolve.resolve_triangles``; rows: its rows of
            ``stride`` values, of which up to seven behind the last run are overwritten.
        maps, mf: the instance's and the material's rows of values. memory: see ``planes.forget``.
    """
    colors, none = colors_of(mf), np.int64(0)
    lane, eight = vec.to_f32(vec.iota()), vec.f32(8.0)
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
            for x in range(begin, end, vec.LANES):
                _put(rows, stride, x, nx, ny, nz)
                nx, ny, nz = nx + dx, ny + dy, nz + dz
