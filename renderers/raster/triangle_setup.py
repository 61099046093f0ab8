"""Setup of triangles, eight at a time, one per lane."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import address, advance, as_u32, i32_at, stack_array
from renderers.raster.layout import (
    BACK_BIT,
    HALF_PIXEL,
    KIND_SMALL,
    MAX_SMALL_DEPTH_RATIO,
    MAX_SMALL_HEIGHT,
    MAX_SMALL_WIDTH,
    MAX_TINY_PIXELS,
    SMALL_TRIANGLE,
    SUBPIXEL,
    SUBPIXEL_BITS,
    TINY_SIDE,
    small_triangle_at,
)
from renderers.raster.primitive_setup import set_up_large_triangle
from renderers.raster.transform import BEHIND
from renderers.visibility_buffer import BAND_ROWS

_SMALL_FIELDS: Final = SMALL_TRIANGLE.size // 4
"""Fields of a SMALL_TRIANGLE, of four bytes each."""
_BAND_SHIFT: Final = BAND_ROWS.bit_length() - 1
_column_array = stack_array(types.int32, 16 * vec.LANES)


class Box(NamedTuple):
    """Pixels whose centre, or one of whose samples, may be covered: columns and rows, i32x8 each."""

    left: Any
    top: Any
    right: Any
    """One past the last column."""
    bottom: Any
    """One past the last row."""


class Edges(NamedTuple):
    """Edge functions of a triangle's three edges, three i32x8 each. A point is covered where all are at least 0."""

    first: Any
    """At the first pixel centre of the box."""
    dx: Any
    """Change per column."""
    dy: Any
    """Change per row."""


class InvZ(NamedTuple):
    """1/z of eight triangles as a function of the pixel, f32x8 each. It is linear on the screen."""

    first: Any
    """At the first pixel centre of the box."""
    dx: Any
    """Change per column."""
    dy: Any
    """Change per row."""
    min: Any
    """Minimum over the vertices: clamping to the range keeps slivers from extrapolating."""
    max: Any


@inlined
def _load_triangles(draw, first, lanes, vertices, scratch):
    """Return x, y (pixels) and 1/z of the corners of eight triangles, three f32x8 each.

    Args:
        lanes: number of triangles; the lanes beyond them repeat the last one.
        scratch: pointer to (24,) int32.
    """
    indices = advance(draw.indices, 3 * first)
    if lanes < vec.LANES:
        padded = as_u32(scratch)
        for k in range(vec.LANES):
            for corner in range(3):
                padded[3 * k + corner] = indices[3 * min(k, lanes - 1) + corner]
        indices = padded
    x0, y0, w0 = vec.load_corners(vertices, indices, 0)
    x1, y1, w1 = vec.load_corners(vertices, indices, 1)
    x2, y2, w2 = vec.load_corners(vertices, indices, 2)
    return (x0, x1, x2), (y0, y1, y2), (w0, w1, w2)


@inlined
def _select3(mask, a, b):
    return vec.select(mask, a[0], b[0]), vec.select(mask, a[1], b[1]), vec.select(mask, a[2], b[2])


@inlined
def _minimum_of_3(a):
    return vec.minimum(vec.minimum(a[0], a[1]), a[2])


@inlined
def _maximum_of_3(a):
    return vec.maximum(vec.maximum(a[0], a[1]), a[2])


@inlined
def _snap_to_grid(a):
    grid = vec.f32(float(SUBPIXEL))
    return vec.to_i32(vec.rint(a[0] * grid)), vec.to_i32(vec.rint(a[1] * grid)), vec.to_i32(vec.rint(a[2] * grid))


@inlined
def _bounding_box(gx, gy, reach):
    """Return the BOX of corners on the grid; as ``first_center``, ceil((value - 128) / 256).

    Args:
        reach: as FRAME.sample_reach.
    """
    bits = vec.i32(SUBPIXEL_BITS)
    begin, end = vec.i32(SUBPIXEL - 1 - HALF_PIXEL - reach), vec.i32(SUBPIXEL - 1 - HALF_PIXEL + reach)
    return Box(
        left=(_minimum_of_3(gx) + begin) >> bits,
        top=(_minimum_of_3(gy) + begin) >> bits,
        right=(_maximum_of_3(gx) + end) >> bits,
        bottom=(_maximum_of_3(gy) + end) >> bits,
    )


@inlined
def _edge_function(xa, ya, xb, yb, px, py):
    """Return the edge function of a -> b at the grid point (px, py), and its changes per column and row; all i32x8.

    The function is lowered by one where the edge is open, neither left nor top. With positive area and y down, left
    edges run upwards and top edges to the right.
    """
    zero, one, bits = vec.i32(0), vec.i32(1), vec.i32(SUBPIXEL_BITS)
    edge_x = xb - xa
    edge_y = yb - ya
    closed = (edge_y < zero) | ((edge_y == zero) & (edge_x > zero))
    value = edge_x * (py - ya) - edge_y * (px - xa)
    return vec.select(closed, value, value - one), zero - (edge_y << bits), edge_x << bits


@inlined
def _edge_functions(gx, gy, box):
    """Return the EDGES of clockwise triangles with corners on the grid."""
    bits, half = vec.i32(SUBPIXEL_BITS), vec.i32(HALF_PIXEL)
    px, py = (box.left << bits) + half, (box.top << bits) + half
    e0, dx0, dy0 = _edge_function(gx[0], gy[0], gx[1], gy[1], px, py)
    e1, dx1, dy1 = _edge_function(gx[1], gy[1], gx[2], gy[2], px, py)
    e2, dx2, dy2 = _edge_function(gx[2], gy[2], gx[0], gy[0], px, py)
    return Edges(first=(e0, e1, e2), dx=(dx0, dx1, dx2), dy=(dy0, dy1, dy2))


@inlined
def _inv_z_plane(x, y, w, box):
    """Return the INV_Z of the plane through the vertices before snapping; the same for both windings."""
    ax, ay, aw = vec.to_f64(x[0]), vec.to_f64(y[0]), vec.to_f64(w[0])
    ux, uy, uw = vec.to_f64(x[1]) - ax, vec.to_f64(y[1]) - ay, vec.to_f64(w[1]) - aw
    vx, vy, vw = vec.to_f64(x[2]) - ax, vec.to_f64(y[2]) - ay, vec.to_f64(w[2]) - aw
    determinant = ux * vy - vx * uy
    zero, half = vec.f64(0.0), vec.f64(0.5)
    is_flat = determinant == zero
    inverse = vec.f64(1.0) / vec.select(is_flat, vec.f64(1.0), determinant)
    dx = vec.select(is_flat, zero, (uw * vy - vw * uy) * inverse)
    dy = vec.select(is_flat, zero, (vw * ux - uw * vx) * inverse)
    first = aw + (dx * (vec.to_f64(box.left) + half - ax) + dy * (vec.to_f64(box.top) + half - ay))
    return InvZ(
        first=vec.to_f32(first), dx=vec.to_f32(dx), dy=vec.to_f32(dy), min=_minimum_of_3(w), max=_maximum_of_3(w)
    )


@device_function
def set_up_triangles(frame, draw_index, begin, end, chunk):
    """Set up the triangles ``begin .. end`` of a draw, and append what may be visible to a CHUNK."""
    # One loop: a function call for every eight would take a fifth of the time of those that are not visible.
    draw = frame.draws[draw_index]
    vertices, columns = advance(frame.vertices, 4 * draw.first_vertex), _column_array()
    for triangle in range(begin, end, vec.LANES):
        _set_up_eight(frame, draw_index, vertices, triangle, min(end - triangle, vec.LANES), columns, chunk)


@inlined
def _swap_last_two(swapped, corners):
    """Return a coordinate of the three corners, the last two exchanged in the lanes of ``swapped``."""
    return _select3(swapped, (corners[0], corners[2], corners[1]), corners)


@inlined
def _set_up_eight(frame, draw_index, vertices, first, lanes, columns, chunk):
    """Set up the triangles ``first .. first + lanes`` (at most eight) of a draw.

    Those of at most TINY_SIDE x TINY_SIDE pixels are rasterized here, all at once, and leave their pixels. Small ones
    become SMALL_TRIANGLEs. Large and clipped ones take the scalar path.

    Args:
        vertices: pointer to the draw's first vertex.
        columns: pointer to 16 x 8 int32 of scratch.
    """
    draw = frame.draws[draw_index]
    x, y, w = _load_triangles(draw, first, lanes, vertices, columns)
    inv_z_min, inv_z_max = _minimum_of_3(w), _maximum_of_3(w)
    zero, zeros = vec.i32(0), (vec.f32(0.0), vec.f32(0.0), vec.f32(0.0))
    used = vec.iota() < vec.i32(lanes)
    clipped = vec.movemask(used & (inv_z_min < zeros[0]) & (inv_z_max > vec.f32(BEHIND)))
    visible = used & (inv_z_min > zeros[0]) & (inv_z_max >= vec.f32(np.float32(1.0 / frame.far)))
    if vec.movemask(visible) == 0 and clipped == 0:
        return
    x, y = _select3(visible, x, zeros), _select3(visible, y, zeros)  # those of the other lanes may be infinite
    gx, gy = _snap_to_grid(x), _snap_to_grid(y)
    box = _bounding_box(gx, gy, frame.sample_reach)
    width, height = box.right - box.left, box.bottom - box.top
    visible = visible & (vec.maximum(box.left, zero) < vec.minimum(box.right, vec.i32(frame.width)))
    visible = visible & (vec.maximum(box.top, zero) < vec.minimum(box.bottom, vec.i32(frame.height)))
    fits = (width <= vec.i32(MAX_SMALL_WIDTH)) & (height <= vec.i32(MAX_SMALL_HEIGHT))
    fits = fits & (inv_z_max <= inv_z_min * vec.f32(MAX_SMALL_DEPTH_RATIO))
    large = vec.movemask(visible & ~fits) | clipped
    area = (gx[1] - gx[0]) * (gy[2] - gy[0]) - (gx[2] - gx[0]) * (gy[1] - gy[0])
    # The sign alone: of a triangle that is not small, -area may overflow.
    area_sign = vec.select(area < zero, vec.i32(-1), vec.i32(1))
    small = visible & fits & (area != zero) & (area_sign != vec.i32(draw.hidden_sign))
    is_back = area_sign == vec.i32(draw.culled_sign)
    if frame.first_back_bin == 0:
        small = small & ~is_back
    if vec.movemask(small) == 0 and large == 0:
        return
    gx, gy = _swap_last_two(area < zero, gx), _swap_last_two(area < zero, gy)
    edges = _edge_functions(gx, gy, box)
    inv_z = _inv_z_plane(x, y, w, box)
    tiny = small & _is_tiny(frame, box, chunk.pixel_count)
    ids = vec.i32(draw.first_id + first) + vec.iota()
    if vec.movemask(tiny) != 0:
        _rasterize_tiny(frame, tiny, is_back, ids, box, edges, inv_z, chunk)
    small_lanes = vec.movemask(small & ~tiny)
    if small_lanes != 0:
        _store_columns(columns, ids, box, edges, inv_z)
    if small_lanes | large != 0:
        _append_primitives(frame, draw_index, first, small_lanes, large, vec.movemask(is_back), columns, chunk)


@inlined
def _is_tiny(frame, box, pixel_count):
    """Return m8: boxes of at most TINY_SIDE x TINY_SIDE pixels, all in the image, if there is room for their pixels."""
    zero = vec.i32(0)
    tiny = (box.right - box.left <= vec.i32(TINY_SIDE)) & (box.bottom - box.top <= vec.i32(TINY_SIDE))
    tiny = tiny & (box.left >= zero) & (box.right <= vec.i32(frame.width))
    tiny = tiny & (box.top >= zero) & (box.bottom <= vec.i32(frame.height))
    if pixel_count > MAX_TINY_PIXELS - vec.LANES * TINY_SIDE * TINY_SIDE or frame.sample_reach != 0:
        tiny = tiny & (zero < zero)  # no room left, or several samples
    return tiny


@inlined
def _rasterize_tiny(frame, tiny, is_back, ids, box, edges, inv_z, chunk):
    """Append the pixels of tiny triangles, at most TINY_SIDE x TINY_SIDE of each, to a CHUNK.

    Args:
        tiny: m8, the triangles to draw.
        is_back: m8, back faces that are kept.
        ids: i32x8, primitive ids.
    """
    corner = box.top * vec.i32(frame.stride) + box.left
    corner = vec.select(is_back, corner | vec.i32(BACK_BIT), corner)
    # Nearly all have at most three pixels a side: all nine cost less than a mispredicted number of them.
    three = vec.i32(TINY_SIDE - 1)
    is_wide = (box.right - box.left > three) | (box.bottom - box.top > three)
    sides = TINY_SIDE - 1 + (vec.movemask(tiny & is_wide) != 0)
    count = chunk.pixel_count
    row_e0, row_e1, row_e2 = edges.first
    for row in range(sides):
        row_inv_z = inv_z.first + inv_z.dy * vec.f32(np.float32(row))
        e0, e1, e2 = row_e0, row_e1, row_e2
        for column in range(sides):
            pixel_inv_z = row_inv_z + inv_z.dx * vec.f32(np.float32(column))
            pixel_inv_z = vec.minimum(vec.maximum(pixel_inv_z, inv_z.min), inv_z.max)
            covered = tiny & ((e0 | e1 | e2) >= vec.i32(0))
            pixel = corner + vec.i32(row * frame.stride + column)
            count = _append_pixels(chunk, count, covered, pixel, pixel_inv_z, ids)
            e0, e1, e2 = e0 + edges.dx[0], e1 + edges.dx[1], e2 + edges.dx[2]
        row_e0, row_e1, row_e2 = row_e0 + edges.dy[0], row_e1 + edges.dy[1], row_e2 + edges.dy[2]
    chunk.pixel_count = count


@inlined
def _append_pixels(chunk, count, covered, pixel, inv_z, ids):
    """Append one pixel of each covered triangle to a CHUNK that has ``count``; return the new ``count``.

    Without a branch, since coverage cannot be predicted. Up to seven values beyond the last are overwritten.
    """
    vec.store(chunk.pixels, count, vec.compress(covered, pixel))
    vec.store(chunk.pixel_inv_z, count, vec.compress(covered, inv_z))
    vec.store(chunk.pixel_ids, count, vec.compress(covered, ids))
    return count + vec.count_bits(vec.movemask(covered))


@inlined
def _store_columns(columns, ids, box, edges, inv_z):
    """Write eight SMALL_TRIANGLEs to ``columns``: a row of eight lanes for each field, in its order."""
    low_half = vec.i32(0xFFFF)
    fields = (
        *edges.first,
        edges.dx[0],
        edges.dx[1],
        edges.dy[0],
        ids,
        vec.i32(KIND_SMALL),
        edges.dy[1],
        (box.top << vec.i32(16)) | (box.left & low_half),
        ((box.bottom - box.top) << vec.i32(16)) | (box.right - box.left),
        vec.float_bits(inv_z.first),
        vec.float_bits(inv_z.dx),
        vec.float_bits(inv_z.dy),
        vec.float_bits(inv_z.min),
        vec.float_bits(inv_z.max),
    )
    row = 0
    for field in fields:
        vec.store(columns, row, field)
        row += vec.LANES


@inlined
def _append_primitives(frame, draw_index, first, small_lanes, large_lanes, back_lanes, columns, chunk):
    """Append the small triangles in ``columns``, and the large ones, to a CHUNK in the order of their lanes.

    Args:
        first: index of the first of the eight triangles in its mesh.
        small_lanes, large_lanes, back_lanes: a bit for each triangle that is small, large or clipped, a back face.
    """
    count = chunk.count
    pending = small_lanes | large_lanes
    while pending != 0:
        k = vec.lowest_bit(pending)
        bit = np.int64(1) << k
        pending &= pending - 1
        out = chunk.primitives[count]
        if bit & small_lanes:
            values = i32_at(address(out))
            for field in range(_SMALL_FIELDS):
                values[field] = columns[vec.LANES * field + k]
            triangle = small_triangle_at(address(out))
            from_row = np.int64(triangle.box_corner) >> 16
            to_row = from_row + (np.int64(triangle.box_size) >> 16) - 1
            first_bin = frame.first_back_bin if bit & back_lanes else 0
            begin = first_bin + (max(from_row, 0) >> _BAND_SHIFT)  # type: ignore[operator]  # Numba's int
            end = first_bin + (min(to_row, frame.height - 1) >> _BAND_SHIFT)
        else:
            begin, end = set_up_large_triangle(frame, draw_index, first + k, out)
            out.id = frame.draws[draw_index].first_id + first + k
        if begin <= end:
            chunk.bins[count] = end << 16 | begin
            count += 1
    chunk.count = count
