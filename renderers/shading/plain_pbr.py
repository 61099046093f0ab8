"""Segments under the look ``pbr`` whose materials are nothing but factors. What most of a picture is: smooth triangles,
whose levels are parabolas along a run. Elsewhere normals are linear along a run, as in ``plain``; long runs of flat
surfaces need neither them nor light of their own.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.linked import inlined, inner
from renderers.pointers import f32_at, i32_at
from renderers.shading.beside import (
    B_BEGIN,
    B_FLAT,
    B_LEVEL,
    B_LEVEL_BEND,
    B_LEVEL_STEP,
    B_NORMAL,
    B_STRAYS,
    alike,
    bounded_normals,
    changes_after,
    lanes_of,
    normals_beside,
    passed,
)
from renderers.shading.flat import changes_slowly, show_flat
from renderers.shading.head import WHOLE
from renderers.shading.layout import A_NORMAL
from renderers.shading.lights import cosines
from renderers.shading.surface import coating_of, finish_coated, finish_uniform, put_cosines

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


@inlined
def _rays_of(lens, y):
    """Of a row's rays: what is added to a column, what that is multiplied by, dy, and dy^2 + 1; f32x8 each."""
    dy = vec.f32((y + 0.5 - lens[3]) / lens[1])
    return vec.f32(0.5 - lens[2]), vec.f32(1.0 / lens[0]), dy, dy * dy + vec.f32(1.0)


@inlined
def _put_cosines(rays, starts, run, stop, masks, beside, room, rows, stride):
    """What light depends on in the runs ``run .. stop`` into the rows."""
    values = f32_at(beside)
    lane = vec.to_f32(vec.iota())
    left, across, dy, high = rays
    for x in range(np.int64(starts[run]), np.int64(starts[stop]), vec.LANES):
        changed = changes_after(masks, x)
        nx, ny, towards = normals_beside(values, room, run, lanes_of(changed), x)
        n_l, n_v, v_l = cosines(nx, ny, towards, (vec.f32(x) + lane + left) * across, dy, high)
        at = A_NORMAL * stride + x
        vec.store(rows, at, n_l)
        vec.store(rows, at + stride, n_v)
        vec.store(rows, at + 2 * stride, v_l)
        run += vec.count_bits(changed)


@inner
def _put_stray(columns, maps, lens, y, element, begin, end, beside, room, run, rows, stride):
    """As ``_put_cosines`` for a run that strays, and nothing behind it."""
    lane = vec.to_f32(vec.iota())
    left, across, dy, high = _rays_of(lens, y)
    for x in range(begin, end, vec.LANES):
        offset = vec.f32(x - begin) + lane
        nx, ny, towards = bounded_normals(columns, maps, f32_at(beside), room, run, element, offset)
        dx = (vec.f32(x) + lane + left) * across
        n_l, n_v, v_l = cosines(nx, ny, towards, dx, dy, high)
        at, inside = A_NORMAL * stride + x, vec.iota() < vec.i32(end - x)
        vec.store_where(rows, at, inside, n_l)
        vec.store_where(rows, at + stride, inside, n_v)
        vec.store_where(rows, at + 2 * stride, inside, v_l)


@inlined
def _level(values, room, k, run, lanes, t):
    """A channel of eight pixels, from the runs' parabolas: as ``head.shine`` has it, in the lowest bits."""
    level = vec.permute(vec.load(values, (B_LEVEL + k) * room + run), lanes)
    step = vec.permute(vec.load(values, (B_LEVEL_STEP + k) * room + run), lanes)
    bend = vec.permute(vec.load(values, (B_LEVEL_BEND + k) * room + run), lanes)
    return vec.bits_of(level + t * (step + t * bend) + vec.f32(WHOLE))


@inner
def show_levels(starts, run, stop, masks, beside, room, line):
    """Pixels of the runs ``run .. stop``, of whatever instances, that are smooth; the others are anything. Up to seven
    behind the last are overwritten."""
    values = f32_at(beside)
    lane = vec.to_f32(vec.iota())
    for x in range(np.int64(starts[run]), np.int64(starts[stop]), vec.LANES):
        changed = changes_after(masks, x)
        lanes = lanes_of(changed)
        t = vec.f32(x) + lane - vec.permute(vec.load(values, B_BEGIN * room + run), lanes)
        red, green = _level(values, room, 0, run, lanes, t), _level(values, room, 1, run, lanes, t)
        blue = _level(values, room, 2, run, lanes, t)
        vec.store(line, x, red | (green << vec.i32(8)) | (blue << vec.i32(16)))
        run += vec.count_bits(changed)


@inner
def show_segment(
    job, columns, maps, lens, y, first, mf, records, starts, run, last_run, reach, masks, beside, room, flat, stray,
    shown, rows, stride, line, steep,
):  # fmt: skip
    """Pixels of the runs ``run .. last_run`` of one instance's triangles, whose mesh has normals.

    Args:
        columns .. room: as for ``plain.show_plain``; reach: the end of the runs that are shaded so, of whatever
            instances.
        flat, stray: how many at least of each kind lie before ``run``. shown: the first run that is not shown
            yet; smooth ones wait for what follows.
        rows: rows of ``stride`` values, 16 more than the row has pixels.
        line: pointer to the row's packed pixels; up to seven behind the last run are overwritten.
        steep: see ``surface.row_schlick``.

    Returns:
        ``flat``, ``stray`` and ``shown`` of the next segment.
    """
    whole, values = i32_at(beside), f32_at(beside)
    run = alike(beside, room, run, False, last_run)
    if run < last_run:
        slowly, rays, coating = changes_slowly(mf, lens), _rays_of(lens, y), coating_of(mf)
        while run < last_run:
            flat, stray = passed(whole, B_FLAT * room, flat, run), passed(whole, B_STRAYS * room, stray, run)
            if shown < run:
                show_levels(starts, shown, run, masks, beside, room, line)
            begin = np.int64(starts[run])
            if slowly and whole[B_FLAT * room + flat] == run:
                flat += 1
                at = B_NORMAL * room + run
                normal = values[at], values[at + room], values[at + 2 * room]
                shown = run + 1
                if show_flat(job, mf, lens, y, normal, rows, stride, begin, np.int64(starts[shown]), line, steep):
                    run = alike(beside, room, shown, False, last_run) if shown < last_run else shown
                    continue
            limit = min(last_run, np.int64(whole[B_FLAT * room + flat])) if slowly else last_run
            shown = alike(beside, room, run, True, limit)
            _put_cosines(rays, starts, run, shown, masks, beside, room, rows, stride)
            while whole[B_STRAYS * room + stray] < shown:
                number = np.int64(whole[B_STRAYS * room + stray])
                stray += 1
                left, right, element = np.int64(starts[number]), np.int64(starts[number + 1]), records[number] - first
                _put_stray(columns, maps, lens, y, element, left, right, beside, room, number, rows, stride)
            end = np.int64(starts[shown])
            for part in range(begin, end, PART):
                finish_coated(
                    job, coating, y, np.int64(0), rows, stride, part, min(part + PART, end), line, steep
                )  # fmt: skip
            run = alike(beside, room, shown, False, last_run) if shown < last_run else shown
    if last_run == reach and shown < reach:
        show_levels(starts, shown, reach, masks, beside, room, line)
        shown = reach
    return flat, stray, shown
