"""Setup of single primitives: lines, points, clipped triangles and triangles that are too large for the vector path.

The functions fill a PRIMITIVE and return its first and last bin, or (0, -1) when nothing is visible. In them, ``w`` is
1/z.
"""

from __future__ import annotations

import numpy as np
from numba import types

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import stack_array
from renderers.raster.clip import (
    camera_vertex,
    clip_line,
    clip_triangle,
    corner_array,
    polygon_array,
    project_to_pixels,
    snap_to_grid,
)
from renderers.raster.layout import (
    HALF_PIXEL,
    KIND_CLIPPED,
    KIND_LINE,
    KIND_POINT,
    KIND_TRIANGLE,
    MAX_POINT_SIZE,
    SUBPIXEL,
    SUBPIXEL_BITS,
)
from renderers.raster.transform import BEHIND
from renderers.visibility_buffer import BAND_ROWS

_ends_array = stack_array(types.float64, 6)


@device_function
def first_center(value):
    """Return the first pixel whose centre is at or after a grid coordinate: ceil((value - 1/2 px) / 1 px)."""
    return (value - HALF_PIXEL + SUBPIXEL - 1) >> SUBPIXEL_BITS


@device_function
def bin_range(first_row, end_row, first_bin):
    """Return the first and last bin of some rows; ``first_bin``: bin of the image's first band."""
    return first_bin + first_row // BAND_ROWS, first_bin + (end_row - 1) // BAND_ROWS


@device_function
def set_up_large_triangle(frame, draw_index, primitive, out):
    """Set up a triangle in float64.

    Args:
        primitive: index of the triangle in its mesh.
    """
    draw, vertices = frame.draws[draw_index], frame.vertices
    first = draw.first_vertex
    v0 = 4 * (first + np.int64(draw.indices[3 * primitive]))
    v1 = 4 * (first + np.int64(draw.indices[3 * primitive + 1]))
    v2 = 4 * (first + np.int64(draw.indices[3 * primitive + 2]))
    w0, w1, w2 = vertices[v0 + 2], vertices[v1 + 2], vertices[v2 + 2]
    w_max = max(w0, w1, w2)
    if w_max == BEHIND:
        return 0, -1
    w_min = min(w0, w1, w2)
    if w_min < 0.0:
        return _set_up_clipped_triangle(frame, draw_index, primitive, out)
    if w_max < np.float32(1.0 / frame.far):
        return 0, -1
    x0, x1, x2 = snap_to_grid(vertices[v0]), snap_to_grid(vertices[v1]), snap_to_grid(vertices[v2])
    y0, y1, y2 = snap_to_grid(vertices[v0 + 1]), snap_to_grid(vertices[v1 + 1]), snap_to_grid(vertices[v2 + 1])
    reach = frame.sample_reach
    left = max(first_center(min(x0, x1, x2) - reach), 0)
    right = min(first_center(max(x0, x1, x2) + reach), frame.width)
    top = max(first_center(min(y0, y1, y2) - reach), 0)
    bottom = min(first_center(max(y0, y1, y2) + reach), frame.height)
    if left >= right or top >= bottom:
        return 0, -1
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0 or area * draw.hidden_sign > 0:
        return 0, -1
    first_bin = 0
    if area * draw.culled_sign > 0:
        first_bin = frame.first_back_bin
        if first_bin == 0:
            return 0, -1
    if area < 0:
        v1, v2, x1, x2, y1, y2 = v2, v1, x2, x1, y2, y1
    xy = out.xy
    xy[0], xy[1], xy[2], xy[3], xy[4], xy[5] = x0, y0, x1, y1, x2, y2
    out.kind = KIND_TRIANGLE
    _set_inv_z_plane(out, vertices, v0, v1, v2, first_center(min(x0, x1, x2)), first_center(min(y0, y1, y2)))
    out.inv_z_min = w_min
    out.inv_z_max = w_max
    return bin_range(top, bottom, first_bin)


@inlined
def _set_inv_z_plane(out, vertices, v0, v1, v2, box_x, box_y):
    """Set the plane of 1/z of a PRIMITIVE. It goes through the vertices before snapping, since 1/z is linear on screen.

    Args:
        v0, v1, v2: indices of the vertices' first values.
        box_x, box_y: first pixel of the bounding box.
    """
    x0, y0, w0 = np.float64(vertices[v0]), np.float64(vertices[v0 + 1]), np.float64(vertices[v0 + 2])
    dx1, dy1 = np.float64(vertices[v1]) - x0, np.float64(vertices[v1 + 1]) - y0
    dx2, dy2 = np.float64(vertices[v2]) - x0, np.float64(vertices[v2 + 1]) - y0
    dw1, dw2 = np.float64(vertices[v1 + 2]) - w0, np.float64(vertices[v2 + 2]) - w0
    determinant = dx1 * dy2 - dx2 * dy1
    slope_x = 0.0
    slope_y = 0.0
    if determinant != 0.0:
        slope_x = (dw1 * dy2 - dw2 * dy1) / determinant
        slope_y = (dw2 * dx1 - dw1 * dx2) / determinant
    out.inv_z_dx, out.inv_z_dy = slope_x, slope_y
    out.inv_z_base = w0 + (slope_x * (box_x + 0.5 - x0) + slope_y * (box_y + 0.5 - y0))


@device_function
def _set_up_clipped_triangle(frame, draw_index, primitive, out):
    """Set up a triangle that needs clipping. It is clipped again in every band that it touches."""
    draw = frame.draws[draw_index]
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
    z_max = max(corners[2], corners[5], corners[8])
    if left >= right or top >= bottom:
        return 0, -1
    ux, uy, uz = corners[3] - corners[0], corners[4] - corners[1], corners[5] - corners[2]
    vx, vy, vz = corners[6] - corners[0], corners[7] - corners[1], corners[8] - corners[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    distance = nx * corners[0] + ny * corners[1] + nz * corners[2]
    # 0: seen edge-on. Negative: counter-clockwise and facing the camera.
    if distance == 0.0:
        return 0, -1
    first_bin = 0
    if distance * draw.culled_sign > 0.0:
        first_bin = frame.first_back_bin
        if first_bin == 0:
            return 0, -1
    xy = out.xy
    xy[0], xy[1], xy[2] = left, top, draw_index
    out.kind = KIND_CLIPPED
    out.inv_z_dx = nx / (frame.fx * distance)
    out.inv_z_dy = ny / (frame.fy * distance)
    ray_x = (left + 0.5 - frame.cx) / frame.fx
    ray_y = (top + 0.5 - frame.cy) / frame.fy
    out.inv_z_base = (nx * ray_x + ny * ray_y + nz) / distance
    out.inv_z_min = 1.0 / z_max
    out.inv_z_max = 1.0 / frame.near
    return bin_range(top, bottom, first_bin)


@device_function
def set_up_line(frame, draw, primitive, out):
    """Set up a line, clipped."""
    vertex0, vertex1 = np.int64(draw.indices[2 * primitive]), np.int64(draw.indices[2 * primitive + 1])
    vertices = frame.vertices
    v0, v1 = 4 * (draw.first_vertex + vertex0), 4 * (draw.first_vertex + vertex1)
    w0, w1 = vertices[v0 + 2], vertices[v1 + 2]
    if w0 == BEHIND and w1 == BEHIND:
        return 0, -1
    if w0 < 0.0 or w1 < 0.0:
        ends = _ends_array()
        camera_vertex(draw, vertex0, ends, 0)
        camera_vertex(draw, vertex1, ends, 1)
        if not clip_line(frame, ends):
            return 0, -1
        fx0, fy0 = project_to_pixels(frame, ends, 0)
        fx1, fy1 = project_to_pixels(frame, ends, 1)
        w0, w1 = np.float32(1.0 / ends[2]), np.float32(1.0 / ends[5])
    else:
        fx0, fy0, fx1, fy1 = vertices[v0], vertices[v0 + 1], vertices[v1], vertices[v1 + 1]
    x0, y0, x1, y1 = snap_to_grid(fx0), snap_to_grid(fy0), snap_to_grid(fx1), snap_to_grid(fy1)
    half_width = np.int64(np.rint(min(max(draw.size, 1.0), float(MAX_POINT_SIZE)) * HALF_PIXEL))
    reach = half_width + frame.sample_reach
    left = max(first_center(min(x0, x1) - reach), 0)
    right = min(first_center(max(x0, x1) + reach), frame.width)
    top = max(first_center(min(y0, y1) - reach), 0)
    bottom = min(first_center(max(y0, y1) + reach), frame.height)
    if left >= right or top >= bottom or (x0 == x1 and y0 == y1):
        return 0, -1
    xy = out.xy
    xy[0], xy[1], xy[2], xy[3], xy[4], xy[5] = x0, y0, x1, y1, half_width, left | (top << 16)
    out.kind = KIND_LINE
    # 1/z is constant across the line and linear along it.
    dx, dy = np.float64(fx1) - np.float64(fx0), np.float64(fy1) - np.float64(fy0)
    slope = (np.float64(w1) - np.float64(w0)) / (dx * dx + dy * dy)
    out.inv_z_dx = slope * dx
    out.inv_z_dy = slope * dy
    out.inv_z_base = np.float64(w0) + slope * (dx * (left + 0.5 - np.float64(fx0)) + dy * (top + 0.5 - np.float64(fy0)))
    out.inv_z_min = min(w0, w1)
    out.inv_z_max = max(w0, w1)
    return bin_range(top, bottom, 0)


@device_function
def set_up_point(frame, draw, primitive, out):
    """Set up a point: the size x size pixels whose centres are nearest to it."""
    vertex = 4 * (draw.first_vertex + np.int64(draw.indices[primitive]))
    vertices = frame.vertices
    w = vertices[vertex + 2]
    if w < 0.0:
        return 0, -1
    size = np.int64(np.rint(min(max(draw.size, 1.0), float(MAX_POINT_SIZE))))
    x0, y0 = snap_to_grid(vertices[vertex]) - size * HALF_PIXEL, snap_to_grid(vertices[vertex + 1]) - size * HALF_PIXEL
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
    out.kind = KIND_POINT
    out.inv_z_dx = 0.0
    out.inv_z_dy = 0.0
    out.inv_z_base = w
    out.inv_z_min = w
    out.inv_z_max = w
    return bin_range(top, bottom, 0)
