"""Segments of one colour under the head light, resolved and shaded in one go: nothing is stored between.

What most of a picture is: walls whose normals are the same at all three corners, whose runs are copies of one pixel;
and triangles of some pixels a row, whose normals are linear along a run and are shaded eight pixels at a time.
"""

from __future__ import annotations

import numpy as np

from renderers import simd as vec
from renderers.linked import inner
from renderers.pointers import f32_at, i32_at, u32_at
from renderers.shading.head import colors_of, shine
from renderers.shading.layout import II_ELEMENTS, II_VERTICES, P_NORMAL, V_COLUMNS
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
    pixel_of,
    planes_of,
    set_up,
)
from renderers.shading.surface import turned


@inner
def fill(line, begin, end, pixels):
    """Eight equal packed pixels over a part of a row."""
    for x in range(begin, end, vec.LANES):
        vec.store(line, x, pixels)


@inner
def _bounded(columns, maps, element, facing, start, slope, begin, end, colors, line):
    """A run that a pixel of lies beside its triangle: as coverage is exact in 1/256 pixel, some do by a little.
    Negative coordinates become 0, so that nothing is extrapolated."""
    elements, vertices = u32_at(columns[II_ELEMENTS]), f32_at(columns[II_VERTICES])
    a = vec.load(vertices, np.int64(elements[3 * element]) * V_COLUMNS)
    b = vec.load(vertices, np.int64(elements[3 * element + 1]) * V_COLUMNS)
    c = vec.load(vertices, np.int64(elements[3 * element + 2]) * V_COLUMNS)
    lane, zero, seen = vec.to_f32(vec.iota()), vec.f32(0.0), vec.f32(-facing)
    for x in range(begin, end, vec.LANES):
        offset = lane + vec.f32(x - begin)
        w0 = vec.most(vec.spread3(start) + vec.spread3(slope) * offset, zero)
        w1 = vec.most(vec.spread4(start) + vec.spread4(slope) * offset, zero)
        w2 = vec.most(vec.spread5(start) + vec.spread5(slope) * offset, zero)
        nx = w0 * vec.spread3(a) + w1 * vec.spread3(b) + w2 * vec.spread3(c)
        ny = w0 * vec.spread4(a) + w1 * vec.spread4(b) + w2 * vec.spread4(c)
        nz = w0 * vec.spread5(a) + w1 * vec.spread5(b) + w2 * vec.spread5(c)
        nx, ny, nz = turned(maps, P_NORMAL, nx, ny, nz)
        vec.store(line, x, shine(nz * seen, nx * nx + ny * ny + nz * nz, colors))


@inner
def show_plain(columns, m, maps, lens, y, places, first, many, smooth, mf, ids, starts, run, last_run, line, memory):
    """Pixels of the runs ``run .. last_run`` of one instance's triangles, whose colour is the material's factor.

    Args:
        columns .. last_run: as for ``resolve.resolve_triangles``; maps, mf: the instance's and the material's rows of
            values; smooth: whether the mesh has normals.
        line: pointer to the row's packed pixels; up to seven behind the last run are overwritten.
        memory: see ``planes.forget``.
    """
    colors = colors_of(mf)
    lane, zero, eight = vec.to_f32(vec.iota()), vec.f32(0.0), vec.f32(8.0)
    for batch in range(run, last_run, AHEAD):
        stop = min(batch + AHEAD, last_run)
        missing = look_up(ids, starts, places, batch, stop, memory)
        for k in range(0, missing, vec.LANES):
            set_up(columns, m, maps, lens, y, first, many, smooth, colors, memory, k, missing)
        for r in range(batch, stop):
            begin, end = np.int64(starts[r]), np.int64(starts[r + 1])
            record = np.int64(ids[begin])
            column = begin if places == 0 else np.int64(i32_at(places)[begin])
            if not knows(memory, record):  # another of these runs has taken its place
                miss(memory, record, column)
                set_up(columns, m, maps, lens, y, first, False, smooth, colors, memory, 0, 1)
            pixel = np.int64(pixel_of(memory, record))
            if pixel >= 0:
                fill(line, begin, end, vec.i32(pixel))
                continue
            planes = planes_of(memory, record)
            right, down = np.float32(column) - planes[PL_COLUMN], np.float32(y) - planes[PL_LINE]
            slope = vec.load(planes, 2 * ROW_VALUES)
            start = vec.load(planes, 0) + (vec.f32(down) * vec.load(planes, ROW_VALUES) + vec.f32(right) * slope)
            last = start + slope * vec.f32(end - 1 - begin)
            if vec.bits(vec.least(start, last) < zero) & OUTSIDE != 0:
                facing = np.float32(planes[PL_FACING])
                _bounded(columns, maps, record - first, facing, start, slope, begin, end, colors, line)
                continue
            nx = vec.spread0(start) + vec.spread0(slope) * lane
            ny = vec.spread1(start) + vec.spread1(slope) * lane
            nz = vec.spread2(start) + vec.spread2(slope) * lane
            further = slope * eight
            dx, dy, dz = vec.spread0(further), vec.spread1(further), vec.spread2(further)
            for x in range(begin, end, vec.LANES):
                vec.store(line, x, shine(nz, nx * nx + ny * ny + nz * nz, colors))
                nx, ny, nz = nx + dx, ny + dy, nz + dz
