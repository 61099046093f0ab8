"""The slow path: triangles and lines that cross the near plane or leave the guard band, clipped in camera space."""

from __future__ import annotations

import numpy as np

from renderers.compiler.device_function import inner
from renderers.compiler.pointers import f32_at, f64_at, i64_at, u32_at
from renderers.raster.layout import (
    GUARD,
    J_LENGTHS,
    J_TABLE,
    J_VERTEX,
    L_CX,
    L_CY,
    L_FX,
    L_FY,
    L_NEAR,
    M_COLUMNS,
    SUBPIXEL,
    T_COLUMNS,
    T_ELEMENTS,
    T_POSITIONS,
    T_VERTEX,
)

PLANES = 5
MAX_VERTICES = 24
"""A convex polygon has at most 3 + PLANES; each plane adds at most half, however rounding bends one: 3 * 1.5^5 < 24."""


@inner
def snap(value):
    """Grid units of a float32 pixel coordinate (the product is exact; ties to even)."""
    return np.int64(np.rint(np.float32(value) * np.float32(SUBPIXEL)))


@inner
def camera_vertex(job, drawn, index, out, k):
    """Write vertex ``index`` of a drawn instance's mesh, in the camera's frame, to the (n, 3) float64 ``out[k]``."""
    table = i64_at(job[J_TABLE])
    p = f32_at(table[drawn * T_COLUMNS + T_POSITIONS])
    m = f64_at(job[J_LENGTHS] + 8 * M_COLUMNS * drawn)
    x = np.float64(p[3 * index])
    y = np.float64(p[3 * index + 1])
    z = np.float64(p[3 * index + 2])
    for row in range(3):
        out[k, row] = m[4 * row] * x + m[4 * row + 1] * y + m[4 * row + 2] * z + m[4 * row + 3]


@inner
def plane_distance(lens, plane, p, k):
    """How far inside the near plane (0) or a side of the guard band (1 .. 4) the point ``p[k]`` is; >= 0 is inside."""
    if plane == 0:
        return p[k, 2] - lens[L_NEAR]
    if plane == 1:
        return lens[L_FX] * p[k, 0] + (GUARD + lens[L_CX]) * p[k, 2]
    if plane == 2:
        return (GUARD - lens[L_CX]) * p[k, 2] - lens[L_FX] * p[k, 0]
    if plane == 3:
        return lens[L_FY] * p[k, 1] + (GUARD + lens[L_CY]) * p[k, 2]
    return (GUARD - lens[L_CY]) * p[k, 2] - lens[L_FY] * p[k, 1]


@inner
def cut(p, inside, d_inside, outside, d_outside, out, k):
    """The point of the edge on the plane, from the inside end towards the outside end whichever way the triangle runs,
    so that two triangles with a common edge get the same point."""
    t = d_inside / (d_inside - d_outside)
    for row in range(3):
        out[k, row] = p[inside, row] + t * (p[outside, row] - p[inside, row])


@inner
def project(lens, p, k):
    """Pixel coordinates (float32) of the point ``p[k]``, which is not behind the near plane."""
    w = 1.0 / p[k, 2]
    return np.float32(lens[L_FX] * p[k, 0] * w + lens[L_CX]), np.float32(lens[L_FY] * p[k, 1] * w + lens[L_CY])


@inner
def is_finite(p, count):
    """Whether the first ``count`` points are numbers."""
    total = 0.0
    for k in range(count):
        total += abs(p[k, 0]) + abs(p[k, 1]) + abs(p[k, 2])
    return total < np.inf


@inner
def clip_triangle(job, lens, drawn, element, corners, grid):
    """The visible part of a triangle.

    Args:
        corners: (3, 3) float64, filled with the triangle's own vertices in the camera's frame.
        grid: (MAX_VERTICES, 2) int64, filled with the clipped polygon's vertices in grid units.

    Returns:
        Number of vertices of the polygon; 0: nothing is left.
    """
    table = i64_at(job[J_TABLE])
    indices = u32_at(table[drawn * T_COLUMNS + T_ELEMENTS] + 12 * element)
    points = np.empty((MAX_VERTICES, 3), np.float64)
    other = np.empty((MAX_VERTICES, 3), np.float64)
    source = np.empty(MAX_VERTICES, np.int64)
    other_source = np.empty(MAX_VERTICES, np.int64)
    for k in range(3):
        camera_vertex(job, drawn, np.int64(indices[k]), corners, k)
        source[k] = np.int64(indices[k])
        for row in range(3):
            points[k, row] = corners[k, row]
    if not is_finite(corners, 3):
        return 0
    count = 3
    for plane in range(PLANES):
        n = 0
        previous = count - 1
        d_previous = plane_distance(lens, plane, points, previous) if count > 0 else 0.0
        for k in range(count):
            d = plane_distance(lens, plane, points, k)
            if d >= 0.0 and d_previous < 0.0:
                cut(points, k, d, previous, d_previous, other, n)
                other_source[n] = -1
                n += 1
            if d < 0.0 and d_previous >= 0.0:
                cut(points, previous, d_previous, k, d, other, n)
                other_source[n] = -1
                n += 1
            if d >= 0.0:
                for row in range(3):
                    other[n, row] = points[k, row]
                other_source[n] = source[k]
                n += 1
            previous = k
            d_previous = d
        count = n
        points, other = other, points
        source, other_source = other_source, source
    if count < 3:
        return 0
    vertices = f32_at(job[J_VERTEX] + 16 * table[drawn * T_COLUMNS + T_VERTEX])
    for k in range(count):
        if source[k] >= 0:  # the very coordinates that the neighbours use
            x, y = vertices[4 * source[k]], vertices[4 * source[k] + 1]
        else:
            x, y = project(lens, points, k)
        grid[k, 0] = snap(x)
        grid[k, 1] = snap(y)
    return count


@inner
def clip_line(lens, ends):
    """Clip the segment between the two (2, 3) float64 ``ends`` in place; returns whether something is left."""
    if not is_finite(ends, 2):
        return False
    for plane in range(PLANES):
        d0 = plane_distance(lens, plane, ends, 0)
        d1 = plane_distance(lens, plane, ends, 1)
        if d0 < 0.0 and d1 < 0.0:
            return False
        if d1 < 0.0:
            cut(ends, 0, d0, 1, d1, ends, 1)
        elif d0 < 0.0:
            cut(ends, 1, d1, 0, d0, ends, 0)
    return True
