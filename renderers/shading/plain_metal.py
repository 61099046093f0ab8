"""Runs under the look ``pbr`` that show one number times a colour, see ``materials.shown_metal``: of all neighbouring
segments at once, whatever instances they belong to, since each run has its colour beside its normals.

Of the head light's reflection only the ratio of two cosines counts, n . l to n . l + n . v. Times the normal's length
and the ray's, n . v is ``towards - (nx dx + ny dy)``: of second degree along a run, since normals are linear; n . l is
``towards`` times the ray's length. Neither needs a unit normal. Where both nearly vanish, VTK's lower bound of cosines
counts; ``put_beside`` takes such runs for ones that stray.
"""

from __future__ import annotations

import numpy as np

from renderers import simd as vec
from renderers.linked import inlined, inner
from renderers.pointers import f32_at, i32_at, i64_at
from renderers.shading.beside import (
    B_BEGIN,
    B_NORMAL,
    B_NORMAL_STEP,
    B_SEEN,
    B_SHOWN,
    B_STRAYS,
    bounded_normals,
    changes_after,
    lanes_of,
    passed,
    picked,
    rays_of,
)
from renderers.shading.head import WHOLE
from renderers.shading.layout import P_COLUMNS, S_ENCODED, S_FIRST, S_MAPS
from renderers.shading.lights import SMALLEST_COSINE
from renderers.shading.materials import MF_SHOWN
from renderers.shading.runs import G_COLUMNS, G_INSTANCE, G_LAST_RUN, G_RUN, instance_at
from renderers.shading.transfer import DARK, ROOTS, root_within


@inner
def _put_shown(job, starts, segments, begin, end, beside, room):
    """The colours of the segments ``begin .. end`` beside their runs."""
    values = f32_at(beside)
    for number in range(begin, end):
        segment = number * G_COLUMNS
        _, _, mf = instance_at(job, np.int64(segments[segment + G_INSTANCE]))
        red, green, blue = vec.f32(mf[MF_SHOWN]), vec.f32(mf[MF_SHOWN + 1]), vec.f32(mf[MF_SHOWN + 2])
        for run in range(np.int64(segments[segment + G_RUN]), np.int64(segments[segment + G_LAST_RUN]), vec.LANES):
            at = B_SHOWN * room + run
            vec.store(values, at, red)
            vec.store(values, at + room, green)
            vec.store(values, at + 2 * room, blue)


@inlined
def _cosines(towards, seen, dx, high):
    """The ratio's dividend and divisor, eight pixels at a time. A dividend of 0 where no light arrives, or where the
    normal has no direction."""
    none = vec.f32(0.0)
    along = vec.select(towards > none, towards * vec.sqrt(dx * dx + high), none)
    return along, along + vec.most(seen, none)


@inlined
def _edge_on(nx, ny, towards, dx, dy, high):
    """``_cosines`` with VTK's lower bound of both."""
    ray = dx * dx + high
    least = vec.f32(SMALLEST_COSINE) * vec.sqrt(ray * (nx * nx + ny * ny + towards * towards))
    along = vec.most(towards * vec.sqrt(ray), least)
    both = along + vec.most(towards - (nx * dx + ny * dy), least)
    return vec.select(towards > vec.f32(0.0), along, vec.f32(0.0)), both


@inlined
def _shown(ratio, red, green, blue, low, high):
    """Eight pixels, packed: red in the lowest byte, then green, blue.

    Args:
        ratio: 0 .. 1 or not a number. low, high: see ``transfer.root``.
    """
    share, whole = root_within(vec.most(ratio, vec.f32(DARK)), low, high), vec.f32(WHOLE)
    r, g, b = share * red + whole, share * green + whole, share * blue + whole
    return vec.bits_of(r) | (vec.bits_of(g) << vec.i32(8)) | (vec.bits_of(b) << vec.i32(16))


@inner
def _show_stray(job, lens, y, instance, record, begin, end, beside, room, run, line):
    """A run that strays, and nothing behind it."""
    columns, _, mf = instance_at(job, instance)
    maps, element = f32_at(job[S_MAPS] + 4 * P_COLUMNS * instance), record - i64_at(job[S_FIRST])[instance]
    lane, table = vec.to_f32(vec.iota()), f32_at(job[S_ENCODED])
    left, across, dy, high = rays_of(lens, y)
    red, green, blue = vec.f32(mf[MF_SHOWN]), vec.f32(mf[MF_SHOWN + 1]), vec.f32(mf[MF_SHOWN + 2])
    for x in range(begin, end, vec.LANES):
        offset = vec.f32(x - begin) + lane
        nx, ny, towards = bounded_normals(columns, maps, f32_at(beside), room, run, element, offset)
        dx = (vec.f32(x) + lane + left) * across
        along, both = _edge_on(nx, ny, towards, dx, dy, high)
        pixels = _shown(along / both, red, green, blue, vec.load(table, ROOTS), vec.load(table, ROOTS + vec.LANES))
        vec.store_where(line, x, vec.iota() < vec.i32(end - x), pixels)


@inlined
def _seen_beside(values, room, run, lanes, column, left, across, high):
    """``_cosines`` of eight neighbouring pixels; ``column``: f32x8."""
    t = column - picked(values, B_BEGIN * room + run, lanes)
    towards = picked(values, (B_NORMAL + 2) * room + run, lanes)
    towards = towards + picked(values, (B_NORMAL_STEP + 2) * room + run, lanes) * t
    at = B_SEEN * room + run
    bend = picked(values, at + room, lanes) + picked(values, at + 2 * room, lanes) * t
    return _cosines(towards, picked(values, at, lanes) + bend * t, (column + left) * across, high)


@inner
def show_metals(job, lens, y, records, starts, segments, begin, end, masks, beside, room, stray, line):
    """Pixels of the neighbouring segments ``begin .. end``, all BY_RATIO.

    Args:
        records, starts, masks: see ``runs.find_runs``. segments: see ``runs.find_segments``.
        beside, room: see ``beside.put_beside``, which has been called. stray: how many in B_STRAYS lie before.
        line: pointer to the row's packed pixels; up to seven behind the last are overwritten.

    Returns:
        ``stray`` of what follows.
    """
    run = np.int64(segments[begin * G_COLUMNS + G_RUN])
    stop = np.int64(segments[(end - 1) * G_COLUMNS + G_LAST_RUN])
    stray = passed(i32_at(beside), B_STRAYS * room, stray, run)
    _put_shown(job, starts, segments, begin, end, beside, room)
    values, whole, table = f32_at(beside), i32_at(beside), f32_at(job[S_ENCODED])
    low_roots, high_roots = vec.load(table, ROOTS), vec.load(table, ROOTS + vec.LANES)
    left, across, _, high = rays_of(lens, y)
    x, last_x = np.int64(starts[run]), np.int64(starts[stop])
    changed = changes_after(masks, x)
    lanes = lanes_of(changed)
    column = vec.f32(x) + vec.to_f32(vec.iota())
    along, both = _seen_beside(values, room, run, lanes, column, left, across, high)
    # Eight pixels begin while the eight before them are finished: neither waits for the other.
    while x < last_x:
        at = B_SHOWN * room + run
        red, green = picked(values, at, lanes), picked(values, at + room, lanes)
        blue = picked(values, at + 2 * room, lanes)
        vec.store(line, x, _shown(along / both, red, green, blue, low_roots, high_roots))
        run += vec.count_bits(changed)
        x += vec.LANES
        changed = changes_after(masks, x)
        lanes = lanes_of(changed)
        column = column + vec.f32(float(vec.LANES))
        along, both = _seen_beside(values, room, run, lanes, column, left, across, high)
    segment = begin * G_COLUMNS
    while whole[B_STRAYS * room + stray] < stop:
        number = np.int64(whole[B_STRAYS * room + stray])
        stray += 1
        while segments[segment + G_LAST_RUN] <= number:
            segment += G_COLUMNS
        instance, record = np.int64(segments[segment + G_INSTANCE]), np.int64(records[number])
        first, last = np.int64(starts[number]), np.int64(starts[number + 1])
        _show_stray(job, lens, y, instance, record, first, last, beside, room, number, line)
    return stray
