"""Attributes of pixels, perspective-correct, from the vertices of the primitives they see.

The unnormalised barycentric coordinates ``b = det(P) P^-1 d`` of a pixel's ray ``d`` are linear along a row; the
columns of ``P`` are the vertices in the optical frame. Attributes are ``sum(b_i a_i) / sum(b_i)``. ``set_up_spans``
computes both sums at the first pixel of a span and their change per pixel, in float64, for eight spans at a time.
``interpolate`` evaluates them at eight neighbouring pixels, which belong to at most eight spans.
"""

from __future__ import annotations

import math

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at, f64_at, i32_at, i64_at, u32_at
from renderers.shading.layout import (
    A_COLOR,
    A_FACING,
    A_FLAT,
    A_GRADIENT0,
    A_GRADIENT1,
    A_NORMAL,
    A_POINT,
    A_TANGENT,
    A_UV0,
    A_UV1,
    E_COLOR,
    E_COLUMNS,
    E_TANGENT,
    E_UV1,
    G_COLUMNS,
    G_ELEMENTS,
    G_EXTRAS,
    G_FIRST,
    G_HAS,
    G_LANES,
    G_LENS,
    G_MAPS,
    G_MASKS,
    G_PIXELS,
    G_POINTS,
    G_RECORDS,
    G_SPANS,
    G_STARTS,
    G_SURFACE,
    G_TOPOLOGY,
    G_VERTICES,
    G_Y,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    P_MIRROR,
    P_NORMAL,
    P_TANGENT,
    SPAN_ROOM,
    STRIDE,
    T_BEGIN,
    T_COLOR,
    T_DEPTH,
    T_FACING,
    T_FLAT,
    T_NORMAL,
    T_TANGENT,
    T_TOTAL,
    T_TOTAL_GRADIENT,
    T_UV0,
    T_UV0_GRADIENT,
    T_UV1,
    T_UV1_GRADIENT,
    V_COLUMNS,
    V_NORMAL,
    V_UV0,
)
from renderers.shading.vec3 import cross, dot, minus, times, transform_directions, transform_points


@inlined
def _indices(segment, element):
    """Vertices of eight primitives, i32x8 each; those of lines and points repeat the last one."""
    elements = u32_at(segment[G_ELEMENTS])
    if segment[G_TOPOLOGY] == 3:
        return vec.load_elements(elements, element * vec.i32(3))
    if segment[G_TOPOLOGY] == 2:
        second = vec.gather(elements, element + element + vec.i32(1))
        return vec.gather(elements, element + element), second, second
    only = vec.gather(elements, element)
    return only, only, only


@inlined
def _line_rows(p, q):
    """For lines, what ``rows`` is for triangles: the weights of the two ends are linear in the ray, as well.

    With e = q - p, all points p + t e project onto one line of the image with the direction s = e.xy p.z - p.xy e.z.
    Where the projection's component along s equals the ray's, t is the quotient of two functions linear in the ray.
    """
    e = minus(q, p)
    sx, sy = e[0] * p[2] - p[0] * e[2], e[1] * p[2] - p[1] * e[2]
    none = vec.f64(0.0)
    numerator = sx * p[2], sy * p[2], none - (p[0] * sx + p[1] * sy)
    denominator = none - sx * e[2], none - sy * e[2], e[0] * sx + e[1] * sy
    return minus(denominator, numerator), numerator, (none, none, none)


@inlined
def _at(row, dx, dy):
    return row[0] * dx + row[1] * dy + row[2]


@inlined
def _between(w, a, b, c):
    return w[0] * a + w[1] * b + w[2] * c


@inlined
def _between3(w, a, b, c, k):
    return (
        _between(w, a[k], b[k], c[k]),
        _between(w, a[k + 1], b[k + 1], c[k + 1]),
        _between(w, a[k + 2], b[k + 2], c[k + 2]),
    )


@inlined
def _put(spans, row, count, at, here, step, a, b, c, k):
    """Store ``count`` attributes of the corners from value ``k`` on, weighted by ``here``, then by ``step``."""
    for j in range(count):
        vec.store(spans, (row + j) * SPAN_ROOM + at, _between(here, a[k + j], b[k + j], c[k + j]))
        vec.store(spans, (row + count + j) * SPAN_ROOM + at, _between(step, a[k + j], b[k + j], c[k + j]))


@inlined
def _put3(spans, row, at, values):
    vec.store(spans, row * SPAN_ROOM + at, values[0])
    vec.store(spans, (row + 1) * SPAN_ROOM + at, values[1])
    vec.store(spans, (row + 2) * SPAN_ROOM + at, values[2])


@inlined
def _single(w):
    return vec.to_f32(w[0]), vec.to_f32(w[1]), vec.to_f32(w[2])


@device_function
def _set_up_eight(segment, span, count, at):
    """Fill eight values of the rows T_ from ``at`` on, of the spans ``span .. span + count``.

    Returns:
        True if the normal is constant along each of them.
    """
    m, maps, lens = f64_at(segment[G_POINTS]), f32_at(segment[G_MAPS]), f64_at(segment[G_LENS])
    spans, starts, has = f32_at(segment[G_SPANS]), i32_at(segment[G_STARTS]), segment[G_HAS]
    vertices, y = f32_at(segment[G_VERTICES]), segment[G_Y]
    # Lanes beyond the last span repeat it: their records belong to other instances.
    lane = vec.minimum(vec.iota(), vec.i32(count - 1))
    record = vec.permute(vec.load(i32_at(segment[G_RECORDS]), span), lane)
    first = vec.permute(vec.load(starts, span), lane)
    steps = vec.to_f64(vec.permute(vec.load(starts, span + 1), lane) - first - vec.i32(1))
    if segment[G_COLUMNS] != 0:
        first = vec.gather(i32_at(segment[G_COLUMNS]), first)
    i0, i1, i2 = _indices(segment, record - vec.i32(segment[G_FIRST]))
    eight = vec.i32(V_COLUMNS)
    a, b, c = (
        vec.load_octets(vertices, i0 * eight),
        vec.load_octets(vertices, i1 * eight),
        vec.load_octets(vertices, i2 * eight),
    )
    p0, p1, p2 = transform_points(m, a), transform_points(m, b), transform_points(m, c)
    none, one = vec.f64(0.0), vec.f64(1.0)
    # Rows of det(P) P^-1. The determinant ((p1 - p0) x (p2 - p0)) . p0 is negative where a counter-clockwise triangle
    # is seen from its front. A mirroring map turns that round.
    rows = cross(p1, p2), cross(p2, p0), cross(p0, p1)
    determinant = dot(p0, rows[0])
    if segment[G_TOPOLOGY] != 3:
        rows = _line_rows(p0, p1)
        determinant = rows[0][2] + rows[1][2]
    side = vec.select(determinant < none, none - one, one)
    across, down = vec.f64(1.0 / lens[0]), vec.f64(1.0 / lens[1])
    dx, dy = (vec.to_f64(first) + vec.f64(0.5 - lens[2])) * across, vec.f64(y + 0.5 - lens[3]) * down
    if segment[G_TOPOLOGY] != 3:  # the sum of the weights is positive where the line is seen
        side = vec.select(_at(rows[0], dx, dy) + _at(rows[1], dx, dy) < none, none - one, one)
    # Coverage, exact in 1/256 pixel, may include pixel centres a little outside of the triangle. Negative coordinates
    # at the ends of a span become 0: nothing is extrapolated.
    end = dx + steps * across
    b0, e0 = vec.maximum(side * _at(rows[0], dx, dy), none), vec.maximum(side * _at(rows[0], end, dy), none)
    b1, e1 = vec.maximum(side * _at(rows[1], dx, dy), none), vec.maximum(side * _at(rows[1], end, dy), none)
    b2, e2 = vec.maximum(side * _at(rows[2], dx, dy), none), vec.maximum(side * _at(rows[2], end, dy), none)
    total, last = b0 + b1 + b2, e0 + e1 + e2
    infinite = vec.f64(math.inf)
    usable = (total > none) & (total < infinite) & (last > none) & (last < infinite)
    # Any positive factor will do: with the sum 1 at the first pixel, float32 has all that is needed.
    scale = vec.select(usable, one / total, none)
    step = scale / vec.maximum(steps, one)
    third = vec.f64(1.0 / 3.0)  # the centroid of what cannot be resolved
    here = _single(
        (
            vec.select(usable, b0 * scale, third),
            vec.select(usable, b1 * scale, third),
            vec.select(usable, b2 * scale, third),
        )
    )
    change = _single(
        (
            vec.select(usable, (e0 - b0) * step, none),
            vec.select(usable, (e1 - b1) * step, none),
            vec.select(usable, (e2 - b2) * step, none),
        )
    )
    mirror = vec.f32(maps[P_MIRROR])
    facing = vec.select(determinant > none, -mirror, mirror)
    vec.store(spans, T_BEGIN * SPAN_ROOM + at, vec.to_f32(first))
    vec.store(spans, T_FACING * SPAN_ROOM + at, facing)
    vec.store(spans, T_TOTAL * SPAN_ROOM + at, here[0] + here[1] + here[2])
    vec.store(spans, (T_TOTAL + 1) * SPAN_ROOM + at, change[0] + change[1] + change[2])
    zero, k, constant = vec.f32(0.0), V_NORMAL, True
    if has & HAS_NORMALS:
        same = (a[k] == b[k]) & (a[k + 1] == b[k + 1]) & (a[k + 2] == b[k + 2])
        same = same & (a[k] == c[k]) & (a[k + 1] == c[k + 1]) & (a[k + 2] == c[k + 2])
        constant = vec.movemask(same) == 255
        normal, turn = (a[k], a[k + 1], a[k + 2]), (zero, zero, zero)
        if not constant:
            normal, turn = _between3(here, a, b, c, k), _between3(change, a, b, c, k)
        _put3(spans, T_NORMAL, at, times(transform_directions(maps, P_NORMAL, normal), facing))
        _put3(spans, T_NORMAL + 3, at, times(transform_directions(maps, P_NORMAL, turn), facing))
    if not has & HAS_NORMALS or segment[G_SURFACE] != 0:
        flat = cross(minus(p1, p0), minus(p2, p0))
        length = vec.sqrt(dot(flat, flat))
        usable_normal = (length > none) & (length < infinite)
        # Against the sign of the determinant: towards the camera.
        towards = vec.select(usable_normal, (none - side) / vec.select(usable_normal, length, one), none)
        flat_normal = _single(times(flat, towards))
        if not has & HAS_NORMALS:
            _put3(spans, T_NORMAL, at, flat_normal)
            _put3(spans, T_NORMAL + 3, at, (zero, zero, zero))
        _put3(spans, T_FLAT, at, flat_normal)
    if has & HAS_UV0:
        _put(spans, T_UV0, 2, at, here, change, a, b, c, V_UV0)
    right = lower = here
    if segment[G_SURFACE] != 0:
        vec.store(spans, T_DEPTH * SPAN_ROOM + at, vec.to_f32(vec.absolute(determinant) * scale))
        # Not ``change``: spans of a single pixel have gradients, too.
        dx, dy = scale * side * across, scale * side * down
        right = _single((rows[0][0] * dx, rows[1][0] * dx, rows[2][0] * dx))
        lower = _single((rows[0][1] * dy, rows[1][1] * dy, rows[2][1] * dy))
        vec.store(spans, T_TOTAL_GRADIENT * SPAN_ROOM + at, right[0] + right[1] + right[2])
        vec.store(spans, (T_TOTAL_GRADIENT + 1) * SPAN_ROOM + at, lower[0] + lower[1] + lower[2])
        if has & HAS_UV0:
            _put(spans, T_UV0_GRADIENT, 2, at, right, lower, a, b, c, V_UV0)
    if has & (HAS_COLORS | HAS_UV1 | HAS_TANGENTS):
        extras, wide = f32_at(segment[G_EXTRAS]), vec.i32(E_COLUMNS)
        d = vec.load_octets(extras, i0 * wide)
        e = vec.load_octets(extras, i1 * wide)
        f = vec.load_octets(extras, i2 * wide)
        if has & HAS_COLORS:
            _put(spans, T_COLOR, 4, at, here, change, d, e, f, E_COLOR)
        if has & HAS_UV1:
            _put(spans, T_UV1, 2, at, here, change, d, e, f, E_UV1)
            if segment[G_SURFACE] != 0:
                _put(spans, T_UV1_GRADIENT, 2, at, right, lower, d, e, f, E_UV1)
        if has & HAS_TANGENTS:
            tangents = vec.i32(E_TANGENT)
            d = vec.load_octets(extras, i0 * wide + tangents)
            e = vec.load_octets(extras, i1 * wide + tangents)
            f = vec.load_octets(extras, i2 * wide + tangents)
            along = transform_directions(maps, P_TANGENT, _between3(here, d, e, f, 0))
            turn = transform_directions(maps, P_TANGENT, _between3(change, d, e, f, 0))
            _put3(spans, T_TANGENT, at, along)
            vec.store(spans, (T_TANGENT + 3) * SPAN_ROOM + at, _between(here, d[3], e[3], f[3]))
            _put3(spans, T_TANGENT + 4, at, turn)
            vec.store(spans, (T_TANGENT + 7) * SPAN_ROOM + at, _between(change, d[3], e[3], f[3]))
    return constant


@inlined
def _prefetch(segment, span, last_span):
    """Prefetch what ``_set_up_eight`` reads of the spans two batches ahead, and the indices four batches ahead.

    Meshes of many triangles fill no cache: without this, frames of a million triangles take a fifth longer.

    Args:
        last_span: end of the segment.
    """
    records, first = i32_at(segment[G_RECORDS]), segment[G_FIRST]
    elements, vertices = u32_at(segment[G_ELEMENTS]), f32_at(segment[G_VERTICES])
    for k in range(min(span + 2 * vec.LANES, last_span), min(span + 3 * vec.LANES, last_span)):
        element = 3 * (np.int64(records[k]) - first)
        for corner in range(3):
            vec.prefetch(vertices, np.int64(elements[element + corner]) * V_COLUMNS)
    for k in range(min(span + 4 * vec.LANES, last_span), min(span + 5 * vec.LANES, last_span)):
        vec.prefetch(elements, 3 * (np.int64(records[k]) - first))


@device_function
def set_up_spans(segment, span, last_span, end_span):
    """Fill the rows T_ for the spans ``span .. last_span``, at most PART.

    Args:
        end_span: end of the segment.

    Returns:
        True if the normal is constant along each of them.
    """
    constant = True
    many = segment[G_TOPOLOGY] == 3 and end_span - span > 4 * vec.LANES
    for batch in range(span, last_span, vec.LANES):
        if many:
            _prefetch(segment, batch, end_span)
        count = min(last_span - batch, vec.LANES)
        constant = _set_up_eight(segment, batch, count, batch - span) and constant
    return constant


@inlined
def _starts_after(masks, x):
    """Bits of the eight pixels after pixel ``x`` at which a span begins."""
    word, bit = (x + 1) >> 6, (x + 1) & 63
    low = np.uint64(masks[word]) >> np.uint64(bit)
    return np.int64((low | ((np.uint64(masks[word + 1]) << np.uint64(63 - bit)) << np.uint64(1))) & np.uint64(255))


@inlined
def _pick(spans, row, at, lanes):
    return vec.permute(vec.load(spans, row * SPAN_ROOM + at), lanes)


@inlined
def _line(spans, row, count, at, lanes, t):
    """A value of eight pixels that is linear along their spans; its change is ``count`` rows further."""
    return _pick(spans, row, at, lanes) + _pick(spans, row + count, at, lanes) * t


@device_function
def _clear(pixels, row, rows, begin, end):
    """Fill rows with zeros."""
    for k in range(row, row + rows):
        for x in range(begin, end, vec.LANES):
            vec.store(pixels, k * STRIDE + x, vec.f32(0.0))


@device_function
def interpolate(segment, begin, end, to):
    """Fill the rows A_ from value ``to`` on with the attributes of the pixels ``begin .. end``, after ``set_up_spans``.

    Up to seven further values are overwritten. Texture coordinates that the mesh lacks, and their gradients, become 0.
    """
    spans, pixels = f32_at(segment[G_SPANS]), f32_at(segment[G_PIXELS])
    masks, has, columns = i64_at(segment[G_MASKS]), segment[G_HAS], segment[G_COLUMNS]
    lane_tables = i32_at(segment[G_LANES])
    at = np.int64(0)
    for x in range(begin, end, vec.LANES):
        to_x = to + x - begin
        starts = _starts_after(masks, x)
        lanes = vec.load(lane_tables, vec.LANES * (starts & 127))
        column = vec.i32(x) + vec.iota()
        if columns != 0:
            column = vec.load(i32_at(columns), x)
        t = vec.to_f32(column) - _pick(spans, T_BEGIN, at, lanes)
        nx, ny, nz = (
            _line(spans, T_NORMAL, 3, at, lanes, t),
            _line(spans, T_NORMAL + 1, 3, at, lanes, t),
            _line(spans, T_NORMAL + 2, 3, at, lanes, t),
        )
        vec.store(pixels, A_NORMAL * STRIDE + to_x, nx)
        vec.store(pixels, (A_NORMAL + 1) * STRIDE + to_x, ny)
        vec.store(pixels, (A_NORMAL + 2) * STRIDE + to_x, nz)
        if has & (HAS_UV0 | HAS_COLORS | HAS_UV1 | HAS_TANGENTS):
            share = vec.f32(1.0) / _line(spans, T_TOTAL, 1, at, lanes, t)
            if has & HAS_UV0:
                for j in range(2):
                    vec.store(pixels, (A_UV0 + j) * STRIDE + to_x, _line(spans, T_UV0 + j, 2, at, lanes, t) * share)
            if has & HAS_UV1:
                for j in range(2):
                    vec.store(pixels, (A_UV1 + j) * STRIDE + to_x, _line(spans, T_UV1 + j, 2, at, lanes, t) * share)
            if has & HAS_COLORS:
                for j in range(4):
                    vec.store(pixels, (A_COLOR + j) * STRIDE + to_x, _line(spans, T_COLOR + j, 4, at, lanes, t) * share)
            if has & HAS_TANGENTS:
                vec.store(pixels, A_FACING * STRIDE + to_x, _pick(spans, T_FACING, at, lanes))
                for j in range(4):
                    vec.store(pixels, (A_TANGENT + j) * STRIDE + to_x, _line(spans, T_TANGENT + j, 4, at, lanes, t))
        at += vec.count_bits(starts)
    for which in range(2):
        if not has & (HAS_UV0 << which):
            _clear(pixels, A_UV0 + 2 * which, 2, to, to + end - begin)
            if segment[G_SURFACE] != 0:
                _clear(pixels, A_GRADIENT0 + 4 * which, 4, to, to + end - begin)
    if segment[G_SURFACE] != 0:
        _interpolate_surface(segment, begin, end, to)


@inlined
def _gradient(spans, pixels, row, uv, gradient, at, lanes, share, to_x):
    """Derivatives of two texture coordinates by column and row of the image.

    With u = U / T and both linear over the image, du/dx = (dU/dx - u dT/dx) / T.
    """
    for k in range(2):
        total = _pick(spans, T_TOTAL_GRADIENT + k, at, lanes)
        for j in range(2):
            value = vec.load(pixels, (uv + j) * STRIDE + to_x)
            slope = (_pick(spans, row + 2 * k + j, at, lanes) - value * total) * share
            vec.store(pixels, (gradient + 2 * k + j) * STRIDE + to_x, slope)


@device_function
def _interpolate_surface(segment, begin, end, to):
    """Fill the rows from A_GRADIENT0 to A_POINT after those before them."""
    spans, pixels, lens = f32_at(segment[G_SPANS]), f32_at(segment[G_PIXELS]), f64_at(segment[G_LENS])
    masks, has, columns = i64_at(segment[G_MASKS]), segment[G_HAS], segment[G_COLUMNS]
    lane_tables = i32_at(segment[G_LANES])
    left, across = vec.f32(0.5 - lens[2]), vec.f32(1.0 / lens[0])
    dy = vec.f32((segment[G_Y] + 0.5 - lens[3]) / lens[1])
    at = np.int64(0)
    for x in range(begin, end, vec.LANES):
        to_x = to + x - begin
        starts = _starts_after(masks, x)
        lanes = vec.load(lane_tables, vec.LANES * (starts & 127))
        column = vec.i32(x) + vec.iota()
        if columns != 0:
            column = vec.load(i32_at(columns), x)
        t = vec.to_f32(column) - _pick(spans, T_BEGIN, at, lanes)
        share = vec.f32(1.0) / _line(spans, T_TOTAL, 1, at, lanes, t)
        z = _pick(spans, T_DEPTH, at, lanes) * share
        vec.store(pixels, A_POINT * STRIDE + to_x, (vec.to_f32(column) + left) * across * z)
        vec.store(pixels, (A_POINT + 1) * STRIDE + to_x, dy * z)
        vec.store(pixels, (A_POINT + 2) * STRIDE + to_x, z)
        for j in range(3):
            vec.store(pixels, (A_FLAT + j) * STRIDE + to_x, _pick(spans, T_FLAT + j, at, lanes))
        if has & HAS_UV0:
            _gradient(spans, pixels, T_UV0_GRADIENT, A_UV0, A_GRADIENT0, at, lanes, share, to_x)
        if has & HAS_UV1:
            _gradient(spans, pixels, T_UV1_GRADIENT, A_UV1, A_GRADIENT1, at, lanes, share, to_x)
        at += vec.count_bits(starts)
