"""Records to pixels: exact coverage by fixed-point edges and the top-left rule, nearest 1/z wins.

A pixel is covered when its centre is inside all edges, or on a left edge or a horizontal top edge. Small triangles
are tested with int32 edge functions. For others an edge's crossing with a row of centres is a quotient of integers
below 2^50 and 2^33; two such that differ, differ by at least 2^-33 at a magnitude below 2^17, so that the float64
quotient has the exact ceiling. Spans are half-open: of two triangles with a common edge exactly one covers each
pixel centre.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.kernel_calls import call_kernel, is_set
from renderers.compiler.pointers import as_f32, as_i32, f32_at, f64_at, i32_at, i64_at, u16_at
from renderers.raster.clip import MAX_VERTICES, clip_triangle
from renderers.raster.depth_test import LAYERED, PLAIN, TIES, blend, blend_one
from renderers.raster.layout import (
    CHUNK,
    HALF,
    J_BANDS,
    J_BEFORE_IDS,
    J_BEYOND_IDS,
    J_CHUNKS,
    J_HEIGHT,
    J_IDS,
    J_INV_Z,
    J_LENS,
    J_LISTS,
    J_MICRO,
    J_OFFSETS,
    J_RANGES,
    J_RECORDS,
    J_SELF,
    J_SETUP,
    J_SMALL,
    J_STOP,
    J_STRIDE,
    J_TABLE,
    J_TALL,
    J_WIDTH,
    KIND_CLIPPED,
    KIND_LATER,
    KIND_LINE,
    KIND_SMALL,
    KIND_TRIANGLE,
    L_FAR,
    MICRO_PER_ELEMENT,
    MICRO_ROOM,
    MICRO_VALUES,
    Q_COUNT,
    Q_GROUP,
    Q_MICRO,
    Q_MICROS,
    Q_PIXELS,
    Q_RECORDS,
    Q_SCRATCH,
    Q_SPANS,
    R_BASE,
    R_DX,
    R_DY,
    R_HIGH,
    R_ID,
    R_KIND,
    R_LOW,
    R_XY,
    RECORD_BYTES,
    S_BOX,
    S_SIZE,
    SMALL_BANDS,
    SUBPIXEL,
    T_COLUMNS,
    T_RECORD,
    TINY,
)
from renderers.raster.primitive_setup import first_centre
from renderers.raster.small_triangles import SMALL_SCRATCH, draw_prepared, prepare
from renderers.visibility_buffer import BAND_ROWS

ROOM_OF_ROWS: Final = 16
"""Values of the scratch before those that hold 1/z of each row, or of every eight pixels of a row."""
SCRATCH: Final = max(ROOM_OF_ROWS + BAND_ROWS + vec.LANES, SMALL_SCRATCH)


@inner
def _small(job, rule, record, first_row, last_row, scratch):
    """Draw a KIND_SMALL record by itself."""
    prepare(job, record, first_row, last_row, scratch)
    draw_prepared(job, rule, scratch)


@inlined
def _span_by(job, rule, record, row, start, stop, box_x, box_y, scratch):
    """``_span`` for a rule that is a constant, or for any."""
    plane = f64_at(record)
    bounds = f32_at(record)
    slope = plane[R_DX]
    base = plane[R_BASE] + plane[R_DY] * np.float64(row - box_y)
    low, high = vec.f32(bounds[R_LOW]), vec.f32(bounds[R_HIGH])
    identity = vec.i32(i32_at(record)[R_ID])
    ids = i32_at(job[J_IDS])
    depths = f32_at(job[J_INV_Z])
    lane = vec.iota()
    rising = vec.f32(slope) * vec.to_f32(lane)
    first, last, eight = vec.i32(start), vec.i32(stop), vec.i32(vec.LANES)
    every = lane == lane
    starts = as_f32(scratch)
    blocks = vec.to_f64(lane * eight)
    begin = start & ~np.int64(vec.LANES - 1)
    pixel = row * job[J_STRIDE] + begin
    for column in range(begin, stop, vec.LANES * vec.LANES):
        at = vec.f64(column - box_x) + blocks
        vec.store(starts, ROOM_OF_ROWS, vec.to_f32(vec.f64(base) + vec.f64(slope) * at))
        if column >= start and column + vec.LANES * vec.LANES <= stop:
            for k in range(vec.LANES):
                w = vec.least(vec.most(vec.f32(starts[ROOM_OF_ROWS + k]) + rising, low), high)
                blend(job, rule, depths, ids, pixel + vec.LANES * k, w, every, identity)
            pixel += vec.LANES * vec.LANES
        else:
            here = vec.i32(column) + lane
            for k in range(min((stop - column + vec.LANES - 1) // vec.LANES, vec.LANES)):
                w = vec.least(vec.most(vec.f32(starts[ROOM_OF_ROWS + k]) + rising, low), high)
                blend(job, rule, depths, ids, pixel, w, (here >= first) & (here < last), identity)
                here = here + eight
                pixel += vec.LANES


@inner
def _span(job, rule, record, row, start, stop, box_x, box_y, scratch):
    """Draw the pixels ``start .. stop`` of a row; ``box_x, box_y`` is the pixel that R_BASE belongs to.

    1/z is exact to float32 at the first of every eight pixels, wherever the span starts.
    """
    if rule == PLAIN:
        _span_by(job, PLAIN, record, row, start, stop, box_x, box_y, scratch)
    else:
        _span_by(job, rule, record, row, start, stop, box_x, box_y, scratch)


@inlined
def _crossing(xa, ya, xb, yb, y):
    """i32x8: the first pixel columns whose centres are at or right of the edge in eight rows of centres ``y``.

    Args:
        xa, ya, xb, yb: float64 integers, grid units; ya != yb.
        y: f64x8, grid units.
    """
    dy = yb - ya
    numerator = vec.f64(xb - xa) * (y - vec.f64(ya)) + vec.f64((xa - HALF) * dy)
    # Rows that the edge does not reach may cross it anywhere: keep those in the range of int32.
    reach = vec.f64(1e9)
    crossing = vec.ceil(numerator / vec.f64(dy * SUBPIXEL))
    return vec.to_i32(vec.least(vec.most(crossing, vec.f64(-1e9)), reach))


@inner
def _corners(job, rule, record, x0, y0, x1, y1, x2, y2, first_row, last_row, box_x, box_y, scratch):
    """Draw the rows ``first_row .. last_row`` of a triangle in grid units, whichever way it winds.

    Args:
        scratch: pointer to SCRATCH int32.
    """
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0:
        return
    if area < 0:
        x1, x2, y1, y2 = x2, x1, y2, y1
    top = max(first_centre(min(y0, y1, y2)), first_row)
    bottom = min(first_centre(max(y0, y1, y2)), last_row)
    left = max(first_centre(min(x0, x1, x2)), 0)
    right = min(first_centre(max(x0, x1, x2)), job[J_WIDTH])
    if left >= right:
        return
    fx0, fy0 = np.float64(x0), np.float64(y0)
    fx1, fy1 = np.float64(x1), np.float64(y1)
    fx2, fy2 = np.float64(x2), np.float64(y2)
    lane = vec.to_f64(vec.iota())
    for group in range(top, bottom, vec.LANES):
        y = (vec.f64(group) + lane) * vec.f64(float(SUBPIXEL)) + vec.f64(float(HALF))
        start, stop = vec.i32(left), vec.i32(right)
        # With this winding (y down) edges that run upwards are left ones.
        if y1 < y0:
            start = vec.most(start, _crossing(fx0, fy0, fx1, fy1, y))
        elif y1 > y0:
            stop = vec.least(stop, _crossing(fx0, fy0, fx1, fy1, y))
        if y2 < y1:
            start = vec.most(start, _crossing(fx1, fy1, fx2, fy2, y))
        elif y2 > y1:
            stop = vec.least(stop, _crossing(fx1, fy1, fx2, fy2, y))
        if y0 < y2:
            start = vec.most(start, _crossing(fx2, fy2, fx0, fy0, y))
        elif y0 > y2:
            stop = vec.least(stop, _crossing(fx2, fy2, fx0, fy0, y))
        vec.store(scratch, 0, start)
        vec.store(scratch, 8, stop)
        for k in range(min(bottom - group, vec.LANES)):
            if scratch[k] < scratch[8 + k]:
                start_k, stop_k = np.int64(scratch[k]), np.int64(scratch[8 + k])
                _span(job, rule, record, group + k, start_k, stop_k, box_x, box_y, scratch)


@inner
def _draw(job, lens, rule, record, first_row, last_row, scratch):
    """Draw the part of a record that lies in the rows ``first_row .. last_row``."""
    whole = i32_at(record)
    kind = whole[R_KIND]
    if kind == KIND_SMALL:
        _small(job, rule, record, first_row, last_row, scratch)
        return
    if is_set(job[J_STOP]):  # a large one may take longer than hundreds of small ones
        return
    a, b = np.int64(whole[R_XY]), np.int64(whole[R_XY + 1])
    c, d = np.int64(whole[R_XY + 2]), np.int64(whole[R_XY + 3])
    e, f = np.int64(whole[R_XY + 4]), np.int64(whole[R_XY + 5])
    if kind == KIND_TRIANGLE:
        box_x, box_y = first_centre(min(a, c, e)), first_centre(min(b, d, f))
        _corners(job, rule, record, a, b, c, d, e, f, first_row, last_row, box_x, box_y, scratch)
    elif kind == KIND_LINE:
        box_x, box_y = f & 0xFFFF, f >> 16
        # As GL's aliased lines: widened along the minor axis, so that a width of 1 is one pixel per step.
        ox, oy = (0, e) if abs(c - a) >= abs(d - b) else (e, 0)
        x0, y0, x1, y1 = a - ox, b - oy, c - ox, d - oy
        x2, y2, x3, y3 = c + ox, d + oy, a + ox, b + oy
        _corners(job, rule, record, x0, y0, x1, y1, x2, y2, first_row, last_row, box_x, box_y, scratch)
        _corners(job, rule, record, x0, y0, x2, y2, x3, y3, first_row, last_row, box_x, box_y, scratch)
    elif kind == KIND_CLIPPED:
        corners = np.empty((3, 3), np.float64)
        grid = np.empty((MAX_VERTICES, 2), np.int64)
        element = np.int64(whole[R_ID]) - i64_at(job[J_TABLE])[c * T_COLUMNS + T_RECORD]
        count = clip_triangle(job, lens, c, element, corners, grid)
        x0, y0 = grid[0, 0], grid[0, 1]
        for k in range(2, count):
            x1, y1, x2, y2 = grid[k - 1, 0], grid[k - 1, 1], grid[k, 0], grid[k, 1]
            _corners(job, rule, record, x0, y0, x1, y1, x2, y2, first_row, last_row, a, b, scratch)
    else:
        for row in range(max(b, first_row), min(d, last_row)):
            _span(job, rule, record, row, a, c, a, b, scratch)


@inner
def clear_rows(job, lens, first_row, last_row):
    """Empty the layer's rows."""
    stride = job[J_STRIDE]
    ids = i32_at(job[J_IDS])
    depths = f32_at(job[J_INV_Z])
    # Nothing at or beyond this 1/z is accepted: the far plane costs no test of its own.
    empty = vec.f32(np.nextafter(np.float32(1.0 / lens[L_FAR]), np.float32(-1.0)))
    nobody = vec.i32(-1)
    # One after the other: stores that go on in one cache line are joined, others are not.
    for pixel in range(first_row * stride, last_row * stride, vec.LANES):
        vec.store(ids, pixel, nobody)
    for pixel in range(first_row * stride, last_row * stride, vec.LANES):
        vec.store(depths, pixel, empty)


TILE_ROWS: Final = 8


@inner
def _farthest(job, first_row, last_row, tiles):
    """Write the least 1/z of every TILE_ROWS rows of eight columns of a band: what lies farther is seen nowhere in
    them.

    Args:
        tiles: pointer to as many rows of J_STRIDE float32; the first of every eight is the result.
    """
    stride = job[J_STRIDE]
    depths = f32_at(job[J_INV_Z])
    whole = as_i32(tiles)
    for top in range(first_row, last_row, TILE_ROWS):
        out = (top - first_row) // TILE_ROWS * stride
        bottom = min(top + TILE_ROWS, last_row)
        for column in range(0, stride, vec.LANES):
            least = vec.load(depths, top * stride + column)
            for row in range(top + 1, bottom):
                least = vec.least(least, vec.load(depths, row * stride + column))
            # Bits are ordered as the values are: but for the one that stands for nothing, none is negative.
            whole[out + column] = vec.least_of(vec.bits_of(least))


@inner
def _hidden(job, record, tiles, first_row, last_row):
    """Whether a KIND_SMALL or KIND_LATER record lies behind all that the band shows around its box."""
    whole = i32_at(record)
    if whole[R_KIND] != KIND_SMALL and whole[R_KIND] != KIND_LATER:
        return False
    box = np.int64(whole[S_BOX])
    left = ((box & 0xFFFF) ^ 0x8000) - 0x8000
    size = np.int64(whole[S_SIZE])
    right = min(left + (size & 0xFFFF), job[J_WIDTH])
    top, bottom = max(box >> 16, first_row) - first_row, min((box >> 16) + (size >> 16), last_row) - first_row
    high = f32_at(record)[R_HIGH]
    begin = (max(left, 0) >> 3) << 3  # type: ignore[operator]  # kernels' integers
    hidden = True
    for tile in range(top // TILE_ROWS, (bottom + TILE_ROWS - 1) // TILE_ROWS):
        row = tile * job[J_STRIDE]
        for column in range(row + begin, row + right, vec.LANES):
            hidden = hidden & (high < tiles[column])
    return hidden


@inner
def _draw_late(job, lens, rule, record, which, first_row, last_row, room, scratch):
    """Set up and draw the part of a KIND_LATER record that lies in the band.

    Args:
        which: the band's list of back faces. room: address of ROOM int64.
    """
    request = i64_at(room)
    request[Q_GROUP] = record
    request[Q_RECORDS] = records = room + 64
    request[Q_SPANS] = records + vec.LANES * RECORD_BYTES
    request[Q_SCRATCH] = request[Q_SPANS] + 8 * vec.LANES
    request[Q_MICRO] = request[Q_SCRATCH] + 64 * vec.LANES
    request[Q_PIXELS] = request[Q_MICRO] + 16 * vec.LANES * TINY * TINY
    call_kernel(job[J_SETUP], (job[J_SELF], job[J_LENS], np.int64(-1), room))
    for k in range(request[Q_COUNT]):
        _draw(job, lens, rule, records + k * RECORD_BYTES, first_row, last_row, scratch)
    micro = i32_at(request[Q_MICRO])
    for m in range(request[Q_MICROS]):
        if micro[4 * m + 3] == which:
            _draw_some_micro(job, rule, micro, m, m + 1, first_row, last_row)


_RECORDS_AHEAD: Final = 6
"""Records that are on their way from the cache that they share with all that setup has left."""
_LINES: Final = 4
"""Cache lines of pixels of tiny triangles that are fetched ahead; the processor sees by itself that more follow."""
ROOM: Final = 8 + (vec.LANES * (RECORD_BYTES + 8 + 64 + 16 * TINY * TINY) + 4 * MICRO_VALUES * MICRO_ROOM) // 8


@inner
def _draw_micro(job, rule, micro, begin, end):
    """Draw the pixels ``begin .. end`` of tiny triangles."""
    inverse = as_f32(micro)
    for m in range(begin, end):
        blend_one(job, rule, np.int64(micro[4 * m]), inverse[4 * m + 1], micro[4 * m + 2])


@inner
def _draw_some_micro(job, rule, micro, begin, end, first_row, last_row):
    """``_draw_micro`` of those in some rows."""
    first, last = first_row * job[J_STRIDE], last_row * job[J_STRIDE]
    for m in range(begin, end):
        if micro[4 * m] >= first and micro[4 * m] < last:
            _draw_micro(job, rule, micro, m, m + 1)


@inlined
def _look_ahead(job, chunk, which, step):
    """Fetch what a band will need of a later chunk: its lists' places, then the lists, then the first records.

    A band meets a few values of every chunk, each in a cache line of its own.
    """
    chunk = min(chunk, job[J_CHUNKS] - 1)
    lists = job[J_LISTS]
    offsets = i32_at(job[J_OFFSETS] + 4 * chunk * (2 * lists + 4))
    if step == 0:
        vec.prefetch(offsets, which)
        vec.prefetch(offsets, lists + 1 + which)
        vec.prefetch(offsets, 2 * lists + 2)
        return
    begin = np.int64(offsets[which])
    small = u16_at(job[J_SMALL] + 2 * chunk * CHUNK * SMALL_BANDS)
    if step == 1:
        vec.prefetch(small, begin)
        micro = i32_at(job[J_MICRO] + 16 * chunk * MICRO_PER_ELEMENT * CHUNK)
        first = 4 * np.int64(offsets[lists + 1 + which])
        for line in range(_LINES):
            vec.prefetch(micro, first + 16 * line)
        return
    records = i32_at(job[J_RECORDS] + chunk * CHUNK * RECORD_BYTES)
    last = max(np.int64(offsets[which + 1]) - 1, 0)
    for k in range(_RECORDS_AHEAD):
        vec.prefetch(records, RECORD_BYTES // 4 * np.int64(small[min(begin + k, last)]))


@inlined
def next_record(small, k, end, tall, t, talls):
    """The lowest number of what is left of a band's list of small records and of its chunk's tall ones, not both at
    their ends; then both places after it."""
    if t >= talls or (k < end and small[k] < tall[t]):
        return np.int64(small[k]), k + 1, t
    return np.int64(tall[t]), k, t + 1


@inner
def raster_band(job, lens, first_row, last_row, back):
    """Draw all that touches the rows of a band, or of a part of one, in the order of record numbers (micro triangles
    apart, which compare numbers themselves). ``back``: the back faces that were kept apart, on top of the others."""
    band = first_row // BAND_ROWS
    whole = last_row - first_row == min(BAND_ROWS, job[J_HEIGHT] - band * BAND_ROWS)
    own_scratch = np.empty(SCRATCH + 2 * SMALL_SCRATCH, np.int32)
    scratch = i32_at(np.int64(own_scratch.ctypes.data))
    free = np.int64(own_scratch.ctypes.data) + 4 * SCRATCH
    prepared = free + 4 * SMALL_SCRATCH
    rule = PLAIN
    if job[J_BEYOND_IDS] != 0 or job[J_BEFORE_IDS] != 0:
        rule = LAYERED
    lists = job[J_LISTS]
    which = band
    if back:
        rule = TIES
        which += job[J_BANDS]
    ranges = i32_at(job[J_RANGES] + (8 if back else 0))
    if back:
        reached = False
        for chunk in range(job[J_CHUNKS]):
            reached = reached | ((band >= ranges[4 * chunk]) & (band <= ranges[4 * chunk + 1]))
        if not reached:
            return
    own_tiles = np.empty(BAND_ROWS // TILE_ROWS * job[J_STRIDE] if back else 1, np.float32)
    tiles = f32_at(np.int64(own_tiles.ctypes.data))
    if back:
        _farthest(job, first_row, last_row, tiles)
    own_room = np.empty(ROOM if back else 1, np.int64)
    room = np.int64(own_room.ctypes.data)
    for chunk in range(job[J_CHUNKS]):
        if band < ranges[4 * chunk] or band > ranges[4 * chunk + 1]:
            continue
        if is_set(job[J_STOP]):
            break
        for step in range(3):
            _look_ahead(job, chunk + 3 - step, which, step)
        offsets = i32_at(job[J_OFFSETS] + 4 * chunk * (2 * lists + 4))
        k, end = np.int64(offsets[which]), np.int64(offsets[which + 1])
        t, talls = np.int64(0), np.int64(offsets[2 * lists + 2])
        if back:
            t, talls = talls, np.int64(offsets[2 * lists + 3])
        small = u16_at(job[J_SMALL] + 2 * chunk * CHUNK * SMALL_BANDS)
        tall = u16_at(job[J_TALL] + 2 * chunk * CHUNK)
        records = job[J_RECORDS] + chunk * CHUNK * RECORD_BYTES
        if back or rule != PLAIN:
            while k < end or t < talls:
                index, k, t = next_record(small, k, end, tall, t, talls)
                record = records + index * RECORD_BYTES
                if back and _hidden(job, record, tiles, first_row, last_row):
                    continue
                if i32_at(record)[R_KIND] == KIND_LATER:
                    _draw_late(job, lens, rule, record, which, first_row, last_row, room, scratch)
                else:
                    _draw(job, lens, rule, record, first_row, last_row, scratch)
        else:
            ready = False
            while ready or k < end or t < talls:
                record, is_small, was_ready = np.int64(0), False, ready
                if k < end or t < talls:
                    index, k, t = next_record(small, k, end, tall, t, talls)
                    later = np.int64(small[max(min(k + _RECORDS_AHEAD, end - 1), 0)])
                    vec.prefetch(i32_at(records), RECORD_BYTES // 4 * later)
                    record = records + index * RECORD_BYTES
                    is_small = i32_at(record)[R_KIND] == KIND_SMALL
                    if is_small:
                        prepare(job, record, first_row, last_row, i32_at(free))
                if was_ready:
                    draw_prepared(job, PLAIN, i32_at(prepared))
                if record != 0 and not is_small:
                    _draw(job, lens, rule, record, first_row, last_row, scratch)
                ready = is_small
                free, prepared = prepared, free
        micro = i32_at(job[J_MICRO] + 16 * chunk * MICRO_PER_ELEMENT * CHUNK)
        begin, end = np.int64(offsets[lists + 1 + which]), np.int64(offsets[lists + 2 + which])
        if whole:
            _draw_micro(job, rule, micro, begin, end)
        else:
            _draw_some_micro(job, rule, micro, begin, end, first_row, last_row)
    own_scratch[0] = 0  # the pointers above do not keep the arrays alive
    own_tiles[0] = 0.0
    own_room[0] = 0
