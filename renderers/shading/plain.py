"""Segments of one colour under the head light, resolved and shaded in one go: nothing is stored between.

What most of a picture is: walls whose normals are the same at all three corners, whose runs are copies of one pixel;
and triangles of some pixels a row, whose normals are linear along a run and are shaded eight pixels at a time.
"""

from __future__ import annotations

import numpy as np

from renderers import simd as vec
from renderers.linked import inner
from renderers.pointers import i32_at
from renderers.shading.head import colors_of, shine
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


@inner
def fill(line, begin, end, pixels):
    """Eight equal packed pixels over a part of a row."""
    for x in range(begin, end, vec.LANES):
        vec.store(line, x, pixels)


@inner
def _bounded(columns, maps, element, facing, start, slope, begin, end, colors, line):
    """A run that ``strays``."""
    a, b, c = corners_of(columns, element)
    lane, seen = vec.to_f32(vec.iota()), vec.f32(-facing)
    for x in range(begin, end, vec.LANES):
        nx, ny, nz = bounded_normals(maps, a, b, c, start, slope, lane + vec.f32(x - begin))
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
    lane, eight = vec.to_f32(vec.iota()), vec.f32(8.0)
    for batch in range(run, last_run, AHEAD):
        stop = min(batch + AHEAD, last_run)
        missing = look_up(ids, starts, places, batch, stop, memory)
        for k in range(0, missing, vec.LANES):
            set_up(columns, m, maps, lens, y, first, many, smooth, colors, memory, k, missing)
        for r in range(batch, stop):
            begin, end = np.int64(starts[r]), np.int64(starts[r + 1])
            record = np.int64(ids[begin])
            column = begin if places == 0 else np.int64(i32_at(places)[begin])
            stand_in(columns, m, maps, lens, y, first, smooth, colors, memory, record, column)
            pixel = np.int64(pixel_of(memory, record))
            if pixel >= 0:
                fill(line, begin, end, vec.i32(pixel))
                continue
            planes = planes_of(memory, record)
            start, slope = along(planes, y, column)
            if strays(start, slope, end - begin):
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
