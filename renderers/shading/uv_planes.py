"""Remembered planes of triangles with a picture on them: what the head light leaves, and which texels a pixel sees.

As in ``planes``, but the values beside the barycentric coordinates are light and where among the texels a pixel lies,
both over depth. One over depth is the coordinates' sum: 1 at the pixel that the triangle was set up at.

Light is the cosine to the camera of a normal that is interpolated. Between corners whose normals are alike, the
corners' cosines are interpolated instead: between unit normals that are at most D apart, a normal n is at least
1 - D^2 / 6 long before it is made a unit again, so that what differs is at most n.z D^2 / 6, see ``ALIKE``.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, f64_at, i32_at, u32_at
from renderers.shading.attribute_planes import (
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
    spread_out,
)
from renderers.shading.bilinear import WHOLE
from renderers.shading.layout import A_RUN, II_ELEMENTS, II_VERTICES, P_MIRROR, P_NORMAL, V_COLUMNS
from renderers.shading.material import turned
from renderers.shading.prefetch import look_ahead
from renderers.shading.resolve import R_BASE, R_FACING, R_FLAT, R_INDEX, R_SLOPE
from renderers.shading.sampling import FINE
from renderers.shading.textures import (
    TI_HEIGHT,
    TI_TRANSFORMED,
    TI_WIDTH,
    TI_WRAP_S,
    TI_WRAP_T,
    WRAP_CLAMP,
    WRAP_REPEAT,
)
from renderers.shading.vec3 import cross, dot, minus, optical

FARTHEST: Final = 8192
"""Texels from the image's corner up to which float32 has fractions enough."""
NEAREST: Final = 0.5
"""Least of 1 / depth, over that of the pixel of the set-up: towards a horizon it vanishes, and what float32 knows of
it."""
ALIKE: Final = 1.0 - 0.0036
"""Cosine of normals that are alike, at least: D^2 is 0.0072, and light is wrong by 0.3 levels at most."""

# A row, instead of ``planes``':
PL_LIGHT: Final = 0  # what the head light leaves, times mixing.WHOLE; or where normals are not alike minus their z,
PL_ASIDE: Final = 1  # and 2 values: their x and y
PL_PLACE: Final = 6  # 2 values: column and row among the texels, in parts of one (sampling.FINE)
UNLIKE: Final = -(2**31)
"""Bit of a place's pixel: normals are not alike."""


@inlined
def _texels(coordinate, wrap, size):
    """Where among the centres of ``size`` texels the coordinates of three corners lie (f64x8, in parts of a texel), in
    the image that the least of them is in, where it is repeated."""
    a, b, c = vec.to_f64(coordinate[0]), vec.to_f64(coordinate[1]), vec.to_f64(coordinate[2])
    if wrap != WRAP_CLAMP:
        period = 1.0 if wrap == WRAP_REPEAT else 2.0
        least = vec.least(vec.least(coordinate[0], coordinate[1]), coordinate[2])
        first = vec.to_f64(vec.f32(period) * vec.floor(vec.f32(1.0 / period) * least))
        a, b, c = a - first, b - first, c - first
    half, count = vec.f64(0.5 * FINE), vec.f64(np.float64(size) * FINE)
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
    limit = vec.f64(FARTHEST * FINE)
    return (vec.absolute(x[0]) <= limit) & (vec.absolute(x[1]) <= limit) & (vec.absolute(x[2]) <= limit)


@inlined
def _fits(x, y):
    return _near(x) & _near(y)


@inlined
def _mean(w, a, b, c):
    return vec.to_f32(w[0] * a + w[1] * b + w[2] * c)


@inlined
def _keep(planes, places, a, b, c, w, x, y):
    """Store a row of eight triangles: ``a``, ``b`` and ``c`` what their corners have for PL_LIGHT and PL_ASIDE."""
    w0, w1, w2 = vec.to_f32(w[0]), vec.to_f32(w[1]), vec.to_f32(w[2])
    light, nx, ny = (
        w0 * a[0] + w1 * b[0] + w2 * c[0],
        w0 * a[1] + w1 * b[1] + w2 * c[1],
        w0 * a[2] + w1 * b[2] + w2 * c[2],
    )
    vec.store_rows(planes, places, (light, nx, ny, w0, w1, w2, _mean(w, x[0], x[1], x[2]), _mean(w, y[0], y[1], y[2])))


@inlined
def _keep_even(planes, places, light, w, x, y):
    """``_keep`` for the same light at all corners."""
    w0, w1, w2, none = vec.to_f32(w[0]), vec.to_f32(w[1]), vec.to_f32(w[2]), vec.f32(0.0)
    xy = _mean(w, x[0], x[1], x[2]), _mean(w, y[0], y[1], y[2])
    vec.store_rows(planes, places, (light * (w0 + w1 + w2), none, none, w0, w1, w2, xy[0], xy[1]))


@inlined
def _shine(alike, n, square, facing):
    """What a corner has for PL_LIGHT and PL_ASIDE."""
    none = vec.f32(0.0)
    towards = -(n[2] * facing)
    light = vec.select(alike, towards * (vec.f32(WHOLE) / vec.sqrt(square)), towards)
    return light, vec.select(alike, none, n[0]), vec.select(alike, none, n[1])


@inlined
def _alike(a, b, c, aa, bb, cc):
    """Whether three normals, of these squared lengths, are alike, of which unequal lengths are not."""
    largest = vec.most(vec.most(aa, bb), cc)
    least = largest * vec.f32(ALIKE)
    alike = (dot(a, b) >= least) & (dot(b, c) >= least) & (dot(c, a) >= least)
    return alike & (largest > vec.f32(0.0)) & (largest < vec.f32(math.inf))


@inner
def set_up_texels(columns, m, maps, lens, y, first, many, smooth, lit, integers, floats, memory, at, count):
    """Put the triangles of eight of ``count`` missing records, from number ``at`` on, to their places.

    Args:
        columns .. smooth, memory .. count: as for ``planes.set_up``.
        lit: whether light counts. integers, floats: pointers to the texture's rows.
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
    pixels, spots = slots + vec.i32(M_PIXELS), spots | vec.i32(y << 16)
    planes = f32_at(memory + 4 * M_PLANES)
    slots = slots * vec.i32(PLANE_VALUES)
    below, beside = slots + vec.i32(ROW_VALUES), slots + vec.i32(2 * ROW_VALUES)
    if smooth:
        mirror = np.float32(maps[P_MIRROR])
        facing = vec.select(determinant > none, vec.f32(-mirror), vec.f32(mirror))
        a = turned(maps, P_NORMAL, v0[3], v0[4], v0[5])
        b = turned(maps, P_NORMAL, v1[3], v1[4], v1[5])
        c = turned(maps, P_NORMAL, v2[3], v2[4], v2[5])
        aa, bb, cc = dot(a, a), dot(b, b), dot(c, c)
        alike = _alike(a, b, c, aa, bb, cc)
        marked = spots | vec.select(alike, vec.i32(0), vec.i32(UNLIKE))
        a, b, c = _shine(alike, a, aa, facing), _shine(alike, b, bb, facing), _shine(alike, c, cc, facing)
        _keep(planes, slots, a, b, c, here, place, row)
        _keep(planes, below, a, b, c, down, place, row)
        _keep(planes, beside, a, b, c, right, place, row)
        vec.scatter(whole, pixels, marked)
        return
    light = vec.f32(WHOLE)
    if lit:
        f = cross(minus(p1, p0), minus(p2, p0))
        length = vec.sqrt(dot(f, f))
        unit = side / vec.select((length > none) & (length < vec.f64(math.inf)), length, vec.f64(math.inf))
        # Against the sign of the determinant: towards the camera, so that minus its z is above 0.
        light = vec.to_f32(f[2] * unit) * light
    _keep_even(planes, slots, light, here, place, row)
    _keep_even(planes, below, light, down, place, row)
    _keep_even(planes, beside, light, right, place, row)
    vec.scatter(whole, pixels, spots)


@inner
def find_runs(ids, starts, y, places, run, last_run, rows, stride, memory):
    """Put into the rows A_RUN, for the runs ``run .. last_run``: where their planes are, and how far to the right and
    down of the pixels that these belong to they begin. In a fourth row -1 marks planes that are not known, and 1 those
    of normals that are not alike."""
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
        vec.store(rows, at + 2 * stride, vec.to_f32(vec.i32(y) - ((spots >> vec.i32(16)) & vec.i32(0x7FFF))))
        unlike = vec.select(spots < vec.i32(0), vec.f32(1.0), vec.f32(0.0))
        vec.store(rows, at + 3 * stride, vec.select(known, unlike, vec.f32(-1.0)))


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
        Bits of those whose pixels all lie within triangles that are known; above 0 (f32x8) for those whose normals are
        not alike; six values at the runs' first pixels (PL_LIGHT, PL_ASIDE, one over depth, column and row among the
        texels over depth), and what each pixel adds, f32x8 each.
    """
    at = A_RUN * stride + batch - run
    lines = vec.load_lines(f32_at(memory + 4 * M_PLANES), rows, at, at + stride, at + 2 * stride)
    weights = lines[PL_WEIGHTS], lines[PL_WEIGHTS + 1], lines[PL_WEIGHTS + 2]
    changes = lines[8 + PL_WEIGHTS], lines[8 + PL_WEIGHTS + 1], lines[8 + PL_WEIGHTS + 2]
    within, total, change = _within(starts, batch, weights, changes)
    unlike = vec.load(rows, at + 3 * stride)
    return (
        vec.bits(within & (unlike >= vec.f32(0.0))),
        unlike,
        (lines[0], lines[1], lines[2], total, lines[6], lines[7]),
        (lines[8], lines[9], lines[10], change, lines[14], lines[15]),
    )


@inlined
def eight_short_runs(columns, maps, smooth, lit, integers, floats, starts, batch, scratch):
    """As ``eight_runs``, of runs that ``resolve.set_up`` was called for: triangles that are hardly seen twice, so that
    their corners are not looked at."""
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
    weights = vec.to_f32(w[0]), vec.to_f32(w[1]), vec.to_f32(w[2])
    changes = vec.to_f32(d[0]), vec.to_f32(d[1]), vec.to_f32(d[2])
    within, total, change = _within(starts, batch, weights, changes)
    none, unlike = vec.f32(0.0), vec.f32(0.0)
    if smooth:
        unlike = vec.f32(1.0)
        facing = vec.load(values, 8 * R_FACING)
        nx, ny, nz = _seen(maps, facing, _between_corners(v0, v1, v2, weights))
        mx, my, mz = _seen(maps, facing, _between_corners(v0, v1, v2, changes))
    else:
        light = vec.f32(WHOLE)
        if lit:
            light = vec.load(values, 8 * R_FLAT + 16) * -light
        nx, ny, nz, mx, my, mz = none, none, light * total, none, none, light * change
    return (
        vec.bits(within & _fits(x, y)),
        unlike,
        (nz, nx, ny, total, _mean(w, x[0], x[1], x[2]), _mean(w, y[0], y[1], y[2])),
        (mz, mx, my, change, _mean(d, x[0], x[1], x[2]), _mean(d, y[0], y[1], y[2])),
    )


@inlined
def _between_corners(a, b, c, w):
    """A normal of three corners, in the mesh's frame."""
    return (
        w[0] * a[3] + w[1] * b[3] + w[2] * c[3],
        w[0] * a[4] + w[1] * b[4] + w[2] * c[4],
        w[0] * a[5] + w[1] * b[5] + w[2] * c[5],
    )


@inlined
def _seen(maps, facing, n):
    """A normal of the mesh in the optical frame, with minus its z on the side that is seen: what light needs of it."""
    nx, ny, nz = turned(maps, P_NORMAL, n[0], n[1], n[2])
    return nx, ny, -(nz * facing)
