"""Setup of one primitive at a time: lines, points, and the triangles that ``triangle_setup`` calls general.

The functions fill a Primitive, but for its ``id``, and return its first and last bin, or NOT_VISIBLE. In them, ``w`` is
1/z, 1/m, or BEFORE_NEAR_PLANE or OUTSIDE_GUARD_BAND, which are negative.
"""

from typing import Final

import numpy as np

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, F64, I64, Pointer, f32, f64, i64
from renderers.compiler.pointers import stack_array
from renderers.raster.chunks import base_bin_of, bin_range
from renderers.raster.clip import (
    camera_vertex,
    clip_line,
    clip_triangle,
    corner_array,
    polygon_array,
    project_to_pixels,
)
from renderers.raster.grid import first_center, is_empty, pixel_box, snap_to_grid
from renderers.raster.layout import (
    BEFORE_NEAR_PLANE,
    HALF_PIXEL,
    KIND_CLIPPED,
    KIND_LINE,
    KIND_POINT,
    KIND_TRIANGLE,
    MAX_POINT_SIZE,
    SUBPIXEL,
    Draw,
    Primitive,
    RasterFrame,
    vertex_of,
)

NOT_VISIBLE: Final = (0, -1)
"""No bins."""
_ends_array = stack_array(F64, 6)


@device_function
def set_up_general_triangle(
    frame: RasterFrame, draw_index: I64, primitive_in_mesh: I64, primitive: Primitive
) -> tuple[I64, I64]:
    """Set up a triangle in float64: of any size, clipped or not."""
    draw = frame.draws[draw_index]
    v0 = vertex_of(frame, draw, i64(draw.indices[3 * primitive_in_mesh]))
    v1 = vertex_of(frame, draw, i64(draw.indices[3 * primitive_in_mesh + 1]))
    v2 = vertex_of(frame, draw, i64(draw.indices[3 * primitive_in_mesh + 2]))
    w0, w1, w2 = v0[2], v1[2], v2[2]
    w_min, w_max = min(min(w0, w1), w2), max(max(w0, w1), w2)
    if w_max == BEFORE_NEAR_PLANE:
        return NOT_VISIBLE
    if w_min < 0.0:
        return _set_up_clipped_triangle(frame, draw_index, primitive_in_mesh, primitive)
    if w_max < frame.inv_z_far:  # saves time only: the depth test rejects what is beyond the far plane
        return NOT_VISIBLE
    x0, x1, x2 = snap_to_grid(v0[0]), snap_to_grid(v1[0]), snap_to_grid(v2[0])
    y0, y1, y2 = snap_to_grid(v0[1]), snap_to_grid(v1[1]), snap_to_grid(v2[1])
    min_x, max_x = min(min(x0, x1), x2), max(max(x0, x1), x2)
    min_y, max_y = min(min(y0, y1), y2), max(max(y0, y1), y2)
    box = pixel_box(frame, min_x, min_y, max_x, max_y, frame.sample_reach)
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    # hidden_area_sign and culled_area_sign are those of the screen area of such back faces, see Draw.
    if is_empty(box) or area == 0 or area * draw.hidden_area_sign > 0:
        return NOT_VISIBLE
    base_bin = base_bin_of(frame, area * draw.culled_area_sign > 0)
    if base_bin < 0:  # culled and not kept
        return NOT_VISIBLE
    if area < 0:  # to clockwise, so that edge functions are positive inside
        x1, x2, y1, y2 = x2, x1, y2, y1
    geometry = primitive.geometry
    geometry[0], geometry[1], geometry[2], geometry[3], geometry[4], geometry[5] = x0, y0, x1, y1, x2, y2
    primitive.kind = KIND_TRIANGLE
    _set_inv_z_plane(primitive, v0, v1, v2, first_center(min_x), first_center(min_y))
    primitive.inv_z_min, primitive.inv_z_max = w_min, w_max
    return bin_range(box.top, box.bottom, base_bin)


@inlined
def _set_inv_z_plane(
    primitive: Primitive, v0: Pointer[F32], v1: Pointer[F32], v2: Pointer[F32], base_x: I64, base_y: I64
) -> None:
    """Set the plane of 1/z through the vertices before snapping; the same for both windings.

    1/z is linear on screen. Snapping moves a vertex by up to half a grid unit, which would tilt the plane, the more the
    smaller the triangle. ``inv_z_base`` is at the centre of pixel (``base_x``, ``base_y``).
    ``triangle_geometry.inv_z_plane`` does the same for eight triangles.
    """
    ax, ay, aw = f64(v0[0]), f64(v0[1]), f64(v0[2])
    ux, uy, uw = f64(v1[0]) - ax, f64(v1[1]) - ay, f64(v1[2]) - aw
    vx, vy, vw = f64(v2[0]) - ax, f64(v2[1]) - ay, f64(v2[2]) - aw
    determinant = ux * vy - vx * uy
    dx = 0.0
    dy = 0.0
    if determinant != 0.0:
        dx = (uw * vy - vw * uy) / determinant
        dy = (vw * ux - uw * vx) / determinant
    primitive.inv_z_dx, primitive.inv_z_dy = dx, dy
    primitive.inv_z_base = aw + (dx * (base_x + 0.5 - ax) + dy * (base_y + 0.5 - ay))


@device_function
def _set_up_clipped_triangle(
    frame: RasterFrame, draw_index: I64, primitive_in_mesh: I64, primitive: Primitive
) -> tuple[I64, I64]:
    """Set up a triangle that needs clipping. It is clipped again in every band that it touches."""
    draw = frame.draws[draw_index]
    corners, polygon = corner_array(), polygon_array()
    corner_count = clip_triangle(frame, draw, primitive_in_mesh, corners, polygon)
    if corner_count == 0:
        return NOT_VISIBLE
    min_x, min_y = polygon[0], polygon[1]  # x and y in turn
    max_x, max_y = min_x, min_y
    for k in range(1, corner_count):
        min_x, max_x = min(min_x, polygon[2 * k]), max(max_x, polygon[2 * k])
        min_y, max_y = min(min_y, polygon[2 * k + 1]), max(max_y, polygon[2 * k + 1])
    box = pixel_box(frame, min_x, min_y, max_x, max_y, frame.sample_reach)
    ux, uy, uz = corners[3] - corners[0], corners[4] - corners[1], corners[5] - corners[2]
    vx, vy, vz = corners[6] - corners[0], corners[7] - corners[1], corners[8] - corners[2]
    # The triangle's plane is n . p = offset, and points on a pixel's ray are p = z (ray_x, ray_y, 1): so
    # 1/z = n . ray / offset. The offset has the sign of the area on screen; at 0 the triangle is seen edge-on.
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    offset = nx * corners[0] + ny * corners[1] + nz * corners[2]
    if is_empty(box) or offset == 0.0:
        return NOT_VISIBLE
    # hidden_area_sign is 0 in draws that are clipped: see instance_transforms._is_unclipped_convex.
    base_bin = base_bin_of(frame, offset * draw.culled_area_sign > 0.0)
    if base_bin < 0:  # culled and not kept
        return NOT_VISIBLE
    geometry = primitive.geometry  # as KIND_CLIPPED says
    geometry[0], geometry[1], geometry[2] = box.left, box.top, draw_index
    primitive.kind = KIND_CLIPPED
    primitive.inv_z_dx = nx / (frame.fx * offset)
    primitive.inv_z_dy = ny / (frame.fy * offset)
    ray_x = (box.left + 0.5 - frame.cx) / frame.fx
    ray_y = (box.top + 0.5 - frame.cy) / frame.fy
    primitive.inv_z_base = (nx * ray_x + ny * ray_y + nz) / offset
    primitive.inv_z_min = 1.0 / max(max(corners[2], corners[5]), corners[8])
    primitive.inv_z_max = 1.0 / frame.near
    return bin_range(box.top, box.bottom, base_bin)


@device_function
def set_up_line(frame: RasterFrame, draw: Draw, primitive_in_mesh: I64, primitive: Primitive) -> tuple[I64, I64]:
    """Set up a line, clipped. Lines of length 0 draw nothing."""
    index0, index1 = i64(draw.indices[2 * primitive_in_mesh]), i64(draw.indices[2 * primitive_in_mesh + 1])
    v0, v1 = vertex_of(frame, draw, index0), vertex_of(frame, draw, index1)
    w0, w1 = v0[2], v1[2]
    if w0 == BEFORE_NEAR_PLANE and w1 == BEFORE_NEAR_PLANE:
        return NOT_VISIBLE
    if w0 < 0.0 or w1 < 0.0:
        ends = _ends_array()
        camera_vertex(draw, index0, ends, 0)
        camera_vertex(draw, index1, ends, 1)
        if not clip_line(frame, ends):
            return NOT_VISIBLE
        pixel_x0, pixel_y0 = project_to_pixels(frame, ends, 0)
        pixel_x1, pixel_y1 = project_to_pixels(frame, ends, 1)
        w0, w1 = f32(1.0 / ends[2]), f32(1.0 / ends[5])
    else:
        pixel_x0, pixel_y0, pixel_x1, pixel_y1 = v0[0], v0[1], v1[0], v1[1]
    x0, y0, x1, y1 = snap_to_grid(pixel_x0), snap_to_grid(pixel_y0), snap_to_grid(pixel_x1), snap_to_grid(pixel_y1)
    half_width = i64(np.rint(min(max(draw.point_or_line_size, 1.0), float(MAX_POINT_SIZE)) * HALF_PIXEL))
    reach = half_width + frame.sample_reach
    box = pixel_box(frame, min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1), reach)
    if is_empty(box) or (x0 == x1 and y0 == y1):
        return NOT_VISIBLE
    geometry = primitive.geometry  # as KIND_LINE says
    geometry[0], geometry[1], geometry[2], geometry[3] = x0, y0, x1, y1
    geometry[4], geometry[5] = half_width, box.left | (box.top << 16)
    primitive.kind = KIND_LINE
    # 1/z is constant across the line and linear along it.
    ax, ay, aw = f64(pixel_x0), f64(pixel_y0), f64(w0)
    ux, uy = f64(pixel_x1) - ax, f64(pixel_y1) - ay
    slope = (f64(w1) - aw) / (ux * ux + uy * uy)
    primitive.inv_z_dx = slope * ux
    primitive.inv_z_dy = slope * uy
    primitive.inv_z_base = aw + slope * (ux * (box.left + 0.5 - ax) + uy * (box.top + 0.5 - ay))
    primitive.inv_z_min, primitive.inv_z_max = min(w0, w1), max(w0, w1)
    return bin_range(box.top, box.bottom, 0)


@device_function
def set_up_point(frame: RasterFrame, draw: Draw, primitive_in_mesh: I64, primitive: Primitive) -> tuple[I64, I64]:
    """Set up a point: the size x size pixels whose centres are nearest to it."""
    vertex = vertex_of(frame, draw, i64(draw.indices[primitive_in_mesh]))
    w = vertex[2]
    if w < 0.0:
        return NOT_VISIBLE
    size = i64(np.rint(min(max(draw.point_or_line_size, 1.0), float(MAX_POINT_SIZE))))
    x0, y0 = snap_to_grid(vertex[0]) - size * HALF_PIXEL, snap_to_grid(vertex[1]) - size * HALF_PIXEL
    x1, y1 = x0 + size * SUBPIXEL, y0 + size * SUBPIXEL
    box = pixel_box(frame, x0, y0, x1, y1, frame.sample_reach)
    if is_empty(box):
        return NOT_VISIBLE
    geometry = primitive.geometry  # as KIND_POINT says
    if frame.sample_count == 1:
        geometry[0], geometry[1], geometry[2], geometry[3] = box.left, box.top, box.right, box.bottom
    else:
        geometry[0], geometry[1], geometry[2], geometry[3] = x0, y0, x1, y1
    primitive.kind = KIND_POINT
    primitive.inv_z_dx = primitive.inv_z_dy = 0.0
    primitive.inv_z_base = primitive.inv_z_min = primitive.inv_z_max = w
    return bin_range(box.top, box.bottom, 0)
