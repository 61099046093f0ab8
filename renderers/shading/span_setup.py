"""Set-up of spans: weighted sums of the vertices' attributes at the first pixel of a span, and their change per pixel.

The unnormalised barycentric coordinates ``b = det(P) P^-1 d`` of a pixel's ray ``d`` are linear along a row; the
columns of ``P`` are the vertices in the optical frame. Sums are computed in float64 for eight spans at a time.
"""

from __future__ import annotations

import math

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import i32_at
from renderers.shading.layout import (
    E_COLOR,
    E_COLUMNS,
    E_TANGENT,
    E_UV1,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UV0,
    HAS_UV1,
    SPAN_STRIDE,
    V_COLUMNS,
    V_NORMAL,
    V_UV0,
)
from renderers.shading.vec3 import cross, dot, minus, times, transform_directions, transform_points


@inlined
def _indices(segment, element):
    """Vertices of eight primitives, i32x8 each; those of lines and points repeat the last one."""
    elements = segment.instance.indices
    if segment.instance.topology == 3:
        return vec.load_elements(elements, element * vec.i32(3))
    if segment.instance.topology == 2:
        second = vec.gather(elements, element + element + vec.i32(1))
        return vec.gather(elements, element + element), second, second
    only = vec.gather(elements, element)
    return only, only, only


@inlined
def _line_weights(p, q):
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
def _dot_ray(row, dx, dy):
    return row[0] * dx + row[1] * dy + row[2]


@inlined
def _weighted_sum(w, a, b, c):
    return w[0] * a + w[1] * b + w[2] * c


@inlined
def _weighted_sum3(w, a, b, c, k):
    return (
        _weighted_sum(w, a[k], b[k], c[k]),
        _weighted_sum(w, a[k + 1], b[k + 1], c[k + 1]),
        _weighted_sum(w, a[k + 2], b[k + 2], c[k + 2]),
    )


@inlined
def _store_weighted_sums(spans, row, count, at, here, step, a, b, c, k):
    """Store ``count`` attributes of the corners from value ``k`` on, weighted by ``here``, then by ``step``."""
    for j in range(count):
        vec.store(spans, (row + j) * SPAN_STRIDE + at, _weighted_sum(here, a[k + j], b[k + j], c[k + j]))
        vec.store(spans, (row + count + j) * SPAN_STRIDE + at, _weighted_sum(step, a[k + j], b[k + j], c[k + j]))


@inlined
def _store3(spans, row, at, values):
    vec.store(spans, row * SPAN_STRIDE + at, values[0])
    vec.store(spans, (row + 1) * SPAN_STRIDE + at, values[1])
    vec.store(spans, (row + 2) * SPAN_STRIDE + at, values[2])


@inlined
def _to_f32x3(w):
    return vec.to_f32(w[0]), vec.to_f32(w[1]), vec.to_f32(w[2])


@device_function
def _set_up_eight(segment, span, count, at):
    """Fill eight values of the rows T_ from ``at`` on, of the spans ``span .. span + count``.

    Returns:
        True if the normal is constant along each of them.
    """
    m, maps, job = segment.X_camera_mesh, segment.matrices, segment.job
    spans, starts, has = segment.spans, segment.starts, segment.attributes
    vertices, y = segment.instance.vertices, segment.y
    # Lanes beyond the last span repeat it: their records belong to other instances.
    lane = vec.minimum(vec.iota(), vec.i32(count - 1))
    record = vec.permute(vec.load(segment.ids, span), lane)
    first = vec.permute(vec.load(starts, span), lane)
    steps = vec.to_f64(vec.permute(vec.load(starts, span + 1), lane) - first - vec.i32(1))
    if segment.columns != 0:
        first = vec.gather(i32_at(segment.columns), first)
    i0, i1, i2 = _indices(segment, record - vec.i32(segment.first_id))
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
    if segment.instance.topology != 3:
        rows = _line_weights(p0, p1)
        determinant = rows[0][2] + rows[1][2]
    side = vec.select(determinant < none, none - one, one)
    across, down = vec.f64(1.0 / job.fx), vec.f64(1.0 / job.fy)
    dx, dy = (vec.to_f64(first) + vec.f64(0.5 - job.cx)) * across, vec.f64(y + 0.5 - job.cy) * down
    if segment.instance.topology != 3:  # the sum of the weights is positive where the line is seen
        side = vec.select(_dot_ray(rows[0], dx, dy) + _dot_ray(rows[1], dx, dy) < none, none - one, one)
    # Coverage, exact in 1/256 pixel, may include pixel centres a little outside of the triangle. Negative coordinates
    # at the ends of a span become 0: nothing is extrapolated.
    end = dx + steps * across
    b0, e0 = vec.maximum(side * _dot_ray(rows[0], dx, dy), none), vec.maximum(side * _dot_ray(rows[0], end, dy), none)
    b1, e1 = vec.maximum(side * _dot_ray(rows[1], dx, dy), none), vec.maximum(side * _dot_ray(rows[1], end, dy), none)
    b2, e2 = vec.maximum(side * _dot_ray(rows[2], dx, dy), none), vec.maximum(side * _dot_ray(rows[2], end, dy), none)
    total, last = b0 + b1 + b2, e0 + e1 + e2
    infinite = vec.f64(math.inf)
    usable = (total > none) & (total < infinite) & (last > none) & (last < infinite)
    # Any positive factor will do: with the sum 1 at the first pixel, float32 has all that is needed.
    scale = vec.select(usable, one / total, none)
    step = scale / vec.maximum(steps, one)
    third = vec.f64(1.0 / 3.0)  # the centroid of what cannot be resolved
    here = _to_f32x3(
        (
            vec.select(usable, b0 * scale, third),
            vec.select(usable, b1 * scale, third),
            vec.select(usable, b2 * scale, third),
        )
    )
    change = _to_f32x3(
        (
            vec.select(usable, (e0 - b0) * step, none),
            vec.select(usable, (e1 - b1) * step, none),
            vec.select(usable, (e2 - b2) * step, none),
        )
    )
    mirror = vec.f32(maps.mirror)
    facing = vec.select(determinant > none, -mirror, mirror)
    vec.store(spans.begin, at, vec.to_f32(first))
    vec.store(spans.facing, at, facing)
    vec.store(spans.total, at, here[0] + here[1] + here[2])
    vec.store(spans.total, SPAN_STRIDE + at, change[0] + change[1] + change[2])
    zero, k, constant = vec.f32(0.0), V_NORMAL, True
    if has & HAS_NORMALS:
        same = (a[k] == b[k]) & (a[k + 1] == b[k + 1]) & (a[k + 2] == b[k + 2])
        same = same & (a[k] == c[k]) & (a[k + 1] == c[k + 1]) & (a[k + 2] == c[k + 2])
        constant = vec.movemask(same) == 255
        normal, turn = (a[k], a[k + 1], a[k + 2]), (zero, zero, zero)
        if not constant:
            normal, turn = _weighted_sum3(here, a, b, c, k), _weighted_sum3(change, a, b, c, k)
        _store3(spans.normal, 0, at, times(transform_directions(maps.normal, normal), facing))
        _store3(spans.normal, 3, at, times(transform_directions(maps.normal, turn), facing))
    if not has & HAS_NORMALS or segment.material.has_surface != 0:
        flat = cross(minus(p1, p0), minus(p2, p0))
        length = vec.sqrt(dot(flat, flat))
        usable_normal = (length > none) & (length < infinite)
        # Against the sign of the determinant: towards the camera.
        towards = vec.select(usable_normal, (none - side) / vec.select(usable_normal, length, one), none)
        flat_normal = _to_f32x3(times(flat, towards))
        if not has & HAS_NORMALS:
            _store3(spans.normal, 0, at, flat_normal)
            _store3(spans.normal, 3, at, (zero, zero, zero))
        _store3(spans.flat_normal, 0, at, flat_normal)
    if has & HAS_UV0:
        _store_weighted_sums(spans.uv, 0, 2, at, here, change, a, b, c, V_UV0)
    right = lower = here
    if segment.material.has_surface != 0:
        vec.store(spans.depth, at, vec.to_f32(vec.absolute(determinant) * scale))
    if segment.material.has_gradients != 0:
        # Not ``change``: spans of a single pixel have gradients, too.
        dx, dy = scale * side * across, scale * side * down
        right = _to_f32x3((rows[0][0] * dx, rows[1][0] * dx, rows[2][0] * dx))
        lower = _to_f32x3((rows[0][1] * dy, rows[1][1] * dy, rows[2][1] * dy))
        vec.store(spans.total_gradient, at, right[0] + right[1] + right[2])
        vec.store(spans.total_gradient, SPAN_STRIDE + at, lower[0] + lower[1] + lower[2])
        if has & HAS_UV0:
            _store_weighted_sums(spans.uv_gradient, 0, 2, at, right, lower, a, b, c, V_UV0)
    if has & (HAS_COLORS | HAS_UV1 | HAS_TANGENTS):
        extras, wide = segment.instance.extras, vec.i32(E_COLUMNS)
        d = vec.load_octets(extras, i0 * wide)
        e = vec.load_octets(extras, i1 * wide)
        f = vec.load_octets(extras, i2 * wide)
        if has & HAS_COLORS:
            _store_weighted_sums(spans.color, 0, 4, at, here, change, d, e, f, E_COLOR)
        if has & HAS_UV1:
            _store_weighted_sums(spans.uv, 4, 2, at, here, change, d, e, f, E_UV1)
            if segment.material.has_gradients != 0:
                _store_weighted_sums(spans.uv_gradient, 4, 2, at, right, lower, d, e, f, E_UV1)
        if has & HAS_TANGENTS:
            tangents = vec.i32(E_TANGENT)
            d = vec.load_octets(extras, i0 * wide + tangents)
            e = vec.load_octets(extras, i1 * wide + tangents)
            f = vec.load_octets(extras, i2 * wide + tangents)
            along = transform_directions(maps.tangent, _weighted_sum3(here, d, e, f, 0))
            turn = transform_directions(maps.tangent, _weighted_sum3(change, d, e, f, 0))
            _store3(spans.tangent, 0, at, along)
            vec.store(spans.tangent, 3 * SPAN_STRIDE + at, _weighted_sum(here, d[3], e[3], f[3]))
            _store3(spans.tangent, 4, at, turn)
            vec.store(spans.tangent, 7 * SPAN_STRIDE + at, _weighted_sum(change, d[3], e[3], f[3]))
    return constant


@inlined
def _prefetch(segment, span, last_span):
    """Prefetch what ``_set_up_eight`` reads of the spans two batches ahead, and the indices four batches ahead.

    Meshes of many triangles fill no cache: without this, frames of a million triangles take a fifth longer.

    Args:
        last_span: end of the segment.
    """
    records, first = segment.ids, segment.first_id
    elements, vertices = segment.instance.indices, segment.instance.vertices
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
    many = segment.instance.topology == 3 and end_span - span > 4 * vec.LANES
    for batch in range(span, last_span, vec.LANES):
        if many:
            _prefetch(segment, batch, end_span)
        count = min(last_span - batch, vec.LANES)
        constant = _set_up_eight(segment, batch, count, batch - span) and constant
    return constant
