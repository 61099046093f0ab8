"""Exact coverage of large primitives, shared by rasterization with one and with several samples per pixel.

A sample point is covered if it is inside all edges, or on a left edge or a horizontal top edge. The column at which an
edge crosses a row is a quotient of integers below 2^50 and 2^33. If it is not an integer, it differs from one by at
least 2^-33 at a magnitude below 2^17, so that rounding to float64 does not change its ceiling. Spans are half-open: of
two triangles with a common edge, exactly one covers each point.

All coordinates are grid units. Corners (``xa``, ``y0``, ``polygon``, a ``polygon_array``) are integers. Of a sample
point, ``x`` is the offset across from its pixel's centre, and ``y`` the position down.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F64, I64, Pointer, f64, i64
from renderers.compiler.simd import F64x8, I32x8, I32x8x2
from renderers.compiler.structs import Struct
from renderers.raster.clip import clip_triangle, corner_array, polygon_array
from renderers.raster.grid import first_center, pixel_box
from renderers.raster.layout import (
    HALF_PIXEL,
    KIND_CLIPPED,
    KIND_LINE,
    KIND_POINT,
    KIND_TRIANGLE,
    SUBPIXEL,
    Primitive,
    RasterFrame,
)

Target = TypeVar("Target", bound=Struct)


@inlined
def _first_column_right_of(xa: F64, ya: F64, xb: F64, yb: F64, x: F64x8, y: F64x8) -> I32x8:
    """Return the first pixel column whose sample point is on or right of the edge a -> b, which is not horizontal."""
    dy = vec.f64(yb - ya)
    numerator = vec.f64(xb - xa) * (y - vec.f64(ya)) + (vec.f64(xa - HALF_PIXEL) - x) * dy
    crossing = vec.ceil(numerator / (dy * vec.f64(float(SUBPIXEL))))
    # Rows that the edge does not reach may cross it anywhere: keep those in the range of int32.
    return vec.to_i32(vec.minimum(vec.maximum(crossing, vec.f64(-1e9)), vec.f64(1e9)))


@device_function
def inv_z_origin(primitive: Primitive) -> Pixel:
    """Return the pixel at whose centre 1/z is ``inv_z_base``."""
    geometry, kind = primitive.geometry, primitive.kind
    x0, y0 = i64(geometry[0]), i64(geometry[1])
    if kind == KIND_TRIANGLE:
        x1, y1, x2, y2 = i64(geometry[2]), i64(geometry[3]), i64(geometry[4]), i64(geometry[5])
        return Pixel(first_center(min(x0, x1, x2)), first_center(min(y0, y1, y2)))
    if kind == KIND_LINE:
        corner = i64(geometry[5])
        return Pixel(corner & 0xFFFF, corner >> 16)
    if kind == KIND_CLIPPED:
        return Pixel(x0, y0)
    return Pixel(i64(0), i64(0))


@device_function
def _polygon_of(frame: RasterFrame, primitive: Primitive, polygon: Pointer[I64]) -> I64:
    """Write the corners of a triangle, of a line's parallelogram or of a clipped triangle; return their number."""
    geometry, kind = primitive.geometry, primitive.kind
    if kind == KIND_TRIANGLE:
        for k in range(6):
            polygon[k] = geometry[k]
        return 3
    if kind == KIND_LINE:
        x0, y0, x1, y1 = i64(geometry[0]), i64(geometry[1]), i64(geometry[2]), i64(geometry[3])
        half_width = i64(geometry[4])
        # As GL's aliased lines: widened along the minor axis, so that a width of 1 is one pixel per step.
        is_steep = abs(x1 - x0) < abs(y1 - y0)
        dx, dy = half_width * is_steep, half_width * (not is_steep)
        polygon[0], polygon[1], polygon[2], polygon[3] = x0 - dx, y0 - dy, x1 - dx, y1 - dy
        polygon[4], polygon[5], polygon[6], polygon[7] = x1 + dx, y1 + dy, x0 + dx, y0 + dy
        return 4
    draw = frame.draws[geometry[2]]
    return clip_triangle(frame, draw, i64(primitive.id) - draw.first_id, corner_array(), polygon)


class Pixel(NamedTuple):
    """Column and row of a pixel of the image, or off it."""

    x: I64
    y: I64


class _Corners(NamedTuple):
    """Corners of a clockwise triangle, int64, grid units."""

    x0: I64
    y0: I64
    x1: I64
    y1: I64
    x2: I64
    y2: I64


@inlined
def _triangle_of(polygon: Pointer[I64], corner: I64) -> tuple[_Corners, I64]:
    """Return the _Corners 0, ``corner - 1`` and ``corner`` of a polygon, and twice their area, square grid units."""
    x0, y0, x1, y1 = polygon[0], polygon[1], polygon[2 * corner - 2], polygon[2 * corner - 1]
    x2, y2 = polygon[2 * corner], polygon[2 * corner + 1]
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area < 0:
        x1, x2, y1, y2 = x2, x1, y2, y1
    return _Corners(x0, y0, x1, y1, x2, y2), area


@inlined
def _limit_by_edge(start: I32x8, stop: I32x8, xa: F64, ya: F64, xb: F64, yb: F64, x: F64x8, y: F64x8) -> I32x8x2:
    """Narrow the columns ``start .. stop`` of rows to the inner side of a clockwise triangle's edge a -> b."""
    if ya == yb:
        return start, stop
    column = _first_column_right_of(xa, ya, xb, yb, x, y)
    # With y down and this winding, edges that run upwards are left ones.
    return (vec.maximum(start, column), stop) if yb < ya else (start, vec.minimum(stop, column))


@inlined
def _covered_columns(corners: _Corners, left: I64, right: I64, x: F64x8, y: F64x8) -> I32x8x2:
    """Return the columns ``start .. stop`` within ``left .. right`` in which each sample point is covered."""
    x0, y0 = f64(corners.x0), f64(corners.y0)
    x1, y1 = f64(corners.x1), f64(corners.y1)
    x2, y2 = f64(corners.x2), f64(corners.y2)
    start, stop = vec.i32(left), vec.i32(right)
    start, stop = _limit_by_edge(start, stop, x0, y0, x1, y1, x, y)
    start, stop = _limit_by_edge(start, stop, x1, y1, x2, y2, x, y)
    start, stop = _limit_by_edge(start, stop, x2, y2, x0, y0, x, y)
    inside = (y >= vec.f64(min(min(y0, y1), y2))) & (y < vec.f64(max(max(y0, y1), y2)))
    return start, vec.select(inside, stop, vec.i32(-1))


def make_fill(
    rows: int, sample_points: Callable[..., Any], draw_spans: Callable[..., Any], draw_point: Callable[..., Any]
) -> Callable[..., Any]:
    """Return a device function ``fill(frame, target, primitive, first_row, end_row)`` that draws a large primitive.

    Args:
        rows: number of rows whose spans are found at a time: 8, each lane is a row; or 1, each lane is a sample.
        sample_points: ``sample_points(frame, row)`` returns x and y of the sample points of ``rows`` rows from ``row``
            on, f64x8.
        draw_spans: ``draw_spans(frame, target, primitive, row, count, start, stop, base)`` draws ``count`` of these
            rows. Each point is covered in the columns ``start .. stop`` (i32x8). ``base`` is the pixel that
            ``primitive.inv_z_base`` belongs to.
        draw_point: ``draw_point(frame, target, primitive, first_row, end_row)`` draws a KIND_POINT.
    """

    @device_function
    def fill_triangle(
        frame: RasterFrame,
        target: Target,
        primitive: Primitive,
        polygon: Pointer[I64],
        corner: I64,
        first_row: I64,
        end_row: I64,
    ) -> None:
        """Draw the triangle of a polygon's corners 0, ``corner - 1`` and ``corner``; ``polygon``: ``polygon_array``."""
        corners, area = _triangle_of(polygon, corner)
        x0, y0, x1, y1, x2, y2 = corners
        min_x, min_y = min(min(x0, x1), x2), min(min(y0, y1), y2)
        max_x, max_y = max(max(x0, x1), x2), max(max(y0, y1), y2)
        box = pixel_box(frame, min_x, min_y, max_x, max_y, frame.sample_reach)
        if area == 0 or box.left >= box.right:
            return
        base = inv_z_origin(primitive)
        bottom = min(box.bottom, end_row)
        for row in range(max(box.top, first_row), bottom, rows):
            x, y = sample_points(frame, row)
            start, stop = _covered_columns(corners, box.left, box.right, x, y)
            draw_spans(frame, target, primitive, row, min(bottom - row, rows), start, stop, base)

    @device_function
    def fill(frame: RasterFrame, target: Target, primitive: Primitive, first_row: I64, end_row: I64) -> None:
        if primitive.kind == KIND_POINT:
            draw_point(frame, target, primitive, first_row, end_row)
            return
        polygon = polygon_array()
        count = _polygon_of(frame, primitive, polygon)
        for corner in range(2, count):
            fill_triangle(frame, target, primitive, polygon, corner, first_row, end_row)

    return fill
