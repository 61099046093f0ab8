"""Runs side by side: what they remember of their triangles' planes as rows, one value of each run, from which any eight
neighbouring pixels, which see at most eight runs, take theirs by one permutation for each value.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, i32_at, u32_at
from renderers.shading.attribute_planes import PL_PIXEL, PLANE_VALUES, ROW_VALUES
from renderers.shading.layout import II_ELEMENTS, II_VERTICES, P_NORMAL, V_COLUMNS
from renderers.shading.material import turned

# Rows of values of 4 bytes, one for each run of a row of the picture: float32 of its first pixel, see ``planes``, and
# what each pixel adds,
B_NORMAL: Final = 0  # 3 rows
B_WEIGHTS: Final = 3  # 3 rows
B_NORMAL_STEP: Final = 6  # 3 rows
B_WEIGHTS_STEP: Final = 9  # 3 rows
B_FACING: Final = 12
B_BEGIN: Final = 13  # the column where it begins
# and int32:
B_PIXEL: Final = 14  # PL_PIXEL
B_STRAYS: Final = 15  # numbers of those that stray, and behind them of none
B_FLAT: Final = 16  # numbers of long ones that have the same normal everywhere, and behind them of none
B_ROWS: Final = 17
NONE: Final = 2**31 - 1
SHORTEST: Final = 16
"""Minimum length, in pixels, of the runs in B_FLAT."""


@inlined
def _listed(whole, at, run, found):
    """Write the numbers of the runs whose bits are set, counted from ``run``, from ``at`` on; where the next goes. Up
    to eight values from there on are overwritten."""
    if vec.compresses():
        vec.store(whole, at, vec.compressed(vec.lanes_in(found), vec.i32(run) + vec.iota()))
        return at + vec.count_bits(found)
    while found != 0:
        whole[at] = run + vec.lowest_bit(found)
        at += 1
        found &= found - 1
    return at


@inner
def put_beside(y, places, planes, starts, runs, beside, room):
    """Fill the rows for the runs of a row of the picture.

    A run strays that has a pixel beside its triangle: as coverage is exact in 1/256 pixel, some do by a little.

    Args:
        y: of the picture.
        places: pointer to int32, the place of each run's triangle among the ``planes``, a pointer to float32; anything
            within these for runs that are not shaded so.
        starts: pointer to int32, the first pixel of each run, and what is behind the last. Both readable a vector
            further.
        beside: address of B_ROWS rows of ``room`` values; room: two vectors more than runs, at least.

    Returns:
        Whether any run is flat, of whatever length.
    """
    values, whole = f32_at(beside), i32_at(beside)
    strays, flat, uniform = B_STRAYS * room, B_FLAT * room, np.int64(0)
    line = vec.f32(np.float32(y))
    for run in range(0, runs, vec.LANES):
        at = vec.load(places, run) * vec.i32(PLANE_VALUES)
        begins = vec.load(starts, run)
        pixels = vec.load(starts, run + 1) - begins
        here = vec.load_octets(planes, at)
        down = vec.load_octets(planes, at + vec.i32(ROW_VALUES))
        right = vec.load_octets(planes, at + vec.i32(2 * ROW_VALUES))
        column = vec.to_f32(begins)
        aside, below = column - down[6], line - right[6]
        b0, b1 = here[0] + (below * down[0] + aside * right[0]), here[1] + (below * down[1] + aside * right[1])
        b2, b3 = here[2] + (below * down[2] + aside * right[2]), here[3] + (below * down[3] + aside * right[3])
        b4, b5 = here[4] + (below * down[4] + aside * right[4]), here[5] + (below * down[5] + aside * right[5])
        vec.store(values, B_NORMAL * room + run, b0)
        vec.store(values, (B_NORMAL + 1) * room + run, b1)
        vec.store(values, (B_NORMAL + 2) * room + run, b2)
        vec.store(values, B_WEIGHTS * room + run, b3)
        vec.store(values, (B_WEIGHTS + 1) * room + run, b4)
        vec.store(values, (B_WEIGHTS + 2) * room + run, b5)
        vec.store(values, B_NORMAL_STEP * room + run, right[0])
        vec.store(values, (B_NORMAL_STEP + 1) * room + run, right[1])
        vec.store(values, (B_NORMAL_STEP + 2) * room + run, right[2])
        vec.store(values, B_WEIGHTS_STEP * room + run, right[3])
        vec.store(values, (B_WEIGHTS_STEP + 1) * room + run, right[4])
        vec.store(values, (B_WEIGHTS_STEP + 2) * room + run, right[5])
        vec.store(values, B_FACING * room + run, here[6])
        vec.store(values, B_BEGIN * room + run, column)
        own = vec.bits_of(here[PL_PIXEL])
        vec.store(whole, B_PIXEL * room + run, own)
        steps, none = vec.to_f32(pixels - vec.i32(1)), vec.f32(0.0)
        beyond = (vec.least(b3, b3 + right[3] * steps) < none) | (vec.least(b4, b4 + right[4] * steps) < none)
        beyond = beyond | (vec.least(b5, b5 + right[5] * steps) < none)
        even, mask = vec.bits(own >= vec.i32(0)), (1 << min(runs - run, vec.LANES)) - 1
        uniform |= even & mask
        strays = _listed(whole, strays, run, vec.bits(beyond) & mask & ~even)
        flat = _listed(whole, flat, run, even & mask & vec.bits(pixels >= vec.i32(SHORTEST)))
    whole[strays], whole[flat] = NONE, NONE
    return uniform != 0


@inlined
def passed(whole, row, count, run):
    """How many of the numbers in B_STRAYS or B_FLAT lie before a run, if ``count`` do."""
    while whole[row + count] < run:
        count += 1
    return count


@inlined
def changes_after(masks, x):
    """Which of the eight pixels behind pixel ``x`` begin a run: their bits, see ``runs.find_runs``."""
    word, bit = (x + 1) >> 6, (x + 1) & 63
    low = np.uint64(masks[word]) >> np.uint64(bit)
    return np.int64((low | ((np.uint64(masks[word + 1]) << np.uint64(63 - bit)) << np.uint64(1))) & np.uint64(255))


@inlined
def lanes_of(changed):
    """How many runs behind that of the first of eight pixels each sees, i32x8; ``changed``: see ``changes_after``."""
    before = (vec.i32(1) << vec.iota()) - vec.i32(1)
    return vec.count_bits(vec.i32(changed) & before)


@inlined
def picked(values, at, lanes):
    """Of the rows' values from ``at`` on, counted from the run of the first of eight pixels, each one's."""
    return vec.permute(vec.load(values, at), lanes)


@inlined
def normals_beside(values, room, run, lanes, x):
    """Normals of eight pixels from ``x`` on, as ``planes`` has them: f32x8 each.

    Args:
        values, room: see ``put_beside``.
        run: of the first pixel. lanes: see ``lanes_of``.
    """
    t = vec.f32(x) + vec.to_f32(vec.iota()) - picked(values, B_BEGIN * room + run, lanes)
    at, step = B_NORMAL * room + run, B_NORMAL_STEP * room + run
    nx = picked(values, at, lanes) + picked(values, step, lanes) * t
    ny = picked(values, at + room, lanes) + picked(values, step + room, lanes) * t
    nz = picked(values, at + 2 * room, lanes) + picked(values, step + 2 * room, lanes) * t
    return nx, ny, nz


@inlined
def _weight(values, room, row, run, offset):
    at = (B_WEIGHTS + row) * room + run
    step = (B_WEIGHTS_STEP + row) * room + run
    return vec.most(vec.f32(values[at]) + vec.f32(values[step]) * offset, vec.f32(0.0))


@inner
def bounded_normals(columns, maps, values, room, run, element, offset):
    """Normals of eight pixels ``offset`` (f32x8) behind the first of a run that strays, as ``planes`` has them:
    negative coordinates become 0, so that nothing is extrapolated."""
    elements, vertices = u32_at(columns[II_ELEMENTS]), f32_at(columns[II_VERTICES])
    a = vec.load(vertices, np.int64(elements[3 * element]) * V_COLUMNS)
    b = vec.load(vertices, np.int64(elements[3 * element + 1]) * V_COLUMNS)
    c = vec.load(vertices, np.int64(elements[3 * element + 2]) * V_COLUMNS)
    w0 = _weight(values, room, 0, run, offset)
    w1 = _weight(values, room, 1, run, offset)
    w2 = _weight(values, room, 2, run, offset)
    nx = w0 * vec.spread3(a) + w1 * vec.spread3(b) + w2 * vec.spread3(c)
    ny = w0 * vec.spread4(a) + w1 * vec.spread4(b) + w2 * vec.spread4(c)
    nz = w0 * vec.spread5(a) + w1 * vec.spread5(b) + w2 * vec.spread5(c)
    nx, ny, nz = turned(maps, P_NORMAL, nx, ny, nz)
    facing = vec.f32(values[B_FACING * room + run])
    return nx * facing, ny * facing, -(nz * facing)
