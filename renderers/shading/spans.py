"""What the rows of a band see, found before any is shaded: runs of one record, segments of one instance, and the
triangles whose planes will be needed. These are set up eight at a time, whatever rows see them first.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, f64_at, i32_at, i64_at, u32_at
from renderers.primitive_ids import instance_of
from renderers.shading.attribute_planes import (
    E_COLUMNS,
    E_COUNT,
    E_INSTANCE,
    E_LEFT,
    E_PLACES,
    E_RECORDS,
    E_TOP,
    PLANE_VALUES,
    set_up,
)
from renderers.shading.headlight import colors_of, fits
from renderers.shading.layout import (
    HAS_COLORS,
    HAS_NORMALS,
    II_COLUMNS,
    II_ELEMENTS,
    II_HAS,
    II_MATERIAL,
    II_TOPOLOGY,
    P_COLUMNS,
    S_COUNT,
    S_FIRST,
    S_INSTANCES,
    S_LENS,
    S_MAPS,
    S_MATERIAL_FLOATS,
    S_MATERIAL_INTEGERS,
    S_MODE,
    S_PBR,
    S_POINTS,
)
from renderers.shading.materials import MF_COLUMNS, MI_BASE, MI_COLUMNS, MI_NORMAL, MI_UNLIT, MI_UV
from renderers.shading.output_merge import DIRECT

SLOTS: Final = 4096
"""Triangles that are found again, by the low bits of their records. One that is not is set up twice."""
EIGHTS: Final = 128
"""Instances whose triangles wait at a time, by the low bits of their numbers."""
MOST: Final = 4096
"""Places that may be taken before another row is looked at, which takes at most half as many as it has pixels."""
# The memory, values of 4 bytes.
K_RECORDS: Final = 0  # SLOTS: whose triangle's; -1: nobody's
K_PLACES: Final = SLOTS  # SLOTS: where its planes lie
K_EIGHTS: Final = 2 * SLOTS  # EIGHTS of E_COLUMNS: what waits to be set up
K_TAKEN: Final = K_EIGHTS + EIGHTS * E_COLUMNS  # places
K_PLANES: Final = K_TAKEN + vec.LANES  # float32: PLANE_VALUES for each of MOST places and one for every pixel of a row

_LAST: Final = -(2**63)
"""The highest of 64 bits."""
TINY_RUNS: Final = 2
"""Pixels of a run, on average over a segment, up to which every pixel is solved by itself."""

# A segment: int32 values.
G_INSTANCE: Final = 0  # -1: nothing is seen
G_RUN: Final = 1  # its runs
G_LAST_RUN: Final = 2
G_PLANES: Final = 3  # 1 where it is shaded from the planes of its triangles, else 0
G_COLUMNS: Final = 4


@inner
def forget_places(memory):
    """Empty the memory; at its address are values for so many places."""
    whole = i32_at(memory)
    for slot in range(0, SLOTS, vec.LANES):
        vec.store(whole, K_RECORDS + slot, vec.i32(-1))
        vec.store(whole, K_PLACES + slot, vec.i32(0))
    for k in range(EIGHTS):
        whole[K_EIGHTS + k * E_COLUMNS + E_INSTANCE] = -1
        whole[K_EIGHTS + k * E_COLUMNS + E_COUNT] = 0
    whole[K_TAKEN] = 0


@inlined
def memory_values(width):
    """Size of the memory for rows of so many pixels."""
    return K_PLANES + PLANE_VALUES * (MOST + width)


@inner
def find_runs(seen, ids, width, apart, masks, starts, records):
    """Find the runs of equal records of a row.

    Args:
        seen: pointer to the row's int32. ids: pointer to room for width + 64, of which -1 is nowhere in the row; parts
            are overwritten.
        apart: whether every pixel is a run of its own.
        masks: pointer to width / 64 + 3 int64: a bit for each pixel that begins a run, the lowest first; anything
            behind the row.
        starts, records: pointers to as many int32 as there are runs, and a vector more: the first pixel of each, and
            ``width`` behind the last; its record, and anything behind.

    Returns:
        The number of runs.
    """
    run = np.int64(0)
    for x in range(0, width, 64):
        mask = np.int64(-1)
        if not apart:
            of = seen
            if x == 0 or x + 64 > width:  # nothing before the row is read, and nothing behind it
                of = ids
                for k in range(max(x - 1, 0), min(x + 64, width)):
                    ids[k] = seen[k]
            mask = np.int64(0)
            for k in range(0, 64, vec.LANES):  # one mask of 64 bits: its end is mispredicted once, not eight times
                mask |= vec.bits(vec.load(of, x + k) != vec.load(of, x + k - 1)) << k
        masks[x >> 6] = mask
        if width - x < 64:
            mask &= (np.int64(1) << (width - x)) - 1
        if vec.compresses() and not apart:
            of = ids if x == 0 or x + 64 > width else seen
            for k in range(0, 64, vec.LANES):
                begins = vec.lanes_in(mask >> k)
                vec.store(starts, run, vec.compressed(begins, vec.i32(x + k) + vec.iota()))
                vec.store(records, run, vec.compressed(begins, vec.load(of, x + k)))
                run += vec.count_bits((mask >> k) & 255)
            continue
        bits = vec.count_bits(mask)
        # Eight at a time, some in vain: how many there are cannot be predicted.
        for group in range(run, run + bits, vec.LANES):
            for k in range(vec.LANES):
                starts[group + k] = x + vec.lowest_bit(mask | _LAST)
                mask &= mask - 1
            vec.store(records, group, vec.gather(seen, vec.least(vec.load(starts, group), vec.i32(width - 1))))
        run += bits
    vec.store(starts, run, vec.i32(width))
    return run


@inner
def extent(records, run, stop, first, last):
    """The first run from ``run`` on that sees no record of ``first .. last``."""
    low, high = vec.i32(first), vec.i32(last)
    while run < stop:
        eight = vec.load(records, run)
        others = 255 ^ vec.bits((eight >= low) & (eight < high))
        if others != 0:
            return min(run + vec.lowest_bit(others), stop)
        run += vec.LANES
    return np.int64(stop)


@inlined
def instance_at(job, instance):
    """Pointers to an instance's row of the instance table, and to its material's integers and floats."""
    columns = i64_at(job[S_INSTANCES] + 8 * II_COLUMNS * instance)
    material = columns[II_MATERIAL]
    mi = i64_at(job[S_MATERIAL_INTEGERS] + 8 * MI_COLUMNS * material)
    return columns, mi, f32_at(job[S_MATERIAL_FLOATS] + 4 * MF_COLUMNS * material)


@inner
def _by_planes(job, instance):
    """Return whether ``plain`` or ``plain_pbr`` shades an instance's segments where its triangles are not tiny."""
    columns, mi, mf = instance_at(job, instance)
    if columns[II_TOPOLOGY] != 3 or job[S_MODE] != DIRECT or mi[MI_UNLIT] != 0 or columns[II_HAS] & HAS_COLORS:
        return False
    if job[S_PBR] == 0:
        return mi[MI_BASE] < 0 and fits(mf)
    return mi[MI_NORMAL] < 0 and mi[MI_UV] & 3 == 0 and columns[II_HAS] & HAS_NORMALS != 0


@inner
def find_segments(job, apart, starts, records, runs, segments, at, hint):
    """Find the segments of a row's runs.

    Args:
        apart: as for ``find_runs``; such rows need no planes.
        segments: pointer to int32, G_COLUMNS for each; at: the number of the first.

    Returns:
        The number of the one behind the last, whether any needs planes, and the instance seen last, a hint for the next
        row.
    """
    first_record = i64_at(job[S_FIRST])
    run, planes = np.int64(0), False
    while run < runs:
        record = np.int64(records[run])
        segment = at * G_COLUMNS
        segments[segment + G_INSTANCE], segments[segment + G_RUN], segments[segment + G_PLANES] = -1, run, 0
        if record < 0:
            run = extent(records, run, runs, np.int64(-1), np.int64(0))
        else:
            hint = instance_of(first_record, job[S_COUNT], record, hint)
            stop = extent(records, run, runs, first_record[hint], first_record[hint + 1])
            segments[segment + G_INSTANCE] = hint
            tiny = apart or starts[stop] - starts[run] <= TINY_RUNS * (stop - run)
            if not tiny and _by_planes(job, hint):
                segments[segment + G_PLANES], planes = 1, True
            run = stop
        segments[segment + G_LAST_RUN] = run
        at += 1
    return at, planes, hint


@inner
def find_places(job, y, starts, records, places, runs, segments, at, memory):
    """Find the places of the triangles of a row's runs; those that nobody has seen wait for their set-up.

    Args:
        y: of the picture.
        places: pointer to int32, filled for all runs, and a vector more: where the planes of their triangles will be;
            anything within the memory for those that need none.
        segments, at: as for ``find_segments``, which has been called.
    """
    whole = i32_at(memory)
    segment = at * G_COLUMNS
    for batch in range(0, runs, vec.LANES):
        eight = vec.load(records, batch)
        slots = eight & vec.i32(SLOTS - 1)
        vec.store(places, batch, vec.gather(whole, slots + vec.i32(K_PLACES)))
        missing = vec.bits(eight != vec.gather(whole, slots + vec.i32(K_RECORDS)))
        missing &= (1 << min(runs - batch, vec.LANES)) - 1
        while missing != 0:
            k = batch + vec.lowest_bit(missing)
            while segments[segment + G_LAST_RUN] <= k:
                segment += G_COLUMNS
            if segments[segment + G_PLANES] == 0:
                missing &= np.int64(-1) << min(segments[segment + G_LAST_RUN] - batch, vec.LANES)
                continue
            missing &= missing - 1
            slot = np.int64(records[k]) & (SLOTS - 1)
            if whole[K_RECORDS + slot] != records[k]:  # else it is another run of one of the eight
                _wait(
                    job, np.int64(segments[segment + G_INSTANCE]), np.int64(records[k]), np.int64(starts[k]), y, memory
                )
            places[k] = whole[K_PLACES + slot]


@inlined
def _wait(job, instance, record, x, y, memory):
    """Give a triangle a place, and let it wait for its set-up."""
    whole = i32_at(memory)
    eight = i32_at(memory + 4 * (K_EIGHTS + (instance & (EIGHTS - 1)) * E_COLUMNS))
    elements = u32_at(i64_at(job[S_INSTANCES] + 8 * II_COLUMNS * instance)[II_ELEMENTS])
    vec.prefetch(elements, 3 * (record - i64_at(job[S_FIRST])[instance]))
    if eight[E_INSTANCE] != instance:
        _set_up_eight(job, memory, eight)
        eight[E_INSTANCE] = instance
    place, count, slot = np.int64(whole[K_TAKEN]), np.int64(eight[E_COUNT]), record & (SLOTS - 1)
    whole[K_TAKEN] = place + 1
    whole[K_RECORDS + slot], whole[K_PLACES + slot] = record, place
    eight[E_RECORDS + count], eight[E_PLACES + count] = record, place
    eight[E_LEFT + count], eight[E_TOP + count] = x, y
    eight[E_COUNT] = count + 1
    if count + 1 == vec.LANES:
        _set_up_eight(job, memory, eight)


@inner
def _set_up_eight(job, memory, eight):
    """Set up what waits, if anything does."""
    count = np.int64(eight[E_COUNT])
    if count == 0:
        return
    eight[E_COUNT] = 0
    last = vec.least(vec.iota(), vec.i32(count - 1))  # the last one is repeated
    for row in range(E_RECORDS, E_INSTANCE, vec.LANES):
        vec.store(eight, row, vec.permute(vec.load(eight, row), last))
    instance = np.int64(eight[E_INSTANCE])
    columns, _, mf = instance_at(job, instance)
    points, maps = f64_at(job[S_POINTS] + 8 * 16 * instance), f32_at(job[S_MAPS] + 4 * P_COLUMNS * instance)
    smooth = columns[II_HAS] & HAS_NORMALS != 0
    first = i64_at(job[S_FIRST])[instance]
    planes = f32_at(memory + 4 * K_PLANES)
    set_up(columns, points, maps, f64_at(job[S_LENS]), first, smooth, colors_of(mf), eight, planes)


@inner
def set_up_waiting(job, memory):
    """Set up all that waits."""
    for k in range(EIGHTS):
        _set_up_eight(job, memory, i32_at(memory + 4 * (K_EIGHTS + k * E_COLUMNS)))
