"""From runs of pixels that see one element to interpolated attributes along a row.

Eight runs at a time are set up in float64: their triangles' vertices in the optical frame, and from them the
unnormalised barycentric coordinates ``b = det(P) P^-1 d`` of a pixel's ray d, which are linear along the row. Along a
run they are float32: exact at the first of every eight pixels, and a slope.

Attributes are written eight pixels at a time from left to right: what a run writes beyond its end is overwritten by
the next one, so that nothing is masked.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, f64_at, i32_at, u32_at
from renderers.shading.layout import (
    A_COLOR,
    A_FACING,
    A_NORMAL,
    A_TANGENT,
    A_UV0,
    A_UV1,
    E_COLUMNS,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    II_ELEMENTS,
    II_EXTRAS,
    II_VERTICES,
    V_COLUMNS,
)
from renderers.shading.prefetch import look_ahead_of_runs
from renderers.shading.vec3 import cross, dot, minus, optical

# Scratch of eight runs, in rows of eight values of 8 bytes.
R_BASE: Final = 0  # 3 rows float64: coordinates at the run's first pixel
R_SLOPE: Final = 3  # 3 rows float64: change per pixel
# and in rows of eight values of 4 bytes, from the same place on:
R_INDEX: Final = 12  # 3 rows int32: vertices
R_FACING: Final = 15  # float32
R_FLAT: Final = 16  # 3 rows float32: the triangle's own normal
SCRATCH_VALUES: Final = 19 * 8
"""Values of 4 bytes."""
_LAST: Final = -(2**63)
"""The highest of 64 bits."""


@inlined
def _between(masks, word, begin, end):
    """A mask's bits for the pixels ``begin .. end``."""
    mask = masks[word]
    if word == begin >> 6:
        mask &= np.int64(-1) << (begin & 63)
    if word == end >> 6:
        mask &= (np.int64(1) << (end & 63)) - 1
    return mask


@inner
def run_starts(masks, begin, end, starts):
    """Write the columns at which runs of equal records begin among the pixels ``begin .. end``, which are not none, and
    ``end`` eight times behind them.

    Args:
        masks: see ``runs.find_runs``. starts: pointer to end - begin + 8 int32.

    Returns:
        The number of runs.
    """
    starts[0] = begin
    count = 1
    for word in range((begin + 1) >> 6, (end >> 6) + 1):
        mask = _between(masks, word, begin + 1, end)
        bits = vec.count_bits(mask)
        # Eight at a time, some in vain: how many there are cannot be predicted.
        for group in range(0, bits, vec.LANES):
            for k in range(vec.LANES):
                starts[count + group + k] = (word << 6) + vec.lowest_bit(mask | _LAST)
                mask &= mask - 1
        count += bits
    vec.store(starts, count, vec.i32(end))
    return count


@inner
def single_runs(begin, end, starts):
    """As ``run_starts`` for a row of which every pixel is a run of its own."""
    for x in range(begin, end):
        starts[x - begin] = x
    vec.store(starts, end - begin, vec.i32(end))
    return end - begin


@inner
def set_up(columns, m, mirror, lens, y, places, first, ids, starts, run, count, smooth, scratch):
    """Fill the scratch for the runs ``run .. run + count`` (at most eight) of triangles of one instance."""
    lane = vec.iota()
    begins = vec.select(lane < vec.i32(count), vec.load(starts, run), vec.i32(np.int64(starts[run])))
    element = vec.gather(ids, begins) - vec.i32(first)
    i0, i1, i2 = vec.load_elements(u32_at(columns[II_ELEMENTS]), element * vec.i32(3))
    vertices = f32_at(columns[II_VERTICES])
    stride = vec.i32(V_COLUMNS)
    p0 = optical(m, vec.load_triples(vertices, i0 * stride))
    p1 = optical(m, vec.load_triples(vertices, i1 * stride))
    p2 = optical(m, vec.load_triples(vertices, i2 * stride))
    # Rows of det(P) P^-1. The determinant is ((p1 - p0) x (p2 - p0)) . p0: negative where a counter-clockwise
    # element is seen from its front. A mirroring map turns that round.
    r0, r1, r2 = cross(p1, p2), cross(p2, p0), cross(p0, p1)
    determinant = dot(p0, r0)
    none, one = vec.f64(0.0), vec.f64(1.0)
    side = vec.select(determinant < none, vec.f64(-1.0), one)
    if places != 0:
        begins = vec.gather(i32_at(places), begins)
    dx = (vec.to_f64(begins) + vec.f64(0.5 - lens[2])) / vec.f64(lens[0])
    dy = vec.f64((y + 0.5 - lens[3]) / lens[1])
    a0 = side * (r0[0] * dx + r0[1] * dy + r0[2])
    a1 = side * (r1[0] * dx + r1[1] * dy + r1[2])
    a2 = side * (r2[0] * dx + r2[1] * dy + r2[2])
    # Any positive factor will do: float32 shall hold them however large or small the triangle is.
    total = vec.most(a0, none) + vec.most(a1, none) + vec.most(a2, none)
    usable = (total > none) & (total < vec.f64(math.inf))
    scale = one / vec.select(usable, total, one)
    step = side * scale / vec.f64(lens[0])
    base, slope = f64_at(scratch + 64 * R_BASE), f64_at(scratch + 64 * R_SLOPE)
    vec.store(base, 0, a0 * scale)
    vec.store(base, 8, a1 * scale)
    vec.store(base, 16, a2 * scale)
    vec.store(slope, 0, r0[0] * step)
    vec.store(slope, 8, r1[0] * step)
    vec.store(slope, 16, r2[0] * step)
    whole, values = i32_at(scratch), f32_at(scratch)
    vec.store(whole, 8 * R_INDEX, i0)
    vec.store(whole, 8 * R_INDEX + 8, i1)
    vec.store(whole, 8 * R_INDEX + 16, i2)
    back = vec.select(determinant > none, vec.f32(-mirror), vec.f32(mirror))
    vec.store(values, 8 * R_FACING, back)
    if not smooth:
        n = cross(minus(p1, p0), minus(p2, p0))
        length = vec.sqrt(dot(n, n))
        usable = (length > none) & (length < vec.f64(math.inf))
        # Against the sign of the determinant: towards the camera.
        scale = vec.select(usable, (none - side) / vec.select(usable, length, one), none)
        vec.store(values, 8 * R_FLAT, vec.to_f32(n[0] * scale))
        vec.store(values, 8 * R_FLAT + 8, vec.to_f32(n[1] * scale))
        vec.store(values, 8 * R_FLAT + 16, vec.to_f32(n[2] * scale))


@inlined
def further(base, slope, k, offset):
    """Unnormalised coordinates ``offset`` pixels behind a run's first."""
    return (
        base[k] + slope[k] * offset,
        base[8 + k] + slope[8 + k] * offset,
        base[16 + k] + slope[16 + k] * offset,
    )


@inlined
def weights(start, slope, k, lane):
    """Perspective-correct barycentric coordinates of the second and third vertex at eight pixels of run ``k`` (f32x8),
    from the unnormalised ones at the first of them.

    A pixel centre that coverage (exact in 1/256 pixel) counts in may lie a little outside of the unrounded triangle:
    negative coordinates become 0, so that nothing is extrapolated. Anything not finite becomes the centroid.
    """
    zero = vec.f32(0.0)
    b0 = vec.most(vec.f32(start[0]) + vec.f32(slope[k]) * lane, zero)
    b1 = vec.most(vec.f32(start[1]) + vec.f32(slope[8 + k]) * lane, zero)
    b2 = vec.most(vec.f32(start[2]) + vec.f32(slope[16 + k]) * lane, zero)
    total = b0 + b1 + b2
    usable = (total > zero) & (total < vec.f32(np.inf))
    share = vec.f32(1.0) / total
    third = vec.f32(1.0 / 3.0)
    return vec.select(usable, b1 * share, third), vec.select(usable, b2 * share, third)


@inner
def _write_extras(has, extras, i0, i1, i2, rows, stride, begin, end, base, slope, k):
    """Colours, second coordinates and tangents of one run."""
    lane = vec.to_f32(vec.iota())
    o0, o1, o2 = i0 * E_COLUMNS, i1 * E_COLUMNS, i2 * E_COLUMNS
    for x in range(begin, end, vec.LANES):
        w1, w2 = weights(further(base, slope, k, np.float64(x - begin)), slope, k, lane)
        if has & HAS_COLORS:
            for j in range(4):
                a, b, c = extras[o0 + j], extras[o1 + j], extras[o2 + j]
                vec.store(rows, (A_COLOR + j) * stride + x, vec.f32(a) + (w1 * vec.f32(b - a) + w2 * vec.f32(c - a)))
        if has & HAS_UV1:
            for j in range(2):
                a, b, c = extras[o0 + 4 + j], extras[o1 + 4 + j], extras[o2 + 4 + j]
                vec.store(rows, (A_UV1 + j) * stride + x, vec.f32(a) + (w1 * vec.f32(b - a) + w2 * vec.f32(c - a)))
        if has & HAS_TANGENTS:
            for j in range(4):
                a, b, c = extras[o0 + 8 + j], extras[o1 + 8 + j], extras[o2 + 8 + j]
                vec.store(rows, (A_TANGENT + j) * stride + x, vec.f32(a) + (w1 * vec.f32(b - a) + w2 * vec.f32(c - a)))


@inner
def resolve_triangles(
    columns, m, mirror, lens, y, places, first, many, has, ids, starts, run, last_run, rows, stride, scratch
):
    """Attributes of the runs ``run .. last_run`` of one instance's triangles.

    Args:
        columns: pointer to the instance's row of the instance table.
        m: pointer to the (4, 4) float64 map to the optical frame. mirror: -1 where it mirrors, else 1.
        lens: pointer to fx, fy, cx, cy.
        places: address of the columns of the picture that the row's records belong to, all of which are runs of their
            own then; 0: where they lie.
        first: the instance's first record. many: whether its mesh is larger than a cache.
        has: HAS_ bits of what is wanted.
        ids, starts: as in ``run_starts``.
        rows: pointer to A_ROWS rows of ``stride`` float32.
        scratch: address of SCRATCH_VALUES values of 4 bytes.
    """
    vertices = f32_at(columns[II_VERTICES])
    extras = f32_at(columns[II_EXTRAS])
    smooth = (has & HAS_NORMALS) != 0
    mapped = (has & HAS_UV0) != 0
    more = (has & (HAS_COLORS | HAS_UV1 | HAS_TANGENTS)) != 0
    base, slope = f64_at(scratch + 64 * R_BASE), f64_at(scratch + 64 * R_SLOPE)
    whole, values = i32_at(scratch), f32_at(scratch)
    lane = vec.to_f32(vec.iota())
    for batch in range(run, last_run, vec.LANES):
        count = min(last_run - batch, vec.LANES)
        if many:
            look_ahead_of_runs(columns, first, ids, starts, batch, last_run)
        set_up(columns, m, mirror, lens, y, places, first, ids, starts, batch, count, smooth, scratch)
        for k in range(count):
            begin, end = np.int64(starts[batch + k]), np.int64(starts[batch + k + 1])
            i0, i1, i2 = (
                np.int64(whole[8 * R_INDEX + k]),
                np.int64(whole[8 * R_INDEX + 8 + k]),
                np.int64(whole[8 * R_INDEX + 16 + k]),
            )
            a = vec.load(vertices, i0 * V_COLUMNS)
            b = vec.load(vertices, i1 * V_COLUMNS) - a
            c = vec.load(vertices, i2 * V_COLUMNS) - a
            facing = vec.f32(values[8 * R_FACING + k])
            start = base[k], base[8 + k], base[16 + k]
            for x in range(begin, end, vec.LANES):
                w1, w2 = weights(start, slope, k, lane)
                if x + vec.LANES < end:
                    start = further(base, slope, k, np.float64(x + vec.LANES - begin))
                vec.store(rows, A_FACING * stride + x, facing)
                if smooth:
                    nx = vec.spread3(a) + (w1 * vec.spread3(b) + w2 * vec.spread3(c))
                    ny = vec.spread4(a) + (w1 * vec.spread4(b) + w2 * vec.spread4(c))
                    nz = vec.spread5(a) + (w1 * vec.spread5(b) + w2 * vec.spread5(c))
                    vec.store(rows, A_NORMAL * stride + x, nx)
                    vec.store(rows, (A_NORMAL + 1) * stride + x, ny)
                    vec.store(rows, (A_NORMAL + 2) * stride + x, nz)
                else:
                    for j in range(3):
                        vec.store(rows, (A_NORMAL + j) * stride + x, vec.f32(values[8 * (R_FLAT + j) + k]))
                if mapped:
                    u = vec.spread6(a) + (w1 * vec.spread6(b) + w2 * vec.spread6(c))
                    v = vec.spread7(a) + (w1 * vec.spread7(b) + w2 * vec.spread7(c))
                    vec.store(rows, A_UV0 * stride + x, u)
                    vec.store(rows, (A_UV0 + 1) * stride + x, v)
            if more:
                _write_extras(has, extras, i0, i1, i2, rows, stride, begin, end, base, slope, k)


@inner
def _point(m, vertices, i):
    """One vertex in the optical frame, float64."""
    at = i * V_COLUMNS
    x, y, z = np.float64(vertices[at]), np.float64(vertices[at + 1]), np.float64(vertices[at + 2])
    return (
        m[0] * x + m[1] * y + m[2] * z + m[3],
        m[4] * x + m[5] * y + m[6] * z + m[7],
        m[8] * x + m[9] * y + m[10] * z + m[11],
    )


@inner
def resolve_strokes(columns, topology, m, lens, y, places, first, has, ids, starts, run, last_run, rows, stride):
    """As ``resolve_triangles`` for lines and points: weights of the two ends at the point of the segment that projects
    nearest (along the line) to each pixel.

    With e = q - p, all points p + t e project onto one line of the image with the direction
    s = e.xy p.z - p.xy e.z; demanding that the projection's component along s equals the ray's gives a linear
    equation in t, also when an end lies behind the camera. A point (p = q) gets the whole weight at its vertex.
    """
    elements = u32_at(columns[II_ELEMENTS])
    vertices = f32_at(columns[II_VERTICES])
    extras = f32_at(columns[II_EXTRAS])
    dy = (y + 0.5 - lens[3]) / lens[1]
    for r in range(run, last_run):
        begin, end = np.int64(starts[r]), np.int64(starts[r + 1])
        element = np.int64(ids[begin]) - first
        i0 = np.int64(elements[element * topology])
        i1 = np.int64(elements[element * topology + topology - 1])
        p, q = _point(m, vertices, i0), _point(m, vertices, i1)
        ex, ey, ez = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        sx, sy = ex * p[2] - p[0] * ez, ey * p[2] - p[1] * ez
        for x in range(begin, end):
            column = x if places == 0 else np.int64(i32_at(places)[x])
            along = sx * ((column + 0.5 - lens[2]) / lens[0]) + sy * dy
            numerator = along * p[2] - (p[0] * sx + p[1] * sy)
            denominator = ex * sx + ey * sy - along * ez
            t = numerator / denominator if denominator != 0.0 else 0.0
            t = min(max(t, 0.0), 1.0) if abs(t) < math.inf else 0.0
            w = np.float32(t)
            if has & HAS_UV0:
                for j in range(2):
                    a, b = vertices[i0 * V_COLUMNS + 6 + j], vertices[i1 * V_COLUMNS + 6 + j]
                    rows[(A_UV0 + j) * stride + x] = a + w * (b - a)
            if has & HAS_COLORS:
                for j in range(4):
                    a, b = extras[i0 * E_COLUMNS + j], extras[i1 * E_COLUMNS + j]
                    rows[(A_COLOR + j) * stride + x] = a + w * (b - a)
            if has & HAS_UV1:
                for j in range(2):
                    a, b = extras[i0 * E_COLUMNS + 4 + j], extras[i1 * E_COLUMNS + 4 + j]
                    rows[(A_UV1 + j) * stride + x] = a + w * (b - a)
