"""Setup of triangles, eight at a time."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import address, as_f32, as_u32, f32_at, i32_at, u32_at
from renderers.raster.cluster_culling import SHIFT, visible_clusters
from renderers.raster.layout import (
    BINNED_BYTES,
    CHUNK,
    DEFERRED,
    MAX_DEFERRED_SIDE,
    SMALL,
    SMALL_HEIGHT,
    SMALL_RATIO,
    SMALL_WIDTH,
    TINY,
    TINY_PIXELS,
    TINY_ROOM,
    binned_at,
    deferred_at,
    small_at,
)
from renderers.raster.primitive_setup import large_triangle
from renderers.raster.transform import BEHIND
from renderers.visibility_buffer import BAND_ROWS

BAND_SHIFT: Final = BAND_ROWS.bit_length() - 1
BACK_BIT: Final = -(1 << 31)
"""Marks pixels of kept back faces in ``SETUP_MEMORY.tiny``."""
_VALUES: Final = BINNED_BYTES // 4
_AHEAD: Final = 64
"""Triangles whose vertices are prefetched; hardware does not prefetch across pages."""

# Rows of SETUP_MEMORY.columns: the fields of eight SMALL_TRIANGLEs.
_EDGES: Final = 0
_RIGHT: Final = 8 * 3
_DOWN: Final = 8 * 5
_DOWN_SECOND: Final = 8 * 8
_BOX: Final = 8 * 9
_SIZE: Final = 8 * 10
_BASE: Final = 8 * 11
_DX: Final = 8 * 12
_DY: Final = 8 * 13
_LOW: Final = 8 * 14
_HIGH: Final = 8 * 15


@inlined
def _edge(xa, ya, xb, yb, px, py):
    """Return the edge function at the grid point (px, py), and the edge's extent; all i32x8.

    The function is lowered by one where the edge is open, neither left nor top. With positive area and y down, left
    edges run upwards and top edges to the right.
    """
    zero, one = vec.i32(0), vec.i32(1)
    dx = xb - xa
    dy = yb - ya
    closed = (dy < zero) | ((dy == zero) & (dx > zero))
    value = dx * (py - ya) - dy * (px - xa)
    return vec.select(closed, value, value - one), dx, dy


@device_function
def set_up_triangles(frame, draw, index, begin, end, deferred, memory, count, tiny_count, view):
    """Set up the triangles ``begin .. end`` of a draw; see ``_set_up_eight``.

    Args:
        view: as filled by ``view_clusters``.
    """
    # One loop: a function call for every eight would take a fifth of the time of those that are not visible.
    farthest = np.float32(1.0 / frame.far)
    vertices, indices = f32_at(address(frame.vertices) + 16 * draw.first_vertex), draw.indices
    # Sixteen clusters at a time, for prefetching.
    base = ((begin >> SHIFT) & ~np.int64(vec.LANES - 1)) - 2 * vec.LANES
    visible = np.int64(0)
    triangle = begin
    while triangle < end:
        k = (triangle >> SHIFT) - base
        if k >= vec.LANES:
            base += vec.LANES
            following = np.int64(255)
            if view.clusters != 0 and (base + vec.LANES) << SHIFT < end:
                following = visible_clusters(view, base + vec.LANES)
            visible = (visible >> vec.LANES) | (following << vec.LANES)
            continue
        if (visible >> k) & 1 == 0:
            triangle = (base + k + vec.lowest_bit((visible | 65536) >> k)) << SHIFT
            continue
        # Groups of eight begin where clusters do.
        lanes = min(end - triangle, vec.LANES - (triangle & (vec.LANES - 1) if deferred == 0 else 0))
        if (visible >> (k + (_AHEAD >> SHIFT))) & 1:
            vec.prefetch(indices, 3 * (triangle + 2 * _AHEAD))
            vec.prefetch(indices, 3 * (triangle + 2 * _AHEAD) + 12)
            later = 3 * min(triangle + _AHEAD, end - 1)
            vec.prefetch(vertices, 4 * np.int64(indices[later]))
            vec.prefetch(vertices, 4 * np.int64(indices[later + 1]))
            vec.prefetch(vertices, 4 * np.int64(indices[later + 2]))
        count, tiny_count = _set_up_eight(
            frame, draw, index, farthest, triangle, lanes, deferred, memory, count, tiny_count
        )
        triangle += lanes
    return count, tiny_count


@inlined
def _append_pixels(tiny, tiny_count, covered, pixels, w, ids):
    """Append a pixel of each covered triangle and return the new ``tiny_count``.

    Without a branch, since coverage cannot be predicted. Up to seven values beyond the last are overwritten.
    """
    vec.store(tiny, tiny_count, vec.compress(covered, pixels))
    vec.store(tiny, TINY_ROOM + tiny_count, vec.compress(covered, vec.float_bits(w)))
    vec.store(tiny, 2 * TINY_ROOM + tiny_count, vec.compress(covered, ids))
    return tiny_count + vec.count_bits(vec.movemask(covered))


@inlined
def _set_up_eight(frame, draw, index, farthest, first, lanes, deferred, memory, count, tiny_count):
    """Set up the triangles ``first .. first + lanes`` (at most eight) of a draw.

    Those of at most TINY x TINY pixels are rasterized here, all at once, and leave their pixels. Small ones become
    SMALL_TRIANGLEs. Large and clipped ones take the scalar path. Kept back faces that are small and near one another
    are deferred.

    Args:
        index: of the draw.
        farthest: 1/z of the far plane.
        deferred: mask of the lanes to set up, which were deferred; 0: all lanes, for the first time.
        memory: a SETUP_MEMORY that holds ``count`` primitives and ``tiny_count`` pixels.

    Returns:
        The new ``count`` and ``tiny_count``.
    """
    vertices = f32_at(address(frame.vertices) + 16 * draw.first_vertex)
    indices = u32_at(address(draw.indices) + 12 * first)
    columns = memory.columns
    lane = vec.iota()
    if lanes < vec.LANES:  # the other lanes repeat the last triangle and are not used
        padded = as_u32(columns)
        for k in range(vec.LANES):
            for c in range(3):
                padded[3 * k + c] = indices[3 * min(k, lanes - 1) + c]
        indices = padded
    x0, y0, w0 = vec.load_corners(vertices, indices, 0)
    x1, y1, w1 = vec.load_corners(vertices, indices, 1)
    x2, y2, w2 = vec.load_corners(vertices, indices, 2)
    none = vec.f32(0.0)
    high = vec.maximum(vec.maximum(w0, w1), w2)
    low = vec.minimum(vec.minimum(w0, w1), w2)
    used = lane < vec.i32(lanes)
    usual = used & (low > none)
    clipped = vec.movemask(used & (low < none) & (high > vec.f32(BEHIND)))
    usual = usual & (high >= vec.f32(farthest))
    if vec.movemask(usual) == 0 and clipped == 0:
        return count, tiny_count

    # Coordinates of the other lanes may be infinite.
    x0, y0 = vec.select(usual, x0, none), vec.select(usual, y0, none)
    x1, y1 = vec.select(usual, x1, none), vec.select(usual, y1, none)
    x2, y2 = vec.select(usual, x2, none), vec.select(usual, y2, none)
    grid = vec.f32(256.0)
    gx0, gy0 = vec.to_i32(vec.rint(x0 * grid)), vec.to_i32(vec.rint(y0 * grid))
    gx1, gy1 = vec.to_i32(vec.rint(x1 * grid)), vec.to_i32(vec.rint(y1 * grid))
    gx2, gy2 = vec.to_i32(vec.rint(x2 * grid)), vec.to_i32(vec.rint(y2 * grid))
    # first_center(): ceil((value - 128) / 256). With samples: all pixels that may have a sample inside.
    reach = frame.sample_reach
    before, after, eight, zero = vec.i32(127 - reach), vec.i32(127 + reach), vec.i32(8), vec.i32(0)
    left = (vec.minimum(vec.minimum(gx0, gx1), gx2) + before) >> eight
    right = (vec.maximum(vec.maximum(gx0, gx1), gx2) + after) >> eight
    top = (vec.minimum(vec.minimum(gy0, gy1), gy2) + before) >> eight
    bottom = (vec.maximum(vec.maximum(gy0, gy1), gy2) + after) >> eight
    image_width, image_height = vec.i32(frame.width), vec.i32(frame.height)
    inside = (vec.maximum(left, zero) < vec.minimum(right, image_width)) & (
        vec.maximum(top, zero) < vec.minimum(bottom, image_height)
    )
    usual = usual & inside
    width = right - left
    height = bottom - top
    fits = (width <= vec.i32(SMALL_WIDTH)) & (height <= vec.i32(SMALL_HEIGHT)) & (high <= low * vec.f32(SMALL_RATIO))
    slow = vec.movemask(usual & ~fits) | clipped
    small = usual & fits
    area = (gx1 - gx0) * (gy2 - gy0) - (gx2 - gx0) * (gy1 - gy0)
    small = small & (area != zero)
    # The sign alone: of a triangle that is not small, -area may overflow.
    side = vec.select(area < zero, vec.i32(-1), vec.i32(1))
    small = small & (side != vec.i32(draw.hidden))
    back = side == vec.i32(draw.culled)
    backs = frame.bin_count - frame.band_count
    if backs == 0:
        small = small & ~back
    elif deferred != 0:
        small = small & (((vec.i32(deferred) >> lane) & vec.i32(1)) != zero)
        slow = 0
    else:
        waiting = small & back
        if vec.movemask(waiting) != 0:
            far, near = vec.i32(-(1 << 20)), vec.i32(1 << 20)
            box_x = vec.minimum_of(vec.select(waiting, left, near))
            box_y = vec.minimum_of(vec.select(waiting, top, near))
            end_x = vec.maximum_of(vec.select(waiting, right, far))
            end_y = vec.maximum_of(vec.select(waiting, bottom, far))
            if end_x - box_x <= MAX_DEFERRED_SIDE and end_y - box_y <= MAX_DEFERRED_SIDE:
                group = deferred_at(memory.binned + BINNED_BYTES * count)
                group.first = first
                group.lanes = vec.movemask(waiting)
                group.draw = index
                group.id = draw.first_id + first
                group.kind = DEFERRED
                group.box = (box_y << 16) | (box_x & 0xFFFF)
                group.size = ((end_y - box_y) << 16) | (end_x - box_x)
                greatest = vec.maximum_of(vec.select(waiting, vec.float_bits(high), zero))  # ordered as the floats are
                i32_at(address(group))[_VALUES - 1] = greatest
                memory.bin_ranges[2 * count] = backs + (max(box_y, 0) >> BAND_SHIFT)
                memory.bin_ranges[2 * count + 1] = backs + (min(end_y, frame.height) - 1 >> BAND_SHIFT)
                count += 1
                small = small & ~back
    if vec.movemask(small) == 0 and slow == 0:
        return count, tiny_count

    turned = area < zero
    gx1, gx2 = vec.select(turned, gx2, gx1), vec.select(turned, gx1, gx2)
    gy1, gy2 = vec.select(turned, gy2, gy1), vec.select(turned, gy1, gy2)
    px = (left << eight) + vec.i32(128)
    py = (top << eight) + vec.i32(128)
    e0, dx0, dy0 = _edge(gx0, gy0, gx1, gy1, px, py)
    e1, dx1, dy1 = _edge(gx1, gy1, gx2, gy2, px, py)
    e2, dx2, dy2 = _edge(gx2, gy2, gx0, gy0, px, py)

    # The plane of 1/z through the vertices before snapping; the same for both windings.
    ax, ay = vec.to_f64(x0), vec.to_f64(y0)
    ux, uy = vec.to_f64(x1) - ax, vec.to_f64(y1) - ay
    vx, vy = vec.to_f64(x2) - ax, vec.to_f64(y2) - ay
    wa = vec.to_f64(w0)
    wu, wv = vec.to_f64(w1) - wa, vec.to_f64(w2) - wa
    determinant = ux * vy - vx * uy
    nothing, half = vec.f64(0.0), vec.f64(0.5)
    flat = determinant == nothing
    inverse = vec.f64(1.0) / vec.select(flat, vec.f64(1.0), determinant)
    slope_x = vec.select(flat, nothing, (wu * vy - wv * uy) * inverse)
    slope_y = vec.select(flat, nothing, (wv * ux - wu * vx) * inverse)
    base = vec.to_f32(wa + (slope_x * (vec.to_f64(left) + half - ax) + slope_y * (vec.to_f64(top) + half - ay)))
    across = vec.to_f32(slope_x)
    down = vec.to_f32(slope_y)
    right0, right1, right2 = zero - (dy0 << eight), zero - (dy1 << eight), zero - (dy2 << eight)
    down0, down1, down2 = dx0 << eight, dx1 << eight, dx2 << eight

    first_id = draw.first_id + first
    tiny = small & (width <= vec.i32(TINY)) & (height <= vec.i32(TINY))
    tiny = tiny & (left >= zero) & (right <= image_width) & (top >= zero) & (bottom <= image_height)
    if tiny_count > CHUNK * TINY_PIXELS - vec.LANES * TINY * TINY or reach != 0:
        tiny = tiny & (lane < zero)  # no room left, or several samples
    if vec.movemask(tiny) != 0:
        stride = frame.stride
        corner, ids = top * vec.i32(stride) + left, vec.i32(first_id) + lane
        corner = vec.select(back, corner | vec.i32(BACK_BIT), corner)
        # Nearly all have at most three pixels a side: all nine cost less than a mispredicted number of them.
        most = vec.i32(TINY - 1)
        sides = TINY - 1 + (vec.movemask(tiny & ((width > most) | (height > most))) != 0)
        f0, f1, f2 = e0, e1, e2
        for r in range(sides):
            start = base + down * vec.f32(np.float32(r))
            c0, c1, c2 = f0, f1, f2
            for c in range(sides):
                w = vec.minimum(vec.maximum(start + across * vec.f32(np.float32(c)), low), high)
                pixels, covered = corner + vec.i32(r * stride + c), tiny & ((c0 | c1 | c2) >= zero)
                tiny_count = _append_pixels(memory.tiny, tiny_count, covered, pixels, w, ids)
                c0, c1, c2 = c0 + right0, c1 + right1, c2 + right2
            f0, f1, f2 = f0 + down0, f1 + down1, f2 + down2

    many = vec.movemask(small & ~tiny)
    pending = many | slow
    if pending == 0:
        return count, tiny_count
    if many != 0:
        fractions = as_f32(columns)
        vec.store(fractions, _LOW, low)
        vec.store(fractions, _HIGH, high)
        vec.store(columns, _BOX, (top << vec.i32(16)) | (left & vec.i32(0xFFFF)))
        vec.store(columns, _SIZE, (height << vec.i32(16)) | width)
        vec.store(columns, _EDGES, e0)
        vec.store(columns, _EDGES + 8, e1)
        vec.store(columns, _EDGES + 16, e2)
        vec.store(columns, _RIGHT, right0)
        vec.store(columns, _RIGHT + 8, right1)
        vec.store(columns, _DOWN, down0)
        vec.store(columns, _DOWN_SECOND, down1)
        vec.store(fractions, _BASE, base)
        vec.store(fractions, _DX, across)
        vec.store(fractions, _DY, down)
    ranges = memory.bin_ranges
    last_row = frame.height - 1
    back_lanes = vec.movemask(back)
    while pending != 0:
        k = vec.lowest_bit(pending)
        bit = np.int64(1) << k
        pending &= pending - 1
        place = memory.binned + BINNED_BYTES * count
        if bit & many:
            values = i32_at(place)
            for field in range(_VALUES):
                values[field] = columns[8 * field + k]
            out = small_at(place)
            out.id = first_id + k
            out.kind = SMALL
            from_row = np.int64(columns[_BOX + k]) >> 16
            to_row = from_row + (np.int64(columns[_SIZE + k]) >> 16) - 1
            shift = backs if bit & back_lanes else 0
            ranges[2 * count] = shift + (max(from_row, 0) >> BAND_SHIFT)  # type: ignore[operator]  # Numba's integers
            ranges[2 * count + 1] = shift + (min(to_row, last_row) >> BAND_SHIFT)
            count += 1
        else:
            begin, end = large_triangle(frame, draw, index, first + k, binned_at(place))
            if end >= begin:
                binned_at(place).id = first_id + k
                ranges[2 * count] = begin
                ranges[2 * count + 1] = end
                count += 1
    return count, tiny_count
