"""From a run of pixels that see one element to interpolated attributes along the run."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

from renderers.shading.memory import load_f32, load_u32
from renderers.shading.scene import (
    II_COLORS,
    II_ELEMENTS,
    II_NORMALS,
    II_POSITIONS,
    II_TANGENTS,
    II_TOPOLOGY,
    II_UV0,
)

# Rows of the scratch array (A_ROWS, W) float32: one attribute each, one column per pixel.
A_NORMAL: Final = 0  # 3 rows: normal in the optical frame, turned to the side that is seen, any length
A_UV0: Final = 3  # 2 rows
A_UV1: Final = 5  # 2 rows
A_COLOR: Final = 7  # 4 rows: linear RGBA
A_TANGENT: Final = 11  # 4 rows: tangent in the optical frame, any length; sign of the bitangent
A_FACING: Final = 15  # 1 row: -1 where a back face is seen
A_BASE: Final = 16  # 4 rows: base colour and alpha, filled by shading
A_ROWS: Final = 20


@njit(nogil=True, cache=True, fastmath=False)
def _vertex(positions, index, X):  # type: ignore[no-untyped-def]
    """A vertex in the optical frame, float64."""
    x = np.float64(load_f32(positions, index * 3))
    y = np.float64(load_f32(positions, index * 3 + 1))
    z = np.float64(load_f32(positions, index * 3 + 2))
    return (
        X[0, 0] * x + X[0, 1] * y + X[0, 2] * z + X[0, 3],
        X[1, 0] * x + X[1, 1] * y + X[1, 2] * z + X[1, 3],
        X[2, 0] * x + X[2, 1] * y + X[2, 2] * z + X[2, 3],
    )


@njit(nogil=True, cache=True, fastmath=False)
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(nogil=True, cache=True, fastmath=False)
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(nogil=True, cache=True, fastmath=False)
def _triangle_weights(r0, r1, r2, side, fx, cx, dy, begin, end, weights):  # type: ignore[no-untyped-def]
    """Perspective-correct barycentric coordinates along a run: >= 0, sum 1.

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
            weights[0, x] = np.float32(b0 / total)
            weights[1, x] = np.float32(b1 / total)
            weights[2, x] = np.float32(b2 / total)
        else:
            weights[0, x] = weights[1, x] = weights[2, x] = np.float32(1.0 / 3.0)


@njit(nogil=True, cache=True, fastmath=False)
def _corner_values(address, stride, i0, i1, i2, corners):  # type: ignore[no-untyped-def]
    """Loads one attribute of three vertices into ``corners`` (3, 4) float32."""
    for k in range(stride):
        corners[0, k] = load_f32(address, i0 * stride + k)
        corners[1, k] = load_f32(address, i1 * stride + k)
        corners[2, k] = load_f32(address, i2 * stride + k)


@njit(nogil=True, cache=True, fastmath=False)
def _rotate_corners(corners, R):  # type: ignore[no-untyped-def]
    """Maps the first three values of every corner by a (3, 3) float64 matrix."""
    for c in range(3):
        x, y, z = np.float64(corners[c, 0]), np.float64(corners[c, 1]), np.float64(corners[c, 2])
        for k in range(3):
            corners[c, k] = np.float32(R[k, 0] * x + R[k, 1] * y + R[k, 2] * z)


@njit(nogil=True, cache=True, fastmath=False)
def _spread(corners, count, row, weights, begin, end, out):  # type: ignore[no-untyped-def]
    """Interpolates ``count`` values along the run into rows ``row ...`` of ``out``; equal corners stay exact."""
    for k in range(count):
        a = corners[0, k]
        b, c = corners[1, k] - a, corners[2, k] - a
        for x in range(begin, end):
            out[row + k, x] = a + (weights[1, x] * b + weights[2, x] * c)


@njit(nogil=True, cache=True, fastmath=False)
def resolve_run(instances, instance, element, uv_used, X, N, intrinsics, y, begin, end, weights, corners, out):  # type: ignore[no-untyped-def]
    """Interpolates what the material needs over pixels ``begin .. end - 1`` of row ``y``.

    Args:
        instances: table of ``ShadingScene``.
        instance, element: whose element the run sees.
        uv_used: bit 0 / 1: uv0 / uv1 is wanted.
        X: (4, 4) float64, mesh to optical frame. N: (3, 3) float64, map of normals.
        intrinsics: (4,) float64: fx, fy, cx, cy.
        weights: (3, W) float32, corners: (3, 4) float32: scratch.
        out: (A_ROWS, W) float32, see the A_ constants.
    """
    topology = instances[instance, II_TOPOLOGY]
    elements = instances[instance, II_ELEMENTS]
    positions = instances[instance, II_POSITIONS]
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    dy = (y + 0.5 - cy) / fy
    i0 = np.int64(load_u32(elements, element * topology))
    i1 = i2 = i0
    facing = np.float32(1.0)
    normals = instances[instance, II_NORMALS]
    if topology == 3:
        i1 = np.int64(load_u32(elements, element * 3 + 1))
        i2 = np.int64(load_u32(elements, element * 3 + 2))
        p0, p1, p2 = _vertex(positions, i0, X), _vertex(positions, i1, X), _vertex(positions, i2, X)
        # Rows of det(P) P^-1. The determinant is ((p1 - p0) x (p2 - p0)) . p0: negative where a counter-clockwise
        # element is seen from its front. A mirroring X turns that round.
        r0, r1, r2 = _cross(p1, p2), _cross(p2, p0), _cross(p0, p1)
        determinant = _dot(p0, r0)
        side = -1.0 if determinant < 0.0 else 1.0
        mirrored = _dot((X[0, 0], X[1, 0], X[2, 0]), _cross((X[0, 1], X[1, 1], X[2, 1]), (X[0, 2], X[1, 2], X[2, 2])))
        if (determinant > 0.0) != (mirrored < 0.0):
            facing = np.float32(-1.0)
        _triangle_weights(r0, r1, r2, side, fx, cx, dy, begin, end, weights)
        if normals != 0:
            _corner_values(normals, 3, i0, i1, i2, corners)
            _rotate_corners(corners, N)
        else:
            # Towards the camera is against sign(det(P)); the multiplication by ``facing`` below is undone here.
            _flat_normal(p0, p1, p2, -side * facing, corners)
    else:
        facing = np.float32(1.0)
        if topology == 2:
            i1 = np.int64(load_u32(elements, element * 2 + 1))
        _line_weights(_vertex(positions, i0, X), _vertex(positions, i1, X), fx, cx, dy, begin, end, weights)
        for c in range(3):  # not lit; the normal output gets the direction to the camera
            corners[c, 0] = corners[c, 1] = np.float32(0.0)
            corners[c, 2] = np.float32(-1.0)
    for c in range(3):
        for k in range(3):
            corners[c, k] *= facing
    _spread(corners, 3, A_NORMAL, weights, begin, end, out)
    for x in range(begin, end):
        out[A_FACING, x] = facing
    _resolve_rest(instances, instance, uv_used, i0, i1, i2, X, begin, end, weights, corners, out)


@njit(nogil=True, cache=True, fastmath=False)
def _resolve_rest(instances, instance, uv_used, i0, i1, i2, X, begin, end, weights, corners, out):  # type: ignore[no-untyped-def]
    """Texture coordinates, colours and tangents: those that are there; missing coordinates read as 0."""
    for which in range(2):
        if uv_used & (1 << which):
            uv = instances[instance, II_UV0 + which]
            if uv != 0:
                _corner_values(uv, 2, i0, i1, i2, corners)
            else:
                corners[:] = np.float32(0.0)
            _spread(corners, 2, A_UV0 + 2 * which, weights, begin, end, out)
    if instances[instance, II_COLORS] != 0:
        _corner_values(instances[instance, II_COLORS], 4, i0, i1, i2, corners)
        _spread(corners, 4, A_COLOR, weights, begin, end, out)
    if instances[instance, II_TANGENTS] != 0:
        _corner_values(instances[instance, II_TANGENTS], 4, i0, i1, i2, corners)
        _rotate_corners(corners, X)
        mirrored = _dot((X[0, 0], X[1, 0], X[2, 0]), _cross((X[0, 1], X[1, 1], X[2, 1]), (X[0, 2], X[1, 2], X[2, 2])))
        if mirrored < 0.0:  # a mirror image of the surface: its bitangent is the mirrored one
            for c in range(3):
                corners[c, 3] = -corners[c, 3]
        _spread(corners, 4, A_TANGENT, weights, begin, end, out)


@njit(nogil=True, cache=True, fastmath=False)
def _flat_normal(p0, p1, p2, sign, corners):  # type: ignore[no-untyped-def]
    """The triangle's own normal to all corners: unit length, (p1 - p0) x (p2 - p0) times ``sign``."""
    n = _cross((p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]), (p2[0] - p0[0], p2[1] - p0[1], p2[2] - p0[2]))
    length = math.sqrt(_dot(n, n))
    usable = length > 0.0 and length < math.inf
    for c in range(3):
        for k in range(3):
            corners[c, k] = np.float32(sign * n[k] / length) if usable else np.float32(0.0)


@njit(nogil=True, cache=True, fastmath=False)
def _line_weights(p, q, fx, cx, dy, begin, end, weights):  # type: ignore[no-untyped-def]
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
