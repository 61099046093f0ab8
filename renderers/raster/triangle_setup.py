"""Eight triangles at a time to records."""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import as_f32, as_u32, f32_at, i32_at, i64_at, u32_at
from renderers.raster.cluster_culling import SHIFT, seen_clusters
from renderers.raster.layout import (
    CHUNK,
    G_DRAWN,
    G_ELEMENT,
    G_LANES,
    J_BANDS,
    J_HEIGHT,
    J_LISTS,
    J_MARGIN,
    J_STRIDE,
    J_TABLE,
    J_VERTEX,
    J_WIDTH,
    KIND_LATER,
    KIND_SMALL,
    L_FAR,
    LATER_SIDE,
    MICRO_PER_ELEMENT,
    MICRO_ROOM,
    R_HIGH,
    R_ID,
    R_KIND,
    R_LOW,
    RECORD_BYTES,
    S_BASE,
    S_BOX,
    S_DOWN,
    S_DOWN_SECOND,
    S_DX,
    S_DY,
    S_EDGES,
    S_RIGHT,
    S_SIZE,
    SMALL_HEIGHT,
    SMALL_RATIO,
    SMALL_WIDTH,
    T_COLUMNS,
    T_CULL,
    T_ELEMENTS,
    T_HIDDEN,
    T_RECORD,
    T_VERTEX,
    TINY,
)
from renderers.raster.primitive_setup import large_triangle
from renderers.raster.transform import BEHIND
from renderers.visibility_buffer import BAND_ROWS

RECORD_VALUES = RECORD_BYTES // 4
BAND_SHIFT = BAND_ROWS.bit_length() - 1
_AHEAD = 64
"""Triangles whose vertices are fetched before they are needed; at the ends of pages the processor does not do that."""


@inlined
def _edge(xa, ya, xb, yb, px, py):
    """The edge function at the grid point (px, py), lowered by one where the edge is open (neither left nor top), and
    the edge's extent; all i32x8. With positive area and y down, left edges run upwards, top edges to the right."""
    zero, one = vec.i32(0), vec.i32(1)
    dx = xb - xa
    dy = yb - ya
    closed = (dy < zero) | ((dy == zero) & (dx > zero))
    value = dx * (py - ya) - dy * (px - xa)
    return vec.select(closed, value, value - one), dx, dy


@inner
def triangles(job, lens, drawn, begin, end, late, record, spans, count, micro, micros, columns, clusters, view):
    """Set up the triangles ``begin .. end`` of a drawn instance; see ``_eight``.

    Args:
        clusters, view: see ``seen_clusters``; 0: none are known, all triangles are looked at.
    """
    # In one loop: to call a function for every eight takes a fifth of the time of those that are not seen.
    farthest = np.float32(1.0 / lens[L_FAR])
    row = drawn * T_COLUMNS
    table = i64_at(job[J_TABLE])
    vertices, indices = f32_at(job[J_VERTEX] + 16 * table[row + T_VERTEX]), u32_at(table[row + T_ELEMENTS])
    # Sixteen clusters at a time, so that it is known what to fetch ahead.
    base = ((begin >> SHIFT) & ~np.int64(vec.LANES - 1)) - 2 * vec.LANES
    seen = np.int64(0)
    element = begin
    while element < end:
        k = (element >> SHIFT) - base
        if k >= vec.LANES:
            base += vec.LANES
            following = np.int64(255)
            if clusters != 0 and (base + vec.LANES) << SHIFT < end:
                following = seen_clusters(clusters, view, base + vec.LANES)
            seen = (seen >> vec.LANES) | (following << vec.LANES)
            continue
        if (seen >> k) & 1 == 0:
            element = (base + k + vec.lowest_bit((seen | 65536) >> k)) << SHIFT
            continue
        # In groups that begin where clusters do.
        lanes = min(end - element, vec.LANES - (element & (vec.LANES - 1) if late == 0 else 0))
        if (seen >> (k + (_AHEAD >> SHIFT))) & 1:
            vec.prefetch(indices, 3 * (element + 2 * _AHEAD))
            vec.prefetch(indices, 3 * (element + 2 * _AHEAD) + 12)
            later = 3 * min(element + _AHEAD, end - 1)
            vec.prefetch(vertices, 4 * np.int64(indices[later]))
            vec.prefetch(vertices, 4 * np.int64(indices[later + 1]))
            vec.prefetch(vertices, 4 * np.int64(indices[later + 2]))
        count, micros = _eight(
            job, lens, farthest, drawn, element, lanes, late, record, spans, count, micro, micros, columns
        )
        element += lanes
    return count, micros


@inlined
def _leave(micro, micros, covered, pixels, w, numbers):
    """Append a pixel of each covered triangle; returns the new ``micros``. Without a branch: which are covered cannot
    be predicted. Up to seven values behind the last are overwritten."""
    vec.store(micro, micros, vec.compressed(covered, pixels))
    vec.store(micro, MICRO_ROOM + micros, vec.compressed(covered, vec.bits_of(w)))
    vec.store(micro, 2 * MICRO_ROOM + micros, vec.compressed(covered, numbers))
    return micros + vec.count_bits(vec.bits(covered))


@inlined
def _eight(job, lens, farthest, drawn, element, lanes, late, record, spans, count, micro, micros, columns):
    """Set up the triangles ``element .. element + lanes`` (at most eight) of a drawn instance.

    Those whose box holds at most TINY x TINY pixel centres are solved here for good, all eight at once, and leave
    their pixels; small ones become KIND_SMALL records; large and clipped ones go to the scalar path.

    Back faces that are kept apart are put off (KIND_LATER) where they are small and near one another.

    Args:
        farthest: 1/z of the far plane.
        late: a mask of the lanes to set up that were put off, and no others; 0: all lanes, for the first time.
        record: address of the chunk's records, of which ``count`` are taken.
        spans: pointer to int32 pairs, first and last list of each record: its band, or for back faces that are kept
            apart the number of bands and its band.
        micro: pointer to MICRO_VALUES arrays of MICRO_ROOM int32, of which ``micros`` values are taken.
        columns: pointer to RECORD_VALUES x 8 int32 of scratch.

    Returns:
        The new ``count`` and ``micros``.
    """
    table = i64_at(job[J_TABLE])
    row = drawn * T_COLUMNS
    vertices = f32_at(job[J_VERTEX] + 16 * table[row + T_VERTEX])
    indices = u32_at(table[row + T_ELEMENTS] + 12 * element)
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
    high = vec.most(vec.most(w0, w1), w2)
    low = vec.least(vec.least(w0, w1), w2)
    used = lane < vec.i32(lanes)
    plain = used & (low > none)
    clipped = vec.bits(used & (low < none) & (high > vec.f32(BEHIND)))
    plain = plain & (high >= vec.f32(farthest))
    if vec.bits(plain) == 0 and clipped == 0:
        return count, micros

    # Coordinates of the other lanes mean nothing and may be infinite.
    x0, y0 = vec.select(plain, x0, none), vec.select(plain, y0, none)
    x1, y1 = vec.select(plain, x1, none), vec.select(plain, y1, none)
    x2, y2 = vec.select(plain, x2, none), vec.select(plain, y2, none)
    grid = vec.f32(256.0)
    gx0, gy0 = vec.to_i32(vec.rint(x0 * grid)), vec.to_i32(vec.rint(y0 * grid))
    gx1, gy1 = vec.to_i32(vec.rint(x1 * grid)), vec.to_i32(vec.rint(y1 * grid))
    gx2, gy2 = vec.to_i32(vec.rint(x2 * grid)), vec.to_i32(vec.rint(y2 * grid))
    # first_centre(): ceil((value - 128) / 256); with samples, all pixels whose samples may be inside.
    margin = job[J_MARGIN]
    before, after, eight, zero = vec.i32(127 - margin), vec.i32(127 + margin), vec.i32(8), vec.i32(0)
    left = (vec.least(vec.least(gx0, gx1), gx2) + before) >> eight
    right = (vec.most(vec.most(gx0, gx1), gx2) + after) >> eight
    top = (vec.least(vec.least(gy0, gy1), gy2) + before) >> eight
    bottom = (vec.most(vec.most(gy0, gy1), gy2) + after) >> eight
    seen = (vec.most(left, zero) < vec.least(right, vec.i32(job[J_WIDTH]))) & (
        vec.most(top, zero) < vec.least(bottom, vec.i32(job[J_HEIGHT]))
    )
    plain = plain & seen
    width = right - left
    height = bottom - top
    fits = (width <= vec.i32(SMALL_WIDTH)) & (height <= vec.i32(SMALL_HEIGHT)) & (high <= low * vec.f32(SMALL_RATIO))
    slow = vec.bits(plain & ~fits) | clipped
    small = plain & fits
    area = (gx1 - gx0) * (gy2 - gy0) - (gx2 - gx0) * (gy1 - gy0)
    small = small & (area != zero)
    # The sign alone: an area times -1 may not fit where the triangle is not a small one.
    side = vec.select(area < zero, vec.i32(-1), vec.i32(1))
    small = small & (side != vec.i32(table[row + T_HIDDEN]))
    back = side == vec.i32(table[row + T_CULL])
    apart = job[J_LISTS] - job[J_BANDS]
    if apart == 0:
        small = small & ~back
    elif late != 0:
        small = small & (((vec.i32(late) >> lane) & vec.i32(1)) != zero)
        slow = 0
    else:
        waiting = small & back
        if vec.bits(waiting) != 0:
            far, near = vec.i32(-(1 << 20)), vec.i32(1 << 20)
            box_x, box_y = vec.least_of(vec.select(waiting, left, near)), vec.least_of(vec.select(waiting, top, near))
            end_x, end_y = vec.most_of(vec.select(waiting, right, far)), vec.most_of(vec.select(waiting, bottom, far))
            if end_x - box_x <= LATER_SIDE and end_y - box_y <= LATER_SIDE:
                group = i32_at(record + RECORD_BYTES * count)
                group[G_ELEMENT] = element
                group[G_LANES] = vec.bits(waiting)
                group[G_DRAWN] = drawn
                group[R_ID] = table[row + T_RECORD] + element
                group[R_KIND] = KIND_LATER
                group[S_BOX] = (box_y << 16) | (box_x & 0xFFFF)
                group[S_SIZE] = ((end_y - box_y) << 16) | (end_x - box_x)
                group[R_HIGH] = vec.most_of(vec.select(waiting, vec.bits_of(high), zero))  # ordered as the floats are
                spans[2 * count] = apart + (max(box_y, 0) >> BAND_SHIFT)
                spans[2 * count + 1] = apart + (min(end_y, job[J_HEIGHT]) - 1 >> BAND_SHIFT)
                count += 1
                small = small & ~back
    if vec.bits(small) == 0 and slow == 0:
        return count, micros

    turned = area < zero
    gx1, gx2 = vec.select(turned, gx2, gx1), vec.select(turned, gx1, gx2)
    gy1, gy2 = vec.select(turned, gy2, gy1), vec.select(turned, gy1, gy2)
    px = (left << eight) + vec.i32(128)
    py = (top << eight) + vec.i32(128)
    e0, dx0, dy0 = _edge(gx0, gy0, gx1, gy1, px, py)
    e1, dx1, dy1 = _edge(gx1, gy1, gx2, gy2, px, py)
    e2, dx2, dy2 = _edge(gx2, gy2, gx0, gy0, px, py)

    # The plane of 1/z through the vertices as they are, not as they were snapped; the same for both windings.
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

    number = table[row + T_RECORD] + element
    values = as_f32(columns)
    tiny = small & (width <= vec.i32(TINY)) & (height <= vec.i32(TINY))
    tiny = tiny & (left >= zero) & (right <= vec.i32(job[J_WIDTH])) & (top >= zero) & (bottom <= vec.i32(job[J_HEIGHT]))
    if micros > CHUNK * MICRO_PER_ELEMENT - vec.LANES * TINY * TINY or margin != 0:
        tiny = tiny & (lane < zero)  # no room left, or samples
    if vec.bits(tiny) != 0:
        stride = job[J_STRIDE]
        place, numbers = top * vec.i32(stride) + left, vec.i32(number) + lane
        place = vec.select(back, place | vec.i32(-(1 << 31)), place)
        # Nearly all have at most three pixels a side: to do all nine costs less than to guess wrong how many there are.
        most = vec.i32(TINY - 1)
        sides = TINY - 1 + (vec.bits(tiny & ((width > most) | (height > most))) != 0)
        f0, f1, f2 = e0, e1, e2
        for r in range(sides):
            start = base + down * vec.f32(np.float32(r))
            c0, c1, c2 = f0, f1, f2
            for c in range(sides):
                w = vec.least(vec.most(start + across * vec.f32(np.float32(c)), low), high)
                pixels, covered = place + vec.i32(r * stride + c), tiny & ((c0 | c1 | c2) >= zero)
                micros = _leave(micro, micros, covered, pixels, w, numbers)
                c0, c1, c2 = c0 + right0, c1 + right1, c2 + right2
            f0, f1, f2 = f0 + down0, f1 + down1, f2 + down2

    many = vec.bits(small & ~tiny)
    pending = many | slow
    if pending == 0:
        return count, micros
    out = i32_at(record)
    if many != 0:
        vec.store(values, 8 * R_LOW, low)
        vec.store(values, 8 * R_HIGH, high)
        vec.store(columns, 8 * S_BOX, (top << vec.i32(16)) | (left & vec.i32(0xFFFF)))
        vec.store(columns, 8 * S_SIZE, (height << vec.i32(16)) | width)
        vec.store(columns, 8 * S_EDGES, e0)
        vec.store(columns, 8 * (S_EDGES + 1), e1)
        vec.store(columns, 8 * (S_EDGES + 2), e2)
        vec.store(columns, 8 * S_RIGHT, right0)
        vec.store(columns, 8 * (S_RIGHT + 1), right1)
        vec.store(columns, 8 * S_DOWN, down0)
        vec.store(columns, 8 * S_DOWN_SECOND, down1)
        vec.store(values, 8 * S_BASE, base)
        vec.store(values, 8 * S_DX, across)
        vec.store(values, 8 * S_DY, down)
    last_row = job[J_HEIGHT] - 1
    backs = vec.bits(back)
    while pending != 0:
        k = vec.lowest_bit(pending)
        bit = np.int64(1) << k
        pending &= pending - 1
        if bit & many:
            box = np.int64(columns[8 * S_BOX + k])
            start = RECORD_VALUES * count
            for field in range(RECORD_VALUES):
                out[start + field] = columns[8 * field + k]
            out[start + R_ID] = number + k
            out[start + R_KIND] = KIND_SMALL
            from_row = box >> 16
            to_row = from_row + (np.int64(columns[8 * S_SIZE + k]) >> 16) - 1
            shift = apart if bit & backs else 0
            spans[2 * count] = shift + (max(from_row, 0) >> BAND_SHIFT)  # type: ignore[operator]  # kernels' integers
            spans[2 * count + 1] = shift + (min(to_row, last_row) >> BAND_SHIFT)
            count += 1
        else:
            begin, end = large_triangle(job, lens, drawn, element + k, record + RECORD_BYTES * count)
            if end >= begin:
                out[RECORD_VALUES * count + R_ID] = number + k
                spans[2 * count] = begin
                spans[2 * count + 1] = end
                count += 1
    return count, micros
