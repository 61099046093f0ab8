"""Normals of segments under the look ``pbr`` whose materials are nothing but factors: linear along a run, as in
``plain``, but side by side in rows. Light takes so long there that every lane must belong to a pixel."""

from __future__ import annotations

import numpy as np

from renderers import simd as vec
from renderers.linked import inlined, inner
from renderers.pointers import f32_at, u32_at
from renderers.shading.head import colors_of
from renderers.shading.layout import A_NORMAL, II_ELEMENTS, II_VERTICES, P_NORMAL, V_COLUMNS
from renderers.shading.planes import (
    AHEAD,
    OUTSIDE,
    PL_COLUMN,
    PL_FACING,
    PL_LINE,
    ROW_VALUES,
    knows,
    look_up,
    miss,
    planes_of,
    set_up,
)
from renderers.shading.surface import turned


@inlined
def _put(rows, stride, x, nx, ny, towards):
    at = A_NORMAL * stride + x
    vec.store(rows, at, nx)
    vec.store(rows, at + stride, ny)
    vec.store(rows, at + 2 * stride, towards)


@inner
def _bounded(columns, maps, element, facing, start, slope, begin, end, rows, stride):
    """A run that a pixel of lies beside its triangle, as in ``plain``."""
    elements, vertices = u32_at(columns[II_ELEMENTS]), f32_at(columns[II_VERTICES])
    a = vec.load(vertices, np.int64(elements[3 * element]) * V_COLUMNS)
    b = vec.load(vertices, np.int64(elements[3 * element + 1]) * V_COLUMNS)
    c = vec.load(vertices, np.int64(elements[3 * element + 2]) * V_COLUMNS)
    lane, zero, seen = vec.to_f32(vec.iota()), vec.f32(0.0), vec.f32(facing)
    for x in range(begin, end, vec.LANES):
        offset = lane + vec.f32(x - begin)
        w0 = vec.most(vec.spread3(start) + vec.spread3(slope) * offset, zero)
        w1 = vec.most(vec.spread4(start) + vec.spread4(slope) * offset, zero)
        w2 = vec.most(vec.spread5(start) + vec.spread5(slope) * offset, zero)
        nx = w0 * vec.spread3(a) + w1 * vec.spread3(b) + w2 * vec.spread3(c)
        ny = w0 * vec.spread4(a) + w1 * vec.spread4(b) + w2 * vec.spread4(c)
        nz = w0 * vec.spread5(a) + w1 * vec.spread5(b) + w2 * vec.spread5(c)
        nx, ny, nz = turned(maps, P_NORMAL, nx, ny, nz)
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
    lane, zero, eight = vec.to_f32(vec.iota()), vec.f32(0.0), vec.f32(8.0)
    for batch in range(0, runs, AHEAD):
        stop = min(batch + AHEAD, runs)
        missing = look_up(ids, starts, none, batch, stop, memory)
        for k in range(0, missing, vec.LANES):
            set_up(columns, m, maps, lens, y, first, many, True, colors, memory, k, missing)
        for r in range(batch, stop):
            begin, end = np.int64(starts[r]), np.int64(starts[r + 1])
            record = np.int64(ids[begin])
            if not knows(memory, record):  # another of these runs has taken its place
                miss(memory, record, begin)
                set_up(columns, m, maps, lens, y, first, False, True, colors, memory, 0, 1)
            planes = planes_of(memory, record)
            right, down = np.float32(begin) - planes[PL_COLUMN], np.float32(y) - planes[PL_LINE]
            slope = vec.load(planes, 2 * ROW_VALUES)
            start = vec.load(planes, 0) + (vec.f32(down) * vec.load(planes, ROW_VALUES) + vec.f32(right) * slope)
            last = start + slope * vec.f32(end - 1 - begin)
            if vec.bits(vec.least(start, last) < zero) & OUTSIDE != 0:
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
