"""From visible elements and pixels to the points that are seen, eight lanes at a time, each with its own element."""

from __future__ import annotations

import math

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner


@inlined
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def reach(a, to):
    """f32x8: what makes vectors ``to`` long; 0 for what has no direction."""
    length = vec.sqrt(dot(a, a))
    usable = (length > vec.f32(0.0)) & (length < vec.f32(math.inf))
    return vec.select(usable, to / length, vec.f32(0.0))


@inlined
def moved(X, p):
    """Points (f32x8) by a (4, 4) matrix (a pointer), f64x8."""
    x, y, z = vec.to_f64(p[0]), vec.to_f64(p[1]), vec.to_f64(p[2])
    return (
        vec.f64(X[0]) * x + vec.f64(X[1]) * y + vec.f64(X[2]) * z + vec.f64(X[3]),
        vec.f64(X[4]) * x + vec.f64(X[5]) * y + vec.f64(X[6]) * z + vec.f64(X[7]),
        vec.f64(X[8]) * x + vec.f64(X[9]) * y + vec.f64(X[10]) * z + vec.f64(X[11]),
    )


@inlined
def turned(X, stride, p):
    """Directions (f32x8) by the linear part of a matrix whose rows are ``stride`` values long."""
    return (
        vec.f32(X[0]) * p[0] + vec.f32(X[1]) * p[1] + vec.f32(X[2]) * p[2],
        vec.f32(X[stride]) * p[0] + vec.f32(X[stride + 1]) * p[1] + vec.f32(X[stride + 2]) * p[2],
        vec.f32(X[2 * stride]) * p[0] + vec.f32(X[2 * stride + 1]) * p[1] + vec.f32(X[2 * stride + 2]) * p[2],
    )


@inlined
def single(a):
    """Vectors as float32."""
    return vec.to_f32(a[0]), vec.to_f32(a[1]), vec.to_f32(a[2])


@inlined
def coordinates(p0, p1, p2, dx, dy):
    """Where rays (dx, dy, 1) meet the planes of triangles.

    Args:
        p0, p1, p2: corners in the optical frame, dx, dy: f64x8.

    Returns:
        Perspective-correct barycentric coordinates, three f32x8, nothing is extrapolated; their derivatives by dx and
        by dy but for the share that is common to all three, three f32x8 each; and f64x8 the determinant of the corners.
    """
    none, one, third = vec.f64(0.0), vec.f64(1.0), vec.f64(1.0 / 3.0)
    r0, r1, r2 = cross(p1, p2), cross(p2, p0), cross(p0, p1)
    determinant = dot(p0, r0)
    side = vec.select(determinant < none, vec.f64(-1.0), one)
    a = vec.most(side * (r0[0] * dx + r0[1] * dy + r0[2]), none)
    b = vec.most(side * (r1[0] * dx + r1[1] * dy + r1[2]), none)
    c = vec.most(side * (r2[0] * dx + r2[1] * dy + r2[2]), none)
    total = a + b + c
    usable = (total > none) & (total < vec.f64(math.inf))
    share = vec.select(usable, one / total, none)
    w = (
        vec.to_f32(vec.select(usable, a * share, third)),
        vec.to_f32(vec.select(usable, b * share, third)),
        vec.to_f32(vec.select(usable, c * share, third)),
    )
    share = share * side
    sx = vec.to_f32(r0[0] * share), vec.to_f32(r1[0] * share), vec.to_f32(r2[0] * share)
    sy = vec.to_f32(r0[1] * share), vec.to_f32(r1[1] * share), vec.to_f32(r2[1] * share)
    return w, sx, sy, determinant


@inlined
def along_line(p, q, dx, dy):
    """Share of the second end (f32x8) where segments pass rays (dx, dy, 1) nearest, 0 .. 1.

    With e = q - p all points p + t e project onto one line of the image with the direction s = e.xy p.z - p.xy e.z;
    the projection's component along s is to be the ray's, which is linear in t.
    """
    none, one = vec.f64(0.0), vec.f64(1.0)
    ex, ey, ez = minus(q, p)
    sx, sy = ex * p[2] - p[0] * ez, ey * p[2] - p[1] * ez
    along = sx * dx + sy * dy
    t = (along * p[2] - (p[0] * sx + p[1] * sy)) / (ex * sx + ey * sy - along * ez)
    t = vec.select(vec.absolute(t) < vec.f64(math.inf), t, none)
    return vec.to_f32(vec.least(vec.most(t, none), one))


@inlined
def mixed(w, a, b, c):
    """An attribute between three corners."""
    return w[0] * a + w[1] * b + w[2] * c


@inlined
def sloped(s, value, a, b, c):
    """The derivative of an attribute that is ``value`` here; ``s``: of ``coordinates``.

    With u = sum(b_i u_i) / sum(b_i) and b_i linear over the image, du/dx = sum(b_i' (u_i - u)) / sum(b_i).
    """
    return s[0] * (a - value) + s[1] * (b - value) + s[2] * (c - value)


@inner
def mirrors(X):
    """-1 where a (4, 4) matrix (a pointer) mirrors, else 1."""
    determinant = dot((X[0], X[1], X[2]), cross((X[4], X[5], X[6]), (X[8], X[9], X[10])))
    return np.float32(-1.0) if determinant < 0.0 else np.float32(1.0)
