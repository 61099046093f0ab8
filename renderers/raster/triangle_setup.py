"""Setup of triangles, eight at a time, one per lane."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import address, as_f32, as_u32, f32_at, i32_at, u32_at
from renderers.raster.layout import (
    BINNED_BYTES,
    HALF_PIXEL,
    KIND_SMALL,
    MAX_SMALL_DEPTH_RATIO,
    MAX_SMALL_HEIGHT,
    MAX_SMALL_WIDTH,
    MAX_TINY_PIXELS,
    SUBPIXEL,
    SUBPIXEL_BITS,
    TINY_SIDE,
    TINY_STRIDE,
    binned_at,
    small_triangle_at,
)
from renderers.raster.primitive_setup import set_up_large_triangle
from renderers.raster.transform import BEHIND
from renderers.visibility_buffer import BAND_ROWS

BAND_SHIFT: Final = BAND_ROWS.bit_length() - 1
BACK_BIT: Final = -(1 << 31)
"""Marks pixels of back faces that are kept, in ``SETUP_MEMORY.tiny_pixels``."""
_PREFETCH_DISTANCE: Final = 64
"""Triangles from the current one to that whose vertices are prefetched; hardware does not prefetch across pages."""

# Rows of SETUP_MEMORY.columns: the int32 fields of eight SMALL_TRIANGLEs.
_VALUES: Final = BINNED_BYTES // 4
_EDGES: Final = 0
_EDGE_DX: Final = 8 * 3
_EDGE0_DY: Final = 8 * 5
_EDGE1_DY: Final = 8 * 8
_BOX_CORNER: Final = 8 * 9
_BOX_SIZE: Final = 8 * 10
_INV_Z_BASE: Final = 8 * 11
_INV_Z_DX: Final = 8 * 12
_INV_Z_DY: Final = 8 * 13
_INV_Z_MIN: Final = 8 * 14
_INV_Z_MAX: Final = 8 * 15


@inlined
def _edge_function(xa, ya, xb, yb, px, py):
    """Return the edge function of a -> b at the grid point (px, py), and the edge as a vector; all i32x8.

    The function is lowered by one where the edge is open, neither left nor top. With positive area and y down, left
    edges run upwards and top edges to the right.
    """
    zero, one = vec.i32(0), vec.i32(1)
    edge_x = xb - xa
    edge_y = yb - ya
    closed = (edge_y < zero) | ((edge_y == zero) & (edge_x > zero))
    value = edge_x * (py - ya) - edge_y * (px - xa)
    return vec.select(closed, value, value - one), edge_x, edge_y


@device_function
def set_up_triangles(frame, draw_index, begin, end, memory):
    """Set up the triangles ``begin .. end`` of a draw, and append what is visible to ``memory``.

    Args:
        memory: a SETUP_MEMORY.
    """
    # One loop: a function call for every eight would take a fifth of the time of those that are not visible.
    draw = frame.draws[draw_index]
    far_inv_z = np.float32(1.0 / frame.far)
    vertices, indices = f32_at(address(frame.vertices) + 16 * draw.first_vertex), draw.indices
    for triangle in range(begin, end, vec.LANES):
        vec.prefetch(indices, 3 * (triangle + 2 * _PREFETCH_DISTANCE))
        vec.prefetch(indices, 3 * (triangle + 2 * _PREFETCH_DISTANCE) + 12)
        ahead = 3 * min(triangle + _PREFETCH_DISTANCE, end - 1)
        vec.prefetch(vertices, 4 * np.int64(indices[ahead]))
        vec.prefetch(vertices, 4 * np.int64(indices[ahead + 1]))
        vec.prefetch(vertices, 4 * np.int64(indices[ahead + 2]))
        _set_up_eight(frame, draw_index, far_inv_z, triangle, min(end - triangle, vec.LANES), memory)


@inlined
def _append_pixels(pixels, count, covered, pixel, inv_z, ids):
    """Append one pixel of each covered triangle to ``SETUP_MEMORY.tiny_pixels``; return the new ``count``.

    Without a branch, since coverage cannot be predicted. Up to seven values beyond the last are overwritten.
    """
    vec.store(pixels, count, vec.compress(covered, pixel))
    vec.store(pixels, TINY_STRIDE + count, vec.compress(covered, vec.float_bits(inv_z)))
    vec.store(pixels, 2 * TINY_STRIDE + count, vec.compress(covered, ids))
    return count + vec.count_bits(vec.movemask(covered))


@inlined
def _set_up_eight(frame, draw_index, far_inv_z, first, lanes, memory):
    """Set up the triangles ``first .. first + lanes`` (at most eight) of a draw.

    Those of at most TINY_SIDE x TINY_SIDE pixels are rasterized here, all at once, and leave their pixels. Small ones
    become SMALL_TRIANGLEs. Large and clipped ones take the scalar path.

    Args:
        far_inv_z: 1/z of the far plane, float32.
        memory: as for ``set_up_triangles``.
    """
    draw = frame.draws[draw_index]
    vertices = f32_at(address(frame.vertices) + 16 * draw.first_vertex)
    indices = u32_at(address(draw.indices) + 12 * first)
    columns = memory.columns
    lane = vec.iota()
    if lanes < vec.LANES:  # the other lanes repeat the last triangle and are not used
        padded = as_u32(columns)
        for k in range(vec.LANES):
            for corner in range(3):
                padded[3 * k + corner] = indices[3 * min(k, lanes - 1) + corner]
        indices = padded
    x0, y0, w0 = vec.load_corners(vertices, indices, 0)  # w: 1/z
    x1, y1, w1 = vec.load_corners(vertices, indices, 1)
    x2, y2, w2 = vec.load_corners(vertices, indices, 2)
    zero_f32 = vec.f32(0.0)
    inv_z_max = vec.maximum(vec.maximum(w0, w1), w2)
    inv_z_min = vec.minimum(vec.minimum(w0, w1), w2)
    used = lane < vec.i32(lanes)
    clipped_lanes = vec.movemask(used & (inv_z_min < zero_f32) & (inv_z_max > vec.f32(BEHIND)))
    visible = used & (inv_z_min > zero_f32) & (inv_z_max >= vec.f32(far_inv_z))
    if vec.movemask(visible) == 0 and clipped_lanes == 0:
        return

    # Coordinates of the other lanes may be infinite.
    x0, y0 = vec.select(visible, x0, zero_f32), vec.select(visible, y0, zero_f32)
    x1, y1 = vec.select(visible, x1, zero_f32), vec.select(visible, y1, zero_f32)
    x2, y2 = vec.select(visible, x2, zero_f32), vec.select(visible, y2, zero_f32)
    grid = vec.f32(float(SUBPIXEL))
    gx0, gy0 = vec.to_i32(vec.rint(x0 * grid)), vec.to_i32(vec.rint(y0 * grid))
    gx1, gy1 = vec.to_i32(vec.rint(x1 * grid)), vec.to_i32(vec.rint(y1 * grid))
    gx2, gy2 = vec.to_i32(vec.rint(x2 * grid)), vec.to_i32(vec.rint(y2 * grid))
    # first_center(): ceil((value - 128) / 256). With samples: all pixels that may have a sample inside.
    reach = frame.sample_reach
    bits, zero = vec.i32(SUBPIXEL_BITS), vec.i32(0)
    round_begin, round_end = vec.i32(SUBPIXEL - 1 - HALF_PIXEL - reach), vec.i32(SUBPIXEL - 1 - HALF_PIXEL + reach)
    left = (vec.minimum(vec.minimum(gx0, gx1), gx2) + round_begin) >> bits
    right = (vec.maximum(vec.maximum(gx0, gx1), gx2) + round_end) >> bits
    top = (vec.minimum(vec.minimum(gy0, gy1), gy2) + round_begin) >> bits
    bottom = (vec.maximum(vec.maximum(gy0, gy1), gy2) + round_end) >> bits
    image_width, image_height = vec.i32(frame.width), vec.i32(frame.height)
    visible = visible & (vec.maximum(left, zero) < vec.minimum(right, image_width))
    visible = visible & (vec.maximum(top, zero) < vec.minimum(bottom, image_height))
    width = right - left
    height = bottom - top
    fits = (width <= vec.i32(MAX_SMALL_WIDTH)) & (height <= vec.i32(MAX_SMALL_HEIGHT))
    fits = fits & (inv_z_max <= inv_z_min * vec.f32(MAX_SMALL_DEPTH_RATIO))
    scalar_lanes = vec.movemask(visible & ~fits) | clipped_lanes
    area = (gx1 - gx0) * (gy2 - gy0) - (gx2 - gx0) * (gy1 - gy0)
    # The sign alone: of a triangle that is not small, -area may overflow.
    area_sign = vec.select(area < zero, vec.i32(-1), vec.i32(1))
    small = visible & fits & (area != zero) & (area_sign != vec.i32(draw.hidden_sign))
    is_back = area_sign == vec.i32(draw.culled_sign)
    first_back_bin = frame.bin_count - frame.band_count
    if first_back_bin == 0:
        small = small & ~is_back
    if vec.movemask(small) == 0 and scalar_lanes == 0:
        return

    is_clockwise = area < zero
    gx1, gx2 = vec.select(is_clockwise, gx2, gx1), vec.select(is_clockwise, gx1, gx2)
    gy1, gy2 = vec.select(is_clockwise, gy2, gy1), vec.select(is_clockwise, gy1, gy2)
    px = (left << bits) + vec.i32(HALF_PIXEL)
    py = (top << bits) + vec.i32(HALF_PIXEL)
    e0, edge0_x, edge0_y = _edge_function(gx0, gy0, gx1, gy1, px, py)
    e1, edge1_x, edge1_y = _edge_function(gx1, gy1, gx2, gy2, px, py)
    e2, edge2_x, edge2_y = _edge_function(gx2, gy2, gx0, gy0, px, py)
    e0_dx, e1_dx, e2_dx = zero - (edge0_y << bits), zero - (edge1_y << bits), zero - (edge2_y << bits)
    e0_dy, e1_dy, e2_dy = edge0_x << bits, edge1_x << bits, edge2_x << bits

    # The plane of 1/z through the vertices before snapping; the same for both windings.
    ax, ay = vec.to_f64(x0), vec.to_f64(y0)
    ux, uy = vec.to_f64(x1) - ax, vec.to_f64(y1) - ay
    vx, vy = vec.to_f64(x2) - ax, vec.to_f64(y2) - ay
    wa = vec.to_f64(w0)
    wu, wv = vec.to_f64(w1) - wa, vec.to_f64(w2) - wa
    determinant = ux * vy - vx * uy
    zero_f64, half = vec.f64(0.0), vec.f64(0.5)
    is_flat = determinant == zero_f64
    inverse = vec.f64(1.0) / vec.select(is_flat, vec.f64(1.0), determinant)
    slope_x = vec.select(is_flat, zero_f64, (wu * vy - wv * uy) * inverse)
    slope_y = vec.select(is_flat, zero_f64, (wv * ux - wu * vx) * inverse)
    inv_z_base = vec.to_f32(wa + (slope_x * (vec.to_f64(left) + half - ax) + slope_y * (vec.to_f64(top) + half - ay)))
    inv_z_dx = vec.to_f32(slope_x)
    inv_z_dy = vec.to_f32(slope_y)

    first_id = draw.first_id + first
    tiny = small & (width <= vec.i32(TINY_SIDE)) & (height <= vec.i32(TINY_SIDE))
    tiny = tiny & (left >= zero) & (right <= image_width) & (top >= zero) & (bottom <= image_height)
    if memory.tiny_count > MAX_TINY_PIXELS - vec.LANES * TINY_SIDE * TINY_SIDE or reach != 0:
        tiny = tiny & (lane < zero)  # no room left, or several samples
    if vec.movemask(tiny) != 0:
        stride = frame.stride
        corner, ids = top * vec.i32(stride) + left, vec.i32(first_id) + lane
        corner = vec.select(is_back, corner | vec.i32(BACK_BIT), corner)
        # Nearly all have at most three pixels a side: all nine cost less than a mispredicted number of them.
        three = vec.i32(TINY_SIDE - 1)
        sides = TINY_SIDE - 1 + (vec.movemask(tiny & ((width > three) | (height > three))) != 0)
        pixels, tiny_count = memory.tiny_pixels, memory.tiny_count
        row_e0, row_e1, row_e2 = e0, e1, e2
        for row in range(sides):
            row_inv_z = inv_z_base + inv_z_dy * vec.f32(np.float32(row))
            c0, c1, c2 = row_e0, row_e1, row_e2
            for column in range(sides):
                inv_z = row_inv_z + inv_z_dx * vec.f32(np.float32(column))
                inv_z = vec.minimum(vec.maximum(inv_z, inv_z_min), inv_z_max)
                covered = tiny & ((c0 | c1 | c2) >= zero)
                pixel = corner + vec.i32(row * stride + column)
                tiny_count = _append_pixels(pixels, tiny_count, covered, pixel, inv_z, ids)
                c0, c1, c2 = c0 + e0_dx, c1 + e1_dx, c2 + e2_dx
            row_e0, row_e1, row_e2 = row_e0 + e0_dy, row_e1 + e1_dy, row_e2 + e2_dy
        memory.tiny_count = tiny_count

    small_lanes = vec.movemask(small & ~tiny)
    pending = small_lanes | scalar_lanes
    if pending == 0:
        return
    if small_lanes != 0:
        columns_f32 = as_f32(columns)
        vec.store(columns_f32, _INV_Z_MIN, inv_z_min)
        vec.store(columns_f32, _INV_Z_MAX, inv_z_max)
        vec.store(columns, _BOX_CORNER, (top << vec.i32(16)) | (left & vec.i32(0xFFFF)))
        vec.store(columns, _BOX_SIZE, (height << vec.i32(16)) | width)
        vec.store(columns, _EDGES, e0)
        vec.store(columns, _EDGES + 8, e1)
        vec.store(columns, _EDGES + 16, e2)
        vec.store(columns, _EDGE_DX, e0_dx)
        vec.store(columns, _EDGE_DX + 8, e1_dx)
        vec.store(columns, _EDGE0_DY, e0_dy)
        vec.store(columns, _EDGE1_DY, e1_dy)
        vec.store(columns_f32, _INV_Z_BASE, inv_z_base)
        vec.store(columns_f32, _INV_Z_DX, inv_z_dx)
        vec.store(columns_f32, _INV_Z_DY, inv_z_dy)
    ranges = memory.bin_ranges
    last_row = frame.height - 1
    back_lanes = vec.movemask(is_back)
    count = memory.count
    while pending != 0:
        k = vec.lowest_bit(pending)
        bit = np.int64(1) << k
        pending &= pending - 1
        out_address = memory.binned + BINNED_BYTES * count
        if bit & small_lanes:
            values = i32_at(out_address)
            for field in range(_VALUES):
                values[field] = columns[8 * field + k]
            out = small_triangle_at(out_address)
            out.id = first_id + k
            out.kind = KIND_SMALL
            from_row = np.int64(columns[_BOX_CORNER + k]) >> 16
            to_row = from_row + (np.int64(columns[_BOX_SIZE + k]) >> 16) - 1
            first_bin = first_back_bin if bit & back_lanes else 0
            ranges[2 * count] = first_bin + (max(from_row, 0) >> BAND_SHIFT)  # type: ignore[operator]  # Numba's int
            ranges[2 * count + 1] = first_bin + (min(to_row, last_row) >> BAND_SHIFT)
            count += 1
        else:
            begin, end = set_up_large_triangle(frame, draw_index, first + k, binned_at(out_address))
            if begin <= end:
                binned_at(out_address).id = first_id + k
                ranges[2 * count] = begin
                ranges[2 * count + 1] = end
                count += 1
    memory.count = count
