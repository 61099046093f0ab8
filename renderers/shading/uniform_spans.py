"""Segments of one colour under the head light, from the planes of their triangles to pixels in one go.

What most of a picture is: walls whose normals are the same at all three corners, whose runs are copies of one pixel;
and triangles of some pixels a row, whose normals are linear along a run and are shaded eight pixels at a time.
"""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, i32_at
from renderers.shading.headlight import colors_of, shine
from renderers.shading.span_attributes import (
    B_FLAT,
    B_PIXEL,
    B_STRAYS,
    bounded_normals,
    changes_after,
    lanes_of,
    normals_beside,
    passed,
)


@inner
def fill(line, begin, end, pixels):
    """Eight equal packed pixels over a part of a row."""
    for x in range(begin, end, vec.LANES):
        vec.store(line, x, pixels)


@inlined
def _shine(beside, room, masks, smooth, uniform, run, begin, end, colors, line):
    values, whole = f32_at(beside), i32_at(beside)
    for x in range(begin, end, vec.LANES):
        changed = changes_after(masks, x)
        lanes = lanes_of(changed)
        if smooth:
            nx, ny, nz = normals_beside(values, room, run, lanes, x)
            pixels = shine(nz, nx * nx + ny * ny + nz * nz, colors)
            if uniform:
                own = vec.permute(vec.load(whole, B_PIXEL * room + run), lanes)
                pixels = vec.select(own >= vec.i32(0), own, pixels)
        else:
            pixels = vec.permute(vec.load(whole, B_PIXEL * room + run), lanes)
        vec.store(line, x, pixels)
        run += vec.count_bits(changed)


@inner
def _show(beside, room, masks, smooth, uniform, run, begin, end, colors, line):
    """The pixels ``begin .. end``; ``run``: of the first."""
    if not smooth:
        _shine(beside, room, masks, False, False, run, begin, end, colors, line)
    elif uniform:
        _shine(beside, room, masks, True, True, run, begin, end, colors, line)
    else:
        _shine(beside, room, masks, True, False, run, begin, end, colors, line)


@inner
def show_plain(
    columns, maps, first, smooth, mf, records, starts, run, last_run, masks, beside, room, uniform, flat, stray, line
):  # fmt: skip
    """Pixels of the runs ``run .. last_run`` of one instance's triangles, whose colour is the material's factor.

    Args:
        columns, first: as for ``resolve.resolve_triangles``; maps, mf: the instance's and the material's values.
        smooth: whether the mesh has normals.
        records, starts: pointers to int32, the record and the first pixel of each run of the row, and what is behind
            the last. masks: see ``runs.find_runs``.
        beside, room: see ``beside.put_beside``. uniform: whether any run of the row is flat.
        flat, stray: how many at least of each kind lie before ``run``.
        line: pointer to the row's packed pixels; up to seven behind the last run are overwritten.

    Returns:
        ``flat`` and ``stray`` of the next segment.
    """
    colors, whole, values = colors_of(mf), i32_at(beside), f32_at(beside)
    flat, stray = passed(whole, B_FLAT * room, flat, run), passed(whole, B_STRAYS * room, stray, run)
    while whole[B_FLAT * room + flat] < last_run:
        r = np.int64(whole[B_FLAT * room + flat])
        flat += 1
        begin, end = np.int64(starts[r]), np.int64(starts[r + 1])
        if run < r:
            _show(beside, room, masks, smooth, uniform, run, np.int64(starts[run]), begin, colors, line)
        fill(line, begin, end, vec.i32(np.int64(whole[B_PIXEL * room + r])))
        run = r + 1
    if run < last_run:
        begin, end = np.int64(starts[run]), np.int64(starts[last_run])
        _show(beside, room, masks, smooth, uniform, run, begin, end, colors, line)
    while whole[B_STRAYS * room + stray] < last_run:
        r = np.int64(whole[B_STRAYS * room + stray])
        stray += 1
        begin, end = np.int64(starts[r]), np.int64(starts[r + 1])
        for x in range(begin, end, vec.LANES):
            offset = vec.to_f32(vec.i32(x - begin) + vec.iota())
            nx, ny, nz = bounded_normals(columns, maps, values, room, r, np.int64(records[r]) - first, offset)
            inside = vec.iota() < vec.i32(end - x)
            vec.store_where(line, x, inside, shine(nz, nx * nx + ny * ny + nz * nz, colors))
    return flat, stray
