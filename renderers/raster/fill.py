"""Exact coverage of large primitives, shared by rasterization with one and with several samples per pixel.

A point is covered if it is inside all edges, or on a left edge or a horizontal top edge. An edge's crossing with a row
of points is a quotient of integers below 2^50 and 2^33; two such that differ, differ by at least 2^-33 at a magnitude
below 2^17, so that the float64 quotient has the exact ceiling. Spans are half-open: of two triangles with a common
edge, exactly one covers each point.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.raster.clip import clip_triangle, corner_array, polygon_array
from renderers.raster.layout import CLIPPED_TRIANGLE, HALF, LINE, POINT, SUBPIXEL, TRIANGLE
from renderers.raster.primitive_setup import first_center


@inlined
def _crossing(xa, ya, xb, yb, x, y):
    """Return the first pixel columns (i32x8) whose point is at or right of the edge.

    Args:
        xa, ya, xb, yb: float64 integers, grid units; ya != yb.
        x, y: f64x8, grid units: offset of the point from the pixel's centre, and row of the point.
    """
    dy = vec.f64(yb - ya)
    numerator = vec.f64(xb - xa) * (y - vec.f64(ya)) + (vec.f64(xa - HALF) - x) * dy
    crossing = vec.ceil(numerator / (dy * vec.f64(float(SUBPIXEL))))
    # Rows that the edge does not reach may cross it anywhere: keep those in the range of int32.
    return vec.to_i32(vec.minimum(vec.maximum(crossing, vec.f64(-1e9)), vec.f64(1e9)))


@device_function
def box_origin(primitive):
    """Return the column and row of the pixel that ``BINNED.base`` belongs to."""
    xy, kind = primitive.xy, primitive.kind
    a, b = np.int64(xy[0]), np.int64(xy[1])
    if kind == TRIANGLE:
        c, d, e, f = np.int64(xy[2]), np.int64(xy[3]), np.int64(xy[4]), np.int64(xy[5])
        return first_center(min(a, c, e)), first_center(min(b, d, f))
    if kind == LINE:
        corner = np.int64(xy[5])
        return corner & 0xFFFF, corner >> 16
    if kind == CLIPPED_TRIANGLE:
        return a, b
    return np.int64(0), np.int64(0)


@device_function
def _polygon_of(frame, primitive, polygon):
    """Write the corners of a triangle, of a line's quad or of a clipped triangle; return their number."""
    xy, kind = primitive.xy, primitive.kind
    if kind == TRIANGLE:
        for k in range(6):
            polygon[k] = xy[k]
        return 3
    if kind == LINE:
        a, b, c, d, half = np.int64(xy[0]), np.int64(xy[1]), np.int64(xy[2]), np.int64(xy[3]), np.int64(xy[4])
        # As GL's aliased lines: widened along the minor axis, so that a width of 1 is one pixel per step.
        steep = abs(c - a) < abs(d - b)
        ox, oy = half * steep, half * (not steep)
        polygon[0], polygon[1], polygon[2], polygon[3] = a - ox, b - oy, c - ox, d - oy
        polygon[4], polygon[5], polygon[6], polygon[7] = c + ox, d + oy, a + ox, b + oy
        return 4
    draw = frame.draws[xy[2]]
    return clip_triangle(frame, draw, np.int64(primitive.id) - draw.first_id, corner_array(), polygon)


def filler(
    rows: int, points: Callable[..., Any], draw_span: Callable[..., Any], draw_point: Callable[..., Any]
) -> Callable[..., Any]:
    """Return a device function that draws a large primitive.

    It is called as ``fill(frame, band, rule, primitive, first_row, last_row)``.

    Args:
        rows: number of rows whose spans are found at a time.
        points: ``points(frame, row)``: f64x8 twice, the points of ``rows`` rows from ``row`` on: their offset across
            from the pixel's centre, and their row; grid units.
        draw_span: ``draw_span(frame, band, rule, primitive, row, count, start, stop, box_x, box_y)``: draws ``count``
            of these rows; ``start`` and ``stop`` are i32x8, the columns between which each point is covered.
        draw_point: ``draw_point(frame, band, rule, primitive, first_row, last_row)``: draws a POINT.
    """

    @device_function
    def fill_triangle(
        frame, band, rule, primitive, x0, y0, x1, y1, x2, y2, first_row, last_row, box_x, box_y
    ):  # fmt: skip
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if area == 0:
            return
        if area < 0:
            x1, x2, y1, y2 = x2, x1, y2, y1
        reach = frame.sample_reach
        lowest, highest = min(y0, y1, y2), max(y0, y1, y2)
        top = max(first_center(lowest - reach), first_row)
        bottom = min(first_center(highest + reach), last_row)
        left = max(first_center(min(x0, x1, x2) - reach), 0)
        right = min(first_center(max(x0, x1, x2) + reach), frame.width)
        if left >= right:
            return
        fx0, fy0 = np.float64(x0), np.float64(y0)
        fx1, fy1 = np.float64(x1), np.float64(y1)
        fx2, fy2 = np.float64(x2), np.float64(y2)
        for row in range(top, bottom, rows):
            x, y = points(frame, row)
            start, stop = vec.i32(left), vec.i32(right)
            # With this winding (y down) edges that run upwards are left ones.
            if y1 < y0:
                start = vec.maximum(start, _crossing(fx0, fy0, fx1, fy1, x, y))
            elif y1 > y0:
                stop = vec.minimum(stop, _crossing(fx0, fy0, fx1, fy1, x, y))
            if y2 < y1:
                start = vec.maximum(start, _crossing(fx1, fy1, fx2, fy2, x, y))
            elif y2 > y1:
                stop = vec.minimum(stop, _crossing(fx1, fy1, fx2, fy2, x, y))
            if y0 < y2:
                start = vec.maximum(start, _crossing(fx2, fy2, fx0, fy0, x, y))
            elif y0 > y2:
                stop = vec.minimum(stop, _crossing(fx2, fy2, fx0, fy0, x, y))
            inside = (y >= vec.f64(lowest)) & (y < vec.f64(highest))
            stop = vec.select(inside, stop, vec.i32(-1))
            draw_span(frame, band, rule, primitive, row, min(bottom - row, rows), start, stop, box_x, box_y)

    @device_function
    def fill(frame, band, rule, primitive, first_row, last_row):
        if primitive.kind == POINT:
            draw_point(frame, band, rule, primitive, first_row, last_row)
            return
        polygon = polygon_array()
        count = _polygon_of(frame, primitive, polygon)
        x0, y0 = polygon[0], polygon[1]
        box_x, box_y = box_origin(primitive)
        for k in range(2, count):
            x1, y1, x2, y2 = polygon[2 * k - 2], polygon[2 * k - 1], polygon[2 * k], polygon[2 * k + 1]
            fill_triangle(
                frame, band, rule, primitive, x0, y0, x1, y1, x2, y2, first_row, last_row, box_x, box_y
            )  # fmt: skip

    return fill  # type: ignore[no-any-return]  # device functions are untyped
