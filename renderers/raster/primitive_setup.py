"""One element to its record: lines, points, clipped triangles and those too large for the vector path."""

from __future__ import annotations

import numpy as np

from renderers.compiler.device_function import inner
from renderers.compiler.pointers import f32_at, f64_at, i32_at, i64_at, u32_at
from renderers.raster.clip import MAX_VERTICES, camera_vertex, clip_line, clip_triangle, project, snap
from renderers.raster.layout import (
    HALF,
    J_BANDS,
    J_HEIGHT,
    J_LENGTHS,
    J_LISTS,
    J_MARGIN,
    J_TABLE,
    J_VERTEX,
    J_WIDTH,
    KIND_CLIPPED,
    KIND_LINE,
    KIND_POINT,
    KIND_TRIANGLE,
    L_CX,
    L_CY,
    L_FAR,
    L_FX,
    L_FY,
    L_NEAR,
    M_COLUMNS,
    M_SIZE,
    MAX_POINT,
    R_BASE,
    R_DX,
    R_DY,
    R_HIGH,
    R_KIND,
    R_LOW,
    R_XY,
    SUBPIXEL,
    T_COLUMNS,
    T_CULL,
    T_ELEMENTS,
    T_HIDDEN,
    T_VERTEX,
)
from renderers.raster.transform import BEHIND
from renderers.visibility_buffer import BAND_ROWS


@inner
def first_centre(value):
    """The first pixel whose centre is at or after the grid coordinate: ceil((value - 1/2 px) / 1 px)."""
    return (value - HALF + SUBPIXEL - 1) >> 8


@inner
def large_triangle(job, lens, drawn, element, record):
    """Write the record of a triangle; returns (first list, last list), or (0, -1) when nothing of it can be seen."""
    table = i64_at(job[J_TABLE])
    row = drawn * T_COLUMNS
    indices = u32_at(table[row + T_ELEMENTS] + 12 * element)
    vertices = f32_at(job[J_VERTEX] + 16 * table[row + T_VERTEX])
    v0 = 4 * np.int64(indices[0])
    v1 = 4 * np.int64(indices[1])
    v2 = 4 * np.int64(indices[2])
    w0, w1, w2 = vertices[v0 + 2], vertices[v1 + 2], vertices[v2 + 2]
    high = max(w0, w1, w2)
    if high == BEHIND:
        return 0, -1
    low = min(w0, w1, w2)
    if low < 0.0:
        return clipped_triangle(job, lens, drawn, element, record)
    if high < np.float32(1.0 / lens[L_FAR]):
        return 0, -1
    x0, x1, x2 = snap(vertices[v0]), snap(vertices[v1]), snap(vertices[v2])
    y0, y1, y2 = snap(vertices[v0 + 1]), snap(vertices[v1 + 1]), snap(vertices[v2 + 1])
    margin = job[J_MARGIN]
    left = max(first_centre(min(x0, x1, x2) - margin), 0)
    right = min(first_centre(max(x0, x1, x2) + margin), job[J_WIDTH])
    top = max(first_centre(min(y0, y1, y2) - margin), 0)
    bottom = min(first_centre(max(y0, y1, y2) + margin), job[J_HEIGHT])
    if left >= right or top >= bottom:
        return 0, -1
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0:
        return 0, -1
    if area * table[row + T_HIDDEN] > 0:
        return 0, -1
    shift = 0
    if area * table[row + T_CULL] > 0:
        shift = job[J_LISTS] - job[J_BANDS]
        if shift == 0:
            return 0, -1
    if area < 0:
        v1, v2, w1, w2, x1, x2, y1, y2 = v2, v1, w2, w1, x2, x1, y2, y1
    whole = i32_at(record)
    whole[R_XY] = x0
    whole[R_XY + 1] = y0
    whole[R_XY + 2] = x1
    whole[R_XY + 3] = y1
    whole[R_XY + 4] = x2
    whole[R_XY + 5] = y2
    whole[R_KIND] = KIND_TRIANGLE
    # 1/z is linear in the picture: the plane through the vertices as they are, not as they were snapped.
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
    box_x = np.float64(first_centre(min(x0, x1, x2)))
    box_y = np.float64(first_centre(min(y0, y1, y2)))
    plane = f64_at(record)
    plane[R_DX] = slope_x
    plane[R_DY] = slope_y
    plane[R_BASE] = np.float64(w0) + (slope_x * (box_x + 0.5 - fx0) + slope_y * (box_y + 0.5 - fy0))
    bounds = f32_at(record)
    bounds[R_LOW] = low
    bounds[R_HIGH] = high
    return shift + top // BAND_ROWS, shift + (bottom - 1) // BAND_ROWS


@inner
def clipped_triangle(job, lens, drawn, element, record):
    """As ``large_triangle`` for one that needs clipping; raster clips it again, band by band."""
    corners = np.empty((3, 3), np.float64)
    grid = np.empty((MAX_VERTICES, 2), np.int64)
    count = clip_triangle(job, lens, drawn, element, corners, grid)
    if count == 0:
        return 0, -1
    left, top = grid[0, 0], grid[0, 1]
    right, bottom = left, top
    for k in range(1, count):
        left, right = min(left, grid[k, 0]), max(right, grid[k, 0])
        top, bottom = min(top, grid[k, 1]), max(bottom, grid[k, 1])
    margin = job[J_MARGIN]
    left, right = max(first_centre(left - margin), 0), min(first_centre(right + margin), job[J_WIDTH])
    top, bottom = max(first_centre(top - margin), 0), min(first_centre(bottom + margin), job[J_HEIGHT])
    farthest = max(corners[0, 2], corners[1, 2], corners[2, 2])
    if left >= right or top >= bottom:
        return 0, -1
    ux, uy, uz = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1], corners[1, 2] - corners[0, 2]
    vx, vy, vz = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1], corners[2, 2] - corners[0, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    distance = nx * corners[0, 0] + ny * corners[0, 1] + nz * corners[0, 2]
    # Seen edge-on, distance is 0. Counter-clockwise triangles that face the camera have a negative one.
    if distance == 0.0:
        return 0, -1
    shift = 0
    if distance * i64_at(job[J_TABLE])[drawn * T_COLUMNS + T_CULL] > 0.0:
        shift = job[J_LISTS] - job[J_BANDS]
        if shift == 0:
            return 0, -1
    whole = i32_at(record)
    whole[R_XY] = left
    whole[R_XY + 1] = top
    whole[R_XY + 2] = drawn
    whole[R_KIND] = KIND_CLIPPED
    plane = f64_at(record)
    plane[R_DX] = nx / (lens[L_FX] * distance)
    plane[R_DY] = ny / (lens[L_FY] * distance)
    ray_x = (left + 0.5 - lens[L_CX]) / lens[L_FX]
    ray_y = (top + 0.5 - lens[L_CY]) / lens[L_FY]
    plane[R_BASE] = (nx * ray_x + ny * ray_y + nz) / distance
    bounds = f32_at(record)
    bounds[R_LOW] = 1.0 / farthest
    bounds[R_HIGH] = 1.0 / lens[L_NEAR]
    return shift + top // BAND_ROWS, shift + (bottom - 1) // BAND_ROWS


@inner
def line(job, lens, drawn, element, record):
    """Write the record of a line, clipped."""
    table = i64_at(job[J_TABLE])
    row = drawn * T_COLUMNS
    indices = u32_at(table[row + T_ELEMENTS] + 8 * element)
    vertices = f32_at(job[J_VERTEX] + 16 * table[row + T_VERTEX])
    v0 = 4 * np.int64(indices[0])
    v1 = 4 * np.int64(indices[1])
    w0, w1 = vertices[v0 + 2], vertices[v1 + 2]
    if w0 == BEHIND and w1 == BEHIND:
        return 0, -1
    if w0 < 0.0 or w1 < 0.0:
        ends = np.empty((2, 3), np.float64)
        camera_vertex(job, drawn, np.int64(indices[0]), ends, 0)
        camera_vertex(job, drawn, np.int64(indices[1]), ends, 1)
        if not clip_line(lens, ends):
            return 0, -1
        fx0, fy0 = project(lens, ends, 0)
        fx1, fy1 = project(lens, ends, 1)
        w0 = np.float32(1.0 / ends[0, 2])
        w1 = np.float32(1.0 / ends[1, 2])
    else:
        fx0, fy0, fx1, fy1 = vertices[v0], vertices[v0 + 1], vertices[v1], vertices[v1 + 1]
    x0, y0, x1, y1 = snap(fx0), snap(fy0), snap(fx1), snap(fy1)
    size = f64_at(job[J_LENGTHS] + 8 * (M_COLUMNS * drawn + M_SIZE))[0]
    half = np.int64(np.rint(min(max(size, 1.0), float(MAX_POINT)) * HALF))
    reach = half + job[J_MARGIN]
    left = max(first_centre(min(x0, x1) - reach), 0)
    right = min(first_centre(max(x0, x1) + reach), job[J_WIDTH])
    top = max(first_centre(min(y0, y1) - reach), 0)
    bottom = min(first_centre(max(y0, y1) + reach), job[J_HEIGHT])
    if left >= right or top >= bottom or (x0 == x1 and y0 == y1):
        return 0, -1
    whole = i32_at(record)
    whole[R_XY] = x0
    whole[R_XY + 1] = y0
    whole[R_XY + 2] = x1
    whole[R_XY + 3] = y1
    whole[R_XY + 4] = half
    whole[R_KIND] = KIND_LINE
    # Constant across the line, linear along it.
    dx = np.float64(fx1) - np.float64(fx0)
    dy = np.float64(fy1) - np.float64(fy0)
    per_pixel = (np.float64(w1) - np.float64(w0)) / (dx * dx + dy * dy)
    plane = f64_at(record)
    plane[R_DX] = per_pixel * dx
    plane[R_DY] = per_pixel * dy
    plane[R_BASE] = np.float64(w0) + per_pixel * (
        dx * (left + 0.5 - np.float64(fx0)) + dy * (top + 0.5 - np.float64(fy0))
    )
    whole[R_XY + 5] = left | (top << 16)
    bounds = f32_at(record)
    bounds[R_LOW] = min(w0, w1)
    bounds[R_HIGH] = max(w0, w1)
    return top // BAND_ROWS, (bottom - 1) // BAND_ROWS


@inner
def point(job, drawn, element, record):
    """Write the record of a point: the size x size pixels whose centres are nearest to it."""
    table = i64_at(job[J_TABLE])
    row = drawn * T_COLUMNS
    indices = u32_at(table[row + T_ELEMENTS] + 4 * element)
    vertex = f32_at(job[J_VERTEX] + 16 * (table[row + T_VERTEX] + np.int64(indices[0])))
    w = vertex[2]
    if w < 0.0:
        return 0, -1
    size = np.int64(np.rint(min(max(f64_at(job[J_LENGTHS] + 8 * (M_COLUMNS * drawn + M_SIZE))[0], 1.0), MAX_POINT)))
    x0, y0 = snap(vertex[0]) - size * HALF, snap(vertex[1]) - size * HALF
    x1, y1 = x0 + size * SUBPIXEL, y0 + size * SUBPIXEL
    margin = job[J_MARGIN]
    left, right = max(first_centre(x0 - margin), 0), min(first_centre(x1 + margin), job[J_WIDTH])
    top, bottom = max(first_centre(y0 - margin), 0), min(first_centre(y1 + margin), job[J_HEIGHT])
    if left >= right or top >= bottom:
        return 0, -1
    whole = i32_at(record)
    whole[R_XY] = left if margin == 0 else x0
    whole[R_XY + 1] = top if margin == 0 else y0
    whole[R_XY + 2] = right if margin == 0 else x1
    whole[R_XY + 3] = bottom if margin == 0 else y1
    whole[R_KIND] = KIND_POINT
    bounds = f32_at(record)
    bounds[R_LOW] = w
    bounds[R_HIGH] = w
    return top // BAND_ROWS, (bottom - 1) // BAND_ROWS
