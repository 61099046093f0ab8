"""Remembered planes of triangles with a picture on them: the normal, and which texels a pixel sees.

As in ``planes``, but the values behind the barycentric coordinates are where among the texels a pixel lies, over depth.
One over depth is the coordinates' sum: 1 at the pixel that the triangle was set up at.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.linked import inlined, inner
from renderers.pointers import f32_at, f64_at, i32_at, u32_at
from renderers.shading.ahead import look_ahead
from renderers.shading.layout import A_RUN, II_ELEMENTS, II_VERTICES, P_MIRROR, V_COLUMNS
from renderers.shading.planes import (
    M_COLUMNS,
    M_MISSING,
    M_PIXELS,
    M_PLANES,
    M_RECORDS,
    PL_WEIGHTS,
    PLANE_VALUES,
    ROW_VALUES,
    SLOTS,
    inverse,
    seen_normals,
    spread_out,
)
from renderers.shading.resolve import R_BASE, R_FACING, R_FLAT, R_INDEX, R_SLOPE
from renderers.shading.textures import (
    TI_HEIGHT,
    TI_TRANSFORMED,
    TI_WIDTH,
    TI_WRAP_S,
    TI_WRAP_T,
    WRAP_CLAMP,
    WRAP_REPEAT,
)
from renderers.shading.triples import cross, dot, minus, optical

FARTHEST: Final = 8192
"""Texels from the image's corner up to which float32 has fractions enough."""
NEAREST: Final = 0.5
"""Least of 1 / depth, over that of the pixel of the set-up: towards a horizon it vanishes, and what float32 knows of
it."""


@inlined
def _texels(coordinate, wrap, size):
    """Where among the centres of ``size`` texels the coordinates of three corners lie (f64x8), in the image that the
    least of them is in, where it is repeated."""
    a, b, c = vec.to_f64(coordinate[0]), vec.to_f64(coordinate[1]), vec.to_f64(coordinate[2])
    if wrap != WRAP_CLAMP:
        period = vec.f64(1.0 if wrap == WRAP_REPEAT else 2.0)
        first = period * vec.floor(vec.least(vec.least(a, b), c) / period)
        a, b, c = a - first, b - first, c - first
    half, count = vec.f64(0.5), vec.f64(size)
    return a * count - half, b * count - half, c * count - half


@inlined
def _corners(integers, floats, u, v):
    """Columns and rows of three corners among the texels, f64x8, from their coordinates, f32x8."""
    if integers[TI_TRANSFORMED] != 0:
        m0, m1, m2, m3 = vec.f32(floats[0]), vec.f32(floats[1]), vec.f32(floats[2]), vec.f32(floats[3])
        m4, m5 = vec.f32(floats[4]), vec.f32(floats[5])
        u, v = (
            (m0 * u[0] + m1 * v[0] + m2, m0 * u[1] + m1 * v[1] + m2, m0 * u[2] + m1 * v[2] + m2),
            (m3 * u[0] + m4 * v[0] + m5, m3 * u[1] + m4 * v[1] + m5, m3 * u[2] + m4 * v[2] + m5),
        )
    return (
        _texels(u, integers[TI_WRAP_S], integers[TI_WIDTH]),
        _texels(v, integers[TI_WRAP_T], integers[TI_HEIGHT]),
    )


@inlined
def _near(x):
    limit = vec.f64(FARTHEST)
    return (vec.absolute(x[0]) <= limit) & (vec.absolute(x[1]) <= limit) & (vec.absolute(x[2]) <= limit)


@inlined
def _fits(x, y):
    return _near(x) & _near(y)


@inlined
def _mean(w, a, b, c):
    return vec.to_f32(w[0] * a + w[1] * b + w[2] * c)


@inlined
def _keep(planes, places, n, w, x, y):
    """Store a row of eight triangles."""
    weights = vec.to_f32(w[0]), vec.to_f32(w[1]), vec.to_f32(w[2])
    xy = _mean(w, x[0], x[1], x[2]), _mean(w, y[0], y[1], y[2])
    vec.store_rows(planes, places, (n[0], n[1], n[2], weights[0], weights[1], weights[2], xy[0], xy[1]))


@inner
def set_up_texels(columns, m, maps, lens, y, first, many, smooth, integers, floats, memory, at, count):
    """Put the triangles of eight of ``count`` missing records, from number ``at`` on, to their places.

    Args:
        columns .. smooth, memory .. count: as for ``planes.set_up``.
        integers, floats: pointers to the texture's rows.
    """
    whole = i32_at(memory)
    vertices, elements = f32_at(columns[II_VERTICES]), u32_at(columns[II_ELEMENTS])
    spots = vec.load(whole, M_COLUMNS + at)
    at += M_MISSING
    if many:
        look_ahead(whole, at, M_MISSING + count, first, elements, vertices)
    records = vec.load(whole, at)
    i0, i1, i2 = vec.load_elements(elements, (records - vec.i32(first)) * vec.i32(3))
    size = vec.i32(V_COLUMNS)
    v0, v1, v2 = (
        vec.load_octets(vertices, i0 * size),
        vec.load_octets(vertices, i1 * size),
        vec.load_octets(vertices, i2 * size),
    )
    p0, p1, p2 = optical(m, v0), optical(m, v1), optical(m, v2)
    rows, determinant = inverse(p0, p1, p2)
    none, one = vec.f64(0.0), vec.f64(1.0)
    side = vec.select(determinant < none, -one, one)
    here, right, down = spread_out(rows, side, lens, vec.to_f64(spots), vec.f64(y))
    total = here[0] + here[1] + here[2]
    place, row = _corners(integers, floats, (v0[6], v1[6], v2[6]), (v0[7], v1[7], v2[7]))
    usable = (total > none) & (total < vec.f64(math.inf)) & _fits(place, row)
    scale = one / vec.select(usable, total, vec.f64(math.nan))
    here = here[0] * scale, here[1] * scale, here[2] * scale
    right = right[0] * scale, right[1] * scale, right[2] * scale
    down = down[0] * scale, down[1] * scale, down[2] * scale
    slots = records & vec.i32(SLOTS - 1)
    vec.scatter(whole, slots + vec.i32(M_RECORDS), records)
    vec.scatter(whole, slots + vec.i32(M_PIXELS), spots | vec.i32(y << 16))
    planes = f32_at(memory + 4 * M_PLANES)
    slots = slots * vec.i32(PLANE_VALUES)
    below, beside = slots + vec.i32(ROW_VALUES), slots + vec.i32(2 * ROW_VALUES)
    if smooth:
        mirror = np.float64(maps[P_MIRROR])
        facing = vec.to_f32(vec.select(determinant > none, vec.f64(-mirror), vec.f64(mirror)))
        a, b, c = seen_normals(maps, v0, facing), seen_normals(maps, v1, facing), seen_normals(maps, v2, facing)
        n = _mean(here, a[0], b[0], c[0]), _mean(here, a[1], b[1], c[1]), _mean(here, a[2], b[2], c[2])
        _keep(planes, slots, n, here, place, row)
        n = _mean(down, a[0], b[0], c[0]), _mean(down, a[1], b[1], c[1]), _mean(down, a[2], b[2], c[2])
        _keep(planes, below, n, down, place, row)
        n = _mean(right, a[0], b[0], c[0]), _mean(right, a[1], b[1], c[1]), _mean(right, a[2], b[2], c[2])
        _keep(planes, beside, n, right, place, row)
        return
    f = cross(minus(p1, p0), minus(p2, p0))
    length = vec.sqrt(dot(f, f))
    unit = side / vec.select((length > none) & (length < vec.f64(math.inf)), length, vec.f64(math.inf))
    # Against the sign of the determinant: towards the camera, so that minus its z is above 0.
    level = vec.f32(0.0)
    _keep(planes, slots, (vec.to_f32(f[0] * unit), vec.to_f32(f[1] * unit), vec.to_f32(f[2] * unit)), here, place, row)
    _keep(planes, below, (level, level, level), down, place, row)
    _keep(planes, beside, (level, level, level), right, place, row)


@inner
def find_runs(ids, starts, y, places, run, last_run, rows, stride, memory):
    """Put into the rows A_RUN, for the runs ``run .. last_run``: where their planes are, and how far to the right and
    down of the pixels that these belong to they begin. Planes that are not known are marked by -1 in a fourth row."""
    whole, stop = i32_at(memory), vec.i32(last_run)
    to = A_RUN * stride
    for batch in range(run, last_run, vec.LANES):
        begins = vec.load(starts, batch)
        records = vec.gather(ids, begins)
        slots = records & vec.i32(SLOTS - 1)
        known = vec.gather(whole, slots + vec.i32(M_RECORDS)) == records
        spots = vec.gather(whole, slots + vec.i32(M_PIXELS))
        if places != 0:
            used = vec.i32(batch) + vec.iota() < stop
            begins = vec.gather(i32_at(places), vec.select(used, begins, vec.i32(0)))
        at = to + batch - run
        vec.store(rows, at, vec.float_of(slots * vec.i32(PLANE_VALUES)))
        vec.store(rows, at + stride, vec.to_f32(begins - (spots & vec.i32(0xFFFF))))
        vec.store(rows, at + 2 * stride, vec.to_f32(vec.i32(y) - (spots >> vec.i32(16))))
        vec.store(rows, at + 3 * stride, vec.select(known, vec.f32(0.0), vec.f32(-1.0)))


@inlined
def _within(starts, batch, w, d):
    """Which of eight runs lie within their triangles, by the coordinates of these at the runs' first pixels and what
    each pixel adds; and the sums of both."""
    steps = vec.to_f32(vec.load(starts, batch + 1) - vec.load(starts, batch) - vec.i32(1))
    e0, e1, e2 = w[0] + d[0] * steps, w[1] + d[1] * steps, w[2] + d[2] * steps
    # Linear between its ends: what is within the triangle there is so everywhere.
    lowest = vec.least(vec.least(vec.least(w[0], e0), vec.least(w[1], e1)), vec.least(w[2], e2))
    total, change = w[0] + w[1] + w[2], d[0] + d[1] + d[2]
    end = total + change * steps
    nearest, infinite = vec.f32(NEAREST), vec.f32(math.inf)
    far = (total < infinite) & (end < infinite)
    return (lowest >= vec.f32(0.0)) & (total >= nearest) & (end >= nearest) & far, total, change


@inlined
def eight_runs(starts, batch, run, rows, stride, memory):
    """Eight runs side by side, from run ``batch`` on, which ``find_runs`` was asked for from ``run`` on.

    Returns:
        Bits of those whose pixels all lie within triangles that are known; six values at the runs' first pixels (a
        normal on the side that is seen with minus its z, one over depth, column and row among the texels over depth),
        and what each pixel adds, f32x8 each.
    """
    at = A_RUN * stride + batch - run
    lines = vec.load_lines(f32_at(memory + 4 * M_PLANES), rows, at, at + stride, at + 2 * stride)
    weights = lines[PL_WEIGHTS], lines[PL_WEIGHTS + 1], lines[PL_WEIGHTS + 2]
    changes = lines[8 + PL_WEIGHTS], lines[8 + PL_WEIGHTS + 1], lines[8 + PL_WEIGHTS + 2]
    within, total, change = _within(starts, batch, weights, changes)
    return (
        vec.bits(within & (vec.load(rows, at + 3 * stride) >= vec.f32(0.0))),
        (lines[0], lines[1], lines[2], total, lines[6], lines[7]),
        (lines[8], lines[9], lines[10], change, lines[14], lines[15]),
    )


@inlined
def eight_short_runs(columns, maps, smooth, integers, floats, starts, batch, scratch):
    """As ``eight_runs``, of runs that ``resolve.set_up`` was called for: triangles that are hardly seen twice."""
    vertices, whole, values = f32_at(columns[II_VERTICES]), i32_at(scratch), f32_at(scratch)
    base, slope = f64_at(scratch + 64 * R_BASE), f64_at(scratch + 64 * R_SLOPE)
    size = vec.i32(V_COLUMNS)
    v0 = vec.load_octets(vertices, vec.load(whole, 8 * R_INDEX) * size)
    v1 = vec.load_octets(vertices, vec.load(whole, 8 * R_INDEX + 8) * size)
    v2 = vec.load_octets(vertices, vec.load(whole, 8 * R_INDEX + 16) * size)
    w, d = (
        (vec.load(base, 0), vec.load(base, 8), vec.load(base, 16)),
        (vec.load(slope, 0), vec.load(slope, 8), vec.load(slope, 16)),
    )
    x, y = _corners(integers, floats, (v0[6], v1[6], v2[6]), (v0[7], v1[7], v2[7]))
    if smooth:
        facing = vec.load(values, 8 * R_FACING)
        a, b, c = seen_normals(maps, v0, facing), seen_normals(maps, v1, facing), seen_normals(maps, v2, facing)
        n = _mean(w, a[0], b[0], c[0]), _mean(w, a[1], b[1], c[1]), _mean(w, a[2], b[2], c[2])
        m = _mean(d, a[0], b[0], c[0]), _mean(d, a[1], b[1], c[1]), _mean(d, a[2], b[2], c[2])
    else:
        level = vec.f32(0.0)
        n = vec.load(values, 8 * R_FLAT), vec.load(values, 8 * R_FLAT + 8), -vec.load(values, 8 * R_FLAT + 16)
        m = level, level, level
    weights = vec.to_f32(w[0]), vec.to_f32(w[1]), vec.to_f32(w[2])
    changes = vec.to_f32(d[0]), vec.to_f32(d[1]), vec.to_f32(d[2])
    within, total, change = _within(starts, batch, weights, changes)
    return (
        vec.bits(within & _fits(x, y)),
        (n[0], n[1], n[2], total, _mean(w, x[0], x[1], x[2]), _mean(w, y[0], y[1], y[2])),
        (m[0], m[1], m[2], change, _mean(d, x[0], x[1], x[2]), _mean(d, y[0], y[1], y[2])),
    )
