"""Clipping of primitives that cross the near plane or leave the guard band, in the camera's frame.

``points``, ``corners`` and ``out`` are (N, 3), metres in that frame; ``k`` is the index of a point. ``plane`` 0 is the
near plane, 1 to 4 are the sides of the guard band.
"""

from typing import Final

import numpy as np

from renderers.compiler.device_function import device_function
from renderers.compiler.kernel_types import F32, F64, I64, Pointer, f32, f64, i64
from renderers.compiler.pointers import stack_array
from renderers.raster.grid import snap_to_grid
from renderers.raster.layout import GUARD_BAND, Draw, RasterFrame, vertex_of

PLANES: Final = 5
MAX_POLYGON_VERTICES: Final = 24
"""Maximum vertices of a clipped triangle. A convex polygon has at most 3 + PLANES; each plane adds at most half of the
vertices where rounding has bent it: 3 * 1.5^5 < 24."""

corner_array: Final = stack_array(F64, 9)
"""``corner_array()``: room for the three corners of a triangle in the camera's frame."""
polygon_array: Final = stack_array(I64, 2 * MAX_POLYGON_VERTICES)
"""``polygon_array()``: room for a polygon's corners in grid units, x and y in turn."""
_points_array: Final = stack_array(F64, 3 * MAX_POLYGON_VERTICES)
_clipped_array: Final = stack_array(F64, 3 * MAX_POLYGON_VERTICES)
_vertex_indices_array: Final = stack_array(I64, MAX_POLYGON_VERTICES)
_clipped_vertex_indices_array: Final = stack_array(I64, MAX_POLYGON_VERTICES)


@device_function
def camera_vertex(draw: Draw, index: I64, out: Pointer[F64], k: I64) -> None:
    """Write vertex ``index`` of a draw's mesh to point ``k`` of ``out``."""
    p, m = draw.positions, draw.X_camera_mesh
    x, y, z = f64(p[3 * index]), f64(p[3 * index + 1]), f64(p[3 * index + 2])
    for row in range(3):
        out[3 * k + row] = m[4 * row] * x + m[4 * row + 1] * y + m[4 * row + 2] * z + m[4 * row + 3]


@device_function
def _plane_distance(frame: RasterFrame, plane: I64, points: Pointer[F64], k: I64) -> F64:
    """Return how far a point lies inside a plane."""
    x, y, z = points[3 * k], points[3 * k + 1], points[3 * k + 2]
    # A side is fx x / z + cx >= -GUARD_BAND, times z, and so on. The far plane is left to the depth test.
    if plane == 0:
        return z - frame.near
    if plane == 1:
        return frame.fx * x + (GUARD_BAND + frame.cx) * z
    if plane == 2:
        return (GUARD_BAND - frame.cx) * z - frame.fx * x
    if plane == 3:
        return frame.fy * y + (GUARD_BAND + frame.cy) * z
    return (GUARD_BAND - frame.cy) * z - frame.fy * y


@device_function
def _interpolate_at_plane(
    points: Pointer[F64], inside: I64, d_inside: F64, outside: I64, d_outside: F64, out: Pointer[F64], k: I64
) -> None:
    """Write the intersection of a plane and the edge between two points, at the distances d, to point ``k`` of ``out``.

    It is always computed from the inside end, so that two triangles with a common edge get the same point. It may
    replace the outside end (``out`` is ``points``): each coordinate is read before it is written.
    """
    t = d_inside / (d_inside - d_outside)
    for axis in range(3):
        start = points[3 * inside + axis]
        out[3 * k + axis] = start + t * (points[3 * outside + axis] - start)


@device_function
def project_to_pixels(frame: RasterFrame, points: Pointer[F64], k: I64) -> tuple[F32, F32]:
    """Return the pixel coordinates of a point that does not lie behind the near plane."""
    x, y, inv_z = points[3 * k], points[3 * k + 1], 1.0 / points[3 * k + 2]
    return f32(frame.fx * x * inv_z + frame.cx), f32(frame.fy * y * inv_z + frame.cy)


@device_function
def _is_finite(points: Pointer[F64], count: I64) -> bool:
    """Return whether all coordinates of the first ``count`` points, as for ``_plane_distance``, are finite."""
    total = 0.0
    for k in range(3 * count):
        total += abs(points[k])
    return total < np.inf


@device_function
def _clip_at_plane(
    frame: RasterFrame,
    plane: I64,
    points: Pointer[F64],
    vertex_indices: Pointer[I64],
    count: I64,
    clipped: Pointer[F64],
    clipped_vertex_indices: Pointer[I64],
) -> I64:
    """Clip a polygon at one plane (Sutherland and Hodgman); return the number of points of ``clipped``.

    Args:
        vertex_indices: index in the mesh of each of the ``count`` points; -1: none. A vertex of the mesh keeps exactly
            the grid position that neighbouring triangles use.
    """
    clipped_count = 0
    previous = count - 1
    d_previous = _plane_distance(frame, plane, points, previous) if count > 0 else 0.0
    for k in range(count):
        d = _plane_distance(frame, plane, points, k)
        if d >= 0.0 and d_previous < 0.0:
            _interpolate_at_plane(points, k, d, previous, d_previous, clipped, clipped_count)
            clipped_vertex_indices[clipped_count] = -1
            clipped_count += 1
        if d < 0.0 and d_previous >= 0.0:
            _interpolate_at_plane(points, previous, d_previous, k, d, clipped, clipped_count)
            clipped_vertex_indices[clipped_count] = -1
            clipped_count += 1
        if d >= 0.0:
            for axis in range(3):
                clipped[3 * clipped_count + axis] = points[3 * k + axis]
            clipped_vertex_indices[clipped_count] = vertex_indices[k]
            clipped_count += 1
        previous = k
        d_previous = d
    return clipped_count


@device_function
def clip_triangle(
    frame: RasterFrame, draw: Draw, primitive_in_mesh: I64, corners: Pointer[F64], polygon: Pointer[I64]
) -> I64:
    """Compute the visible part of a triangle; return its number of vertices. 0: nothing is left.

    Args:
        corners: ``corner_array``; gets the triangle's vertices, not clipped. The plane of 1/z goes through them.
        polygon: ``polygon_array``; gets the vertices of the visible part, grid units.
    """
    indices = draw.indices
    points, clipped = _points_array(), _clipped_array()
    vertex_indices, clipped_vertex_indices = _vertex_indices_array(), _clipped_vertex_indices_array()
    for k in range(3):
        index = i64(indices[3 * primitive_in_mesh + k])
        camera_vertex(draw, index, corners, k)
        vertex_indices[k] = index
        for axis in range(3):
            points[3 * k + axis] = corners[3 * k + axis]
    if not _is_finite(corners, 3):
        return 0
    count = 3
    for plane in range(PLANES):
        count = _clip_at_plane(frame, plane, points, vertex_indices, count, clipped, clipped_vertex_indices)
        points, clipped = clipped, points
        vertex_indices, clipped_vertex_indices = clipped_vertex_indices, vertex_indices
    if count < 3:
        return 0
    for k in range(count):
        if vertex_indices[k] >= 0:  # exactly the coordinates that neighbouring triangles use
            vertex = vertex_of(frame, draw, vertex_indices[k])
            x, y = vertex[0], vertex[1]
        else:
            x, y = project_to_pixels(frame, points, k)
        polygon[2 * k] = snap_to_grid(x)
        polygon[2 * k + 1] = snap_to_grid(y)
    return count


@device_function
def clip_line(frame: RasterFrame, ends: Pointer[F64]) -> bool:
    """Clip a segment, whose ends are two points, in place; return whether something is left."""
    if not _is_finite(ends, 2):
        return False
    for plane in range(PLANES):
        d0 = _plane_distance(frame, plane, ends, 0)
        d1 = _plane_distance(frame, plane, ends, 1)
        if d0 < 0.0 and d1 < 0.0:
            return False
        if d1 < 0.0:
            _interpolate_at_plane(ends, 0, d0, 1, d1, ends, 1)
        elif d0 < 0.0:
            _interpolate_at_plane(ends, 1, d1, 0, d0, ends, 0)
    return True
