"""Setup of single primitives: lines, points, clipped triangles and triangles that are too large for the vector path.

Every function here fills a BINNED struct and returns its first and last bin, or (0, -1) when nothing is visible.
"""

from __future__ import annotations

import numpy as np
from numba import types

from renderers.compiler.device_function import device_function
from renderers.compiler.pointers import stack_array
from renderers.raster.clip import camera_vertex, clip_line, clip_triangle, corner_array, polygon_array, project, snap
from renderers.raster.layout import (
    CLIPPED_TRIANGLE,
    HALF,
    LINE,
    MAX_POINT,
    POINT,
    SUBPIXEL,
    TRIANGLE,
)
from renderers.raster.transform import BEHIND
from renderers.visibility_buffer import BAND_ROWS

_ends_array = stack_array(types.float64, 6)


@device_function
def first_center(value):
    """Return the first pixel whose centre is at or after a grid coordinate: ceil((value - 1/2 px) / 1 px)."""
    return (value - HALF + SUBPIXEL - 1) >> 8


@device_function
def bins_of(top, bottom, shift):
    """Return the first and last bin of the rows ``top .. bottom``."""
    return shift + top // BAND_ROWS, shift + (bottom - 1) // BAND_ROWS


@device_function
def large_triangle(frame, draw, index, primitive, out):
    """Set up a triangle in float64.

    Args:
        index: of the draw. primitive: index of the triangle in its mesh.
    """
    first = draw.first_vertex
    vertices = frame.vertices
    v0 = 4 * (first + np.int64(draw.indices[3 * primitive]))
    v1 = 4 * (first + np.int64(draw.indices[3 * primitive + 1]))
    v2 = 4 * (first + np.int64(draw.indices[3 * primitive + 2]))
    w0, w1, w2 = vertices[v0 + 2], vertices[v1 + 2], vertices[v2 + 2]
    high = max(w0, w1, w2)
    if high == BEHIND:
        return 0, -1
    low = min(w0, w1, w2)
    if low < 0.0:
        return clipped_triangle(frame, draw, index, primitive, out)
    if high < np.float32(1.0 / frame.far):
        return 0, -1
    x0, x1, x2 = snap(vertices[v0]), snap(vertices[v1]), snap(vertices[v2])
    y0, y1, y2 = snap(vertices[v0 + 1]), snap(vertices[v1 + 1]), snap(vertices[v2 + 1])
    reach = frame.sample_reach
    left = max(first_center(min(x0, x1, x2) - reach), 0)
    right = min(first_center(max(x0, x1, x2) + reach), frame.width)
    top = max(first_center(min(y0, y1, y2) - reach), 0)
    bottom = min(first_center(max(y0, y1, y2) + reach), frame.height)
    if left >= right or top >= bottom:
        return 0, -1
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0:
        return 0, -1
    if area * draw.hidden > 0:
        return 0, -1
    shift = 0
    if area * draw.culled > 0:
        shift = frame.bin_count - frame.band_count
        if shift == 0:
            return 0, -1
    if area < 0:
        v1, v2, w1, w2, x1, x2, y1, y2 = v2, v1, w2, w1, x2, x1, y2, y1
    xy = out.xy
    xy[0], xy[1], xy[2], xy[3], xy[4], xy[5] = x0, y0, x1, y1, x2, y2
    out.kind = TRIANGLE
    # 1/z is linear on screen: its plane goes through the vertices before snapping.
    fx0 = np.float64(vertices[v0])
    fy0 = np.float64(vertices[v0 + 1])
    dx1 = np.float64(vertices[v1]) - fx0
    dy1 = np.float64(vertices[v1 + 1]) - fy0
    dx2 = np.float64(vertices[v2]) - fx0
    dy2 = np.float64(vertices[v2 + 1]) - fy0
    dw1 = np.float64(w1) - np.float64(w0)
    dw2 = np.float64(w2) - np.float64(w0)
    determinant = dx1 * dy2 - dx2 * dy1
    slope_x = 0.0
    slope_y = 0.0
    if determinant != 0.0:
        slope_x = (dw1 * dy2 - dw2 * dy1) / determinant
        slope_y = (dw2 * dx1 - dw1 * dx2) / determinant
    box_x = np.float64(first_center(min(x0, x1, x2)))
    box_y = np.float64(first_center(min(y0, y1, y2)))
    out.dx = slope_x
    out.dy = slope_y
    out.base = np.float64(w0) + (slope_x * (box_x + 0.5 - fx0) + slope_y * (box_y + 0.5 - fy0))
    out.low = low
    out.high = high
    return bins_of(top, bottom, shift)


@device_function
def clipped_triangle(frame, draw, index, primitive, out):
    """Set up a triangle that needs clipping; arguments as for ``large_triangle``. Coverage clips it again per band."""
    corners, polygon = corner_array(), polygon_array()
    count = clip_triangle(frame, draw, primitive, corners, polygon)
    if count == 0:
        return 0, -1
    left, top = polygon[0], polygon[1]
    right, bottom = left, top
    for k in range(1, count):
        left, right = min(left, polygon[2 * k]), max(right, polygon[2 * k])
        top, bottom = min(top, polygon[2 * k + 1]), max(bottom, polygon[2 * k + 1])
    reach = frame.sample_reach
    left, right = max(first_center(left - reach), 0), min(first_center(right + reach), frame.width)
    top, bottom = max(first_center(top - reach), 0), min(first_center(bottom + reach), frame.height)
    farthest = max(corners[2], corners[5], corners[8])
    if left >= right or top >= bottom:
        return 0, -1
    ux, uy, uz = corners[3] - corners[0], corners[4] - corners[1], corners[5] - corners[2]
    vx, vy, vz = corners[6] - corners[0], corners[7] - corners[1], corners[8] - corners[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    distance = nx * corners[0] + ny * corners[1] + nz * corners[2]
    # 0: seen edge-on. Negative: counter-clockwise and facing the camera.
    if distance == 0.0:
        return 0, -1
    shift = 0
    if distance * draw.culled > 0.0:
        shift = frame.bin_count - frame.band_count
        if shift == 0:
            return 0, -1
    xy = out.xy
    xy[0], xy[1], xy[2] = left, top, index
    out.kind = CLIPPED_TRIANGLE
    out.dx = nx / (frame.fx * distance)
    out.dy = ny / (frame.fy * distance)
    ray_x = (left + 0.5 - frame.cx) / frame.fx
    ray_y = (top + 0.5 - frame.cy) / frame.fy
    out.base = (nx * ray_x + ny * ray_y + nz) / distance
    out.low = 1.0 / farthest
    out.high = 1.0 / frame.near
    return bins_of(top, bottom, shift)


@device_function
def line(frame, draw, primitive, out):
    """Set up a line, clipped."""
    first = np.int64(draw.indices[2 * primitive])
    second = np.int64(draw.indices[2 * primitive + 1])
    vertices = frame.vertices
    v0, v1 = 4 * (draw.first_vertex + first), 4 * (draw.first_vertex + second)
    w0, w1 = vertices[v0 + 2], vertices[v1 + 2]
    if w0 == BEHIND and w1 == BEHIND:
        return 0, -1
    if w0 < 0.0 or w1 < 0.0:
        ends = _ends_array()
        camera_vertex(draw, first, ends, 0)
        camera_vertex(draw, second, ends, 1)
        if not clip_line(frame, ends):
            return 0, -1
        fx0, fy0 = project(frame, ends, 0)
        fx1, fy1 = project(frame, ends, 1)
        w0 = np.float32(1.0 / ends[2])
        w1 = np.float32(1.0 / ends[5])
    else:
        fx0, fy0, fx1, fy1 = vertices[v0], vertices[v0 + 1], vertices[v1], vertices[v1 + 1]
    x0, y0, x1, y1 = snap(fx0), snap(fy0), snap(fx1), snap(fy1)
    half = np.int64(np.rint(min(max(draw.size, 1.0), float(MAX_POINT)) * HALF))
    reach = half + frame.sample_reach
    left = max(first_center(min(x0, x1) - reach), 0)
    right = min(first_center(max(x0, x1) + reach), frame.width)
    top = max(first_center(min(y0, y1) - reach), 0)
    bottom = min(first_center(max(y0, y1) + reach), frame.height)
    if left >= right or top >= bottom or (x0 == x1 and y0 == y1):
        return 0, -1
    xy = out.xy
    xy[0], xy[1], xy[2], xy[3], xy[4], xy[5] = x0, y0, x1, y1, half, left | (top << 16)
    out.kind = LINE
    # Constant across the line, linear along it.
    dx = np.float64(fx1) - np.float64(fx0)
    dy = np.float64(fy1) - np.float64(fy0)
    per_pixel = (np.float64(w1) - np.float64(w0)) / (dx * dx + dy * dy)
    out.dx = per_pixel * dx
    out.dy = per_pixel * dy
    out.base = np.float64(w0) + per_pixel * (dx * (left + 0.5 - np.float64(fx0)) + dy * (top + 0.5 - np.float64(fy0)))
    out.low = min(w0, w1)
    out.high = max(w0, w1)
    return bins_of(top, bottom, 0)


@device_function
def point(frame, draw, primitive, out):
    """Set up a point: the size x size pixels whose centres are nearest to it."""
    vertex = 4 * (draw.first_vertex + np.int64(draw.indices[primitive]))
    vertices = frame.vertices
    w = vertices[vertex + 2]
    if w < 0.0:
        return 0, -1
    size = np.int64(np.rint(min(max(draw.size, 1.0), float(MAX_POINT))))
    x0, y0 = snap(vertices[vertex]) - size * HALF, snap(vertices[vertex + 1]) - size * HALF
    x1, y1 = x0 + size * SUBPIXEL, y0 + size * SUBPIXEL
    reach = frame.sample_reach
    left, right = max(first_center(x0 - reach), 0), min(first_center(x1 + reach), frame.width)
    top, bottom = max(first_center(y0 - reach), 0), min(first_center(y1 + reach), frame.height)
    if left >= right or top >= bottom:
        return 0, -1
    xy = out.xy
    xy[0] = left if reach == 0 else x0
    xy[1] = top if reach == 0 else y0
    xy[2] = right if reach == 0 else x1
    xy[3] = bottom if reach == 0 else y1
    out.kind = POINT
    out.low = w
    out.high = w
    return bins_of(top, bottom, 0)
