"""Attributes interpolated along a span of pixels that see one primitive."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from renderers.compiler.pointers import f32_at

# Rows of the scratch array (A_ROWS, W) float32: one attribute each, one column per pixel.
A_NORMAL = 0  # 3 rows: normal in the optical frame, on the visible side, any length
A_UV0 = 3  # 2 rows
A_UV1 = 5  # 2 rows
A_COLOR = 7  # 4 rows: linear RGBA
A_TANGENT = 11  # 4 rows: tangent in the optical frame, any length; sign of the bitangent
A_FACING = 15  # -1 where a back face is visible
A_BASE = 16  # 4 rows: base colour and alpha, filled by shading
A_ROWS = 20


@njit(nogil=True, error_model="numpy")
def _vertex(positions, index, X):
    """A vertex in the optical frame, float64."""
    x = np.float64(positions[index * 3])
    y = np.float64(positions[index * 3 + 1])
    z = np.float64(positions[index * 3 + 2])
    return (
        X[0, 0] * x + X[0, 1] * y + X[0, 2] * z + X[0, 3],
        X[1, 0] * x + X[1, 1] * y + X[1, 2] * z + X[1, 3],
        X[2, 0] * x + X[2, 1] * y + X[2, 2] * z + X[2, 3],
    )


@njit(nogil=True, error_model="numpy")
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(nogil=True, error_model="numpy")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(nogil=True, error_model="numpy")
def _triangle_weights(r0, r1, r2, side, fx, cx, dy, begin, end, weights):
    """Perspective-correct barycentric coordinates along a span: >= 0, sum 1.

    A pixel centre that coverage (exact in 1/256 pixel) counts in may lie a little outside of the unrounded triangle:
    negative coordinates become 0, so nothing is extrapolated. Anything not finite becomes the centroid.

    Args:
        r0, r1, r2: rows of det(P) P^-1. side: sign of det(P).
    """
    dx = (0.5 - cx) / fx
    a0, a1, a2 = (
        side * (r0[0] * dx + r0[1] * dy + r0[2]),
        side * (r1[0] * dx + r1[1] * dy + r1[2]),
        side * (r2[0] * dx + r2[1] * dy + r2[2]),
    )
    s0, s1, s2 = side * r0[0] / fx, side * r1[0] / fx, side * r2[0] / fx
    for x in range(begin, end):
        b0, b1, b2 = max(a0 + s0 * x, 0.0), max(a1 + s1 * x, 0.0), max(a2 + s2 * x, 0.0)
        total = b0 + b1 + b2
        if total > 0.0 and total < math.inf:
            share = 1.0 / total
            weights[0, x] = np.float32(b0 * share)
            weights[1, x] = np.float32(b1 * share)
            weights[2, x] = np.float32(b2 * share)
        else:
            weights[0, x] = weights[1, x] = weights[2, x] = np.float32(1.0 / 3.0)


@njit(nogil=True, error_model="numpy")
def _load3(address, stride, index):
    """The first three values of a vertex attribute of ``stride`` values, float32."""
    at = index * stride
    return f32_at(address)[at], f32_at(address)[at + 1], f32_at(address)[at + 2]


@njit(nogil=True, error_model="numpy")
def _transformed(R, sign, v):
    """``sign R v`` with a (3, 3) or (4, 4) float64 matrix, rounded to float32."""
    x, y, z = np.float64(v[0]), np.float64(v[1]), np.float64(v[2])
    return (
        np.float32(sign * (R[0, 0] * x + R[0, 1] * y + R[0, 2] * z)),
        np.float32(sign * (R[1, 0] * x + R[1, 1] * y + R[1, 2] * z)),
        np.float32(sign * (R[2, 0] * x + R[2, 1] * y + R[2, 2] * z)),
    )


@njit(nogil=True, error_model="numpy")
def _interpolate1(a, b, c, weights, begin, end, row, out):
    """Interpolate one value along the span into a row of ``out``; equal corners stay exact."""
    b -= a
    c -= a
    for x in range(begin, end):
        out[row, x] = a + (weights[1, x] * b + weights[2, x] * c)


@njit(nogil=True, error_model="numpy")
def _interpolate3(a, b, c, weights, begin, end, row, out):
    """As ``_interpolate1`` for three values, into three rows."""
    b0, b1, b2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    c0, c1, c2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    for x in range(begin, end):
        w1, w2 = weights[1, x], weights[2, x]
        out[row, x] = a[0] + (w1 * b0 + w2 * c0)
        out[row + 1, x] = a[1] + (w1 * b1 + w2 * c1)
        out[row + 2, x] = a[2] + (w1 * b2 + w2 * c2)


@njit(nogil=True, error_model="numpy")
def _interpolate_values(address, stride, i0, i1, i2, weights, begin, end, row, out):
    """Interpolate all values of an attribute."""
    for k in range(stride):
        _interpolate1(
            f32_at(address)[i0 * stride + k],
            f32_at(address)[i1 * stride + k],
            f32_at(address)[i2 * stride + k],
            weights,
            begin,
            end,
            row + k,
            out,
        )


@njit(nogil=True, error_model="numpy")
def interpolate_span(instance, primitive, mirrored, uv_sets, X, N, lens, y, begin, end, weights, out):
    """Interpolate the attributes that the material reads over the pixels ``begin .. end - 1`` of row ``y``.

    Args:
        instance: an INSTANCE.
        primitive: index of the primitive that the span sees.
        mirrored: True if X mirrors.
        uv_sets: as in MATERIAL.
        X: (4, 4) float64, mesh to optical frame. N: (3, 3) float64, matrix of normals.
        lens: (4,) float64: fx, fy, cx, cy.
        weights: (3, W) float32: scratch.
        out: (A_ROWS, W) float32, see the A_ constants.
    """
    topology, indices, positions = instance.topology, instance.indices, instance.positions
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    dy = (y + 0.5 - cy) / fy
    i0 = np.int64(indices[primitive * topology])
    i1 = i2 = i0
    if topology == 3:
        i1 = np.int64(indices[primitive * 3 + 1])
        i2 = np.int64(indices[primitive * 3 + 2])
        p0, p1, p2 = _vertex(positions, i0, X), _vertex(positions, i1, X), _vertex(positions, i2, X)
        # Rows of det(P) P^-1. The determinant is ((p1 - p0) x (p2 - p0)) . p0: negative where a counter-clockwise
        # triangle is seen from its front. A mirroring X turns that round.
        r0, r1, r2 = _cross(p1, p2), _cross(p2, p0), _cross(p0, p1)
        determinant = _dot(p0, r0)
        side = -1.0 if determinant < 0.0 else 1.0
        facing = -1.0 if (determinant > 0.0) != mirrored else 1.0
        _triangle_weights(r0, r1, r2, side, fx, cx, dy, begin, end, weights)
        normals = instance.normals
        if normals != 0:
            _interpolate3(
                _transformed(N, facing, _load3(normals, 3, i0)),
                _transformed(N, facing, _load3(normals, 3, i1)),
                _transformed(N, facing, _load3(normals, 3, i2)),
                weights,
                begin,
                end,
                A_NORMAL,
                out,
            )
        else:
            flat = _flat_normal(p0, p1, p2, -side)  # against the sign of the determinant: towards the camera
            _interpolate3(flat, flat, flat, weights, begin, end, A_NORMAL, out)
        for x in range(begin, end):
            out[A_FACING, x] = np.float32(facing)
    else:
        if topology == 2:
            i1 = np.int64(indices[primitive * 2 + 1])
        _line_weights(_vertex(positions, i0, X), _vertex(positions, i1, X), fx, cx, dy, begin, end, weights)
    for uv_set in range(2):
        if uv_sets & (1 << uv_set):
            uv = instance.uv1 if uv_set else instance.uv0
            row = A_UV0 + 2 * uv_set
            if uv != 0:
                _interpolate_values(uv, 2, i0, i1, i2, weights, begin, end, row, out)
            else:
                for x in range(begin, end):
                    out[row, x] = out[row + 1, x] = np.float32(0.0)
    if instance.colors != 0:
        _interpolate_values(instance.colors, 4, i0, i1, i2, weights, begin, end, A_COLOR, out)
    tangents = instance.tangents
    if tangents != 0:
        _interpolate3(
            _transformed(X, 1.0, _load3(tangents, 4, i0)),
            _transformed(X, 1.0, _load3(tangents, 4, i1)),
            _transformed(X, 1.0, _load3(tangents, 4, i2)),
            weights,
            begin,
            end,
            A_TANGENT,
            out,
        )
        hand = np.float32(-1.0 if mirrored else 1.0)  # the bitangent of a mirror image is the mirrored one
        _interpolate1(
            hand * f32_at(tangents)[i0 * 4 + 3],
            hand * f32_at(tangents)[i1 * 4 + 3],
            hand * f32_at(tangents)[i2 * 4 + 3],
            weights,
            begin,
            end,
            A_TANGENT + 3,
            out,
        )


@njit(nogil=True, error_model="numpy")
def _flat_normal(p0, p1, p2, sign):
    """The triangle's own normal: unit length, (p1 - p0) x (p2 - p0) times ``sign``; 0 without an area."""
    n = _cross((p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]), (p2[0] - p0[0], p2[1] - p0[1], p2[2] - p0[2]))
    length = math.sqrt(_dot(n, n))
    scale = sign / length if length > 0.0 and length < math.inf else 0.0
    return np.float32(scale * n[0]), np.float32(scale * n[1]), np.float32(scale * n[2])


@njit(nogil=True, error_model="numpy")
def _line_weights(p, q, fx, cx, dy, begin, end, weights):
    """Weights of the two ends at the point of the segment that projects nearest (along the line) to each pixel.

    With e = q - p, all points p + t e project onto one line of the image with the direction
    s = e.xy p.z - p.xy e.z; demanding that the projection's component along s equals the ray's gives a linear
    equation in t, also when an end lies behind the camera. A point (p = q) gets the whole weight at its vertex.
    """
    ex, ey, ez = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    sx, sy = ex * p[2] - p[0] * ez, ey * p[2] - p[1] * ez
    for x in range(begin, end):
        along = sx * ((x + 0.5 - cx) / fx) + sy * dy
        numerator = along * p[2] - (p[0] * sx + p[1] * sy)
        denominator = ex * sx + ey * sy - along * ez
        t = numerator / denominator if denominator != 0.0 else 0.0
        t = min(max(t, 0.0), 1.0) if math.isfinite(t) else 0.0
        weights[0, x] = np.float32(1.0 - t)
        weights[1, x] = np.float32(t)
        weights[2, x] = np.float32(0.0)
