"""From a visible element and a pixel to the point that is seen: attributes and their derivatives."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from renderers.pointers import f32_at, u32_at
from renderers.studio.tables import II_ELEMENTS, II_POSITIONS, II_TOPOLOGY


@njit(nogil=True, error_model="numpy")
def cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(nogil=True, error_model="numpy")
def dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(nogil=True, error_model="numpy")
def unit(a):  # type: ignore[no-untyped-def]
    """Unit length; 0 for what has no direction."""
    length = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    scale = 1.0 / length if length > 0.0 and length < math.inf else 0.0
    return a[0] * scale, a[1] * scale, a[2] * scale


@njit(nogil=True, error_model="numpy")
def moved(X, p):  # type: ignore[no-untyped-def]
    """A point by a (4, 4) matrix (a pointer)."""
    return (
        X[0] * p[0] + X[1] * p[1] + X[2] * p[2] + X[3],
        X[4] * p[0] + X[5] * p[1] + X[6] * p[2] + X[7],
        X[8] * p[0] + X[9] * p[1] + X[10] * p[2] + X[11],
    )


@njit(nogil=True, error_model="numpy")
def turned(X, stride, p):  # type: ignore[no-untyped-def]
    """A direction by the linear part of a matrix whose rows are ``stride`` values long."""
    return (
        X[0] * p[0] + X[1] * p[1] + X[2] * p[2],
        X[stride] * p[0] + X[stride + 1] * p[1] + X[stride + 2] * p[2],
        X[2 * stride] * p[0] + X[2 * stride + 1] * p[1] + X[2 * stride + 2] * p[2],
    )


@njit(nogil=True, error_model="numpy")
def three(values, index, stride):  # type: ignore[no-untyped-def]
    return (
        np.float64(values[index * stride]),
        np.float64(values[index * stride + 1]),
        np.float64(values[index * stride + 2]),
    )


@njit(nogil=True, error_model="numpy")
def corners(columns, element, X):  # type: ignore[no-untyped-def]
    """Vertices of an element, and where they are in the optical frame; lines and points repeat their last vertex."""
    topology = columns[II_TOPOLOGY]
    elements, positions = u32_at(columns[II_ELEMENTS]), f32_at(columns[II_POSITIONS])
    i0 = np.int64(elements[element * topology])
    i1 = np.int64(elements[element * topology + 1]) if topology > 1 else i0
    i2 = np.int64(elements[element * topology + 2]) if topology > 2 else i1
    return (
        i0,
        i1,
        i2,
        moved(X, three(positions, i0, 3)),
        moved(X, three(positions, i1, 3)),
        moved(X, three(positions, i2, 3)),
    )


@njit(nogil=True, error_model="numpy")
def inside(a, b, c):  # type: ignore[no-untyped-def]
    """Barycentric coordinates of any scale as >= 0 with sum 1: a sample or a rounded edge may let a pixel see a
    triangle that its centre lies beside; nothing is extrapolated."""
    a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
    total = a + b + c
    if total > 0.0 and total < math.inf:
        share = 1.0 / total
        return a * share, b * share, c * share
    return 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0


@njit(nogil=True, error_model="numpy")
def along_line(p, q, dx, dy):  # type: ignore[no-untyped-def]
    """Share of the second end where a segment passes a ray (dx, dy, 1) nearest, 0 .. 1.

    With e = q - p all points p + t e project onto one line of the image with the direction s = e.xy p.z - p.xy e.z;
    the projection's component along s is to be the ray's, which is linear in t.
    """
    ex, ey, ez = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    sx, sy = ex * p[2] - p[0] * ez, ey * p[2] - p[1] * ez
    along = sx * dx + sy * dy
    denominator = ex * sx + ey * sy - along * ez
    t = (along * p[2] - (p[0] * sx + p[1] * sy)) / denominator if denominator != 0.0 else 0.0
    return min(max(t, 0.0), 1.0) if math.isfinite(t) else 0.0


@njit(nogil=True, error_model="numpy")
def mixed(values, stride, k, i0, i1, i2, w0, w1, w2):  # type: ignore[no-untyped-def]
    """One value of an attribute between three vertices."""
    return values[i0 * stride + k] * w0 + values[i1 * stride + k] * w1 + values[i2 * stride + k] * w2
