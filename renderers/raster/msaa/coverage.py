"""Rasterization of a band with several samples per pixel.

A triangle is set up once. Its edges and its 1/z are linear, so that their values at a sample are those at the pixel's
centre plus an offset that is the same in all pixels. Eight pixels at a time, a primitive that covers all samples in
front of everything takes whole pixels, and one that lies behind is skipped; only pixels at edges are tested sample by
sample, one sample per lane. Four samples take eight lanes, too, each of them twice; small triangles test two pixels at
a time. Ranges of 1/z may be wider than the values: they decide only what costs more to find out.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import address, allocate, f32_at, i32_at, release, stack_array
from renderers.compiler.structs import I32, I64, Struct, pointer_to
from renderers.msaa import SAMPLE_BAND
from renderers.raster.depth_sort import BUCKETS, count_primitives, front_to_back
from renderers.raster.fill import filler
from renderers.raster.layout import BINNED_BYTES, HALF, SMALL, SUBPIXEL, binned_at, small_at
from renderers.raster.msaa.small_triangles import SCRATCH_VALUES, TAKEN, draw_small_samples
from renderers.raster.msaa.storage import cover, sample_slopes, slope_range, test_samples
from renderers.raster.primitive_setup import first_center
from renderers.visibility_buffer import BAND_ROWS

_FAR_AWAY: Final = 1 << 30
_TARGET: Final = Struct("SampleTarget", {"band": SAMPLE_BAND, "owner": I64, "scratch": pointer_to(I32)})
"""What a primitive is drawn into, and its index among the binned primitives."""
_new_target = _TARGET.local
_new_band = SAMPLE_BAND.local
_scratch_array = stack_array(types.int32, SCRATCH_VALUES)


@inlined
def _points(frame, row):
    """Return the samples of a row."""
    samples = frame.sample_offsets
    x, y = vec.to_f64(vec.load(samples, 0)), vec.to_f64(vec.load(samples, vec.LANES))
    return x, vec.f64(row * SUBPIXEL + HALF) + y


@device_function
def _draw_span(frame, target, rule, primitive, row, count, start, stop, box_x, box_y):
    """Draw a row in which every sample has its own columns, ``start .. stop`` (i32x8).

    Args:
        box_x, box_y: the pixel that ``primitive.base`` belongs to.
    """
    some = start < stop
    start, stop = vec.select(some, start, vec.i32(_FAR_AWAY)), vec.select(some, stop, vec.i32(-_FAR_AWAY))
    begin, end = vec.minimum_of(start), vec.maximum_of(stop)
    if begin >= end:
        return
    full_begin, full_end = vec.i32(vec.maximum_of(start)), vec.i32(vec.minimum_of(stop))
    first, last = vec.i32(begin), vec.i32(end)
    slope = primitive.dx
    base = primitive.base + primitive.dy * np.float64(row - box_y)
    slopes = sample_slopes(frame, slope, primitive.dy)
    lowest, highest = slope_range(frame, slope, primitive.dy)
    low, high = vec.f32(primitive.low), vec.f32(primitive.high)
    ids, owner = vec.i32(primitive.id), vec.i32(target.owner)
    band, taken = target.band, np.int64(target.scratch[TAKEN])
    line = row * frame.stride
    lane = vec.iota()
    for column in range(begin & ~np.int64(vec.LANES - 1), end, vec.LANES):
        here = vec.i32(column) + lane
        full, touched = (here >= full_begin) & (here < full_end), (here >= first) & (here < last)
        w = vec.to_f32(vec.f64(base) + vec.f64(slope) * vec.to_f64(here - vec.i32(box_x)))
        open_pixels = cover(band, line + column, w, lowest, highest, low, high, full, touched, ids, owner)
        while open_pixels != 0:
            x = column + vec.lowest_bit(open_pixels)
            open_pixels &= open_pixels - 1
            covered = (vec.i32(x) >= start) & (vec.i32(x) < stop)
            w = vec.f32(base + slope * np.float64(x - box_x)) + slopes
            w = vec.minimum(vec.maximum(w, low), high)
            taken = test_samples(frame, band, taken, line + x, w, covered, ids)
    target.scratch[TAKEN] = taken


@inlined
def _draw_point(frame, target, rule, primitive, first_row, last_row):
    """Draw a POINT: the samples in a square of grid units."""
    xy, reach = primitive.xy, frame.sample_reach
    x0, y0, x1, y1 = np.int64(xy[0]), np.int64(xy[1]), np.int64(xy[2]), np.int64(xy[3])
    top = max(first_center(y0 - reach), first_row)
    bottom = min(first_center(y1 + reach), last_row)
    samples = frame.sample_offsets
    ox, oy = vec.load(samples, 0), vec.load(samples, vec.LANES)
    # first_center() of each sample.
    up, eight = vec.i32(SUBPIXEL - 1 - HALF) - ox, vec.i32(8)
    start = vec.maximum((vec.i32(x0) + up) >> eight, vec.i32(0))
    stop = vec.minimum((vec.i32(x1) + up) >> eight, vec.i32(frame.width))
    for row in range(top, bottom):
        y = vec.i32(row * SUBPIXEL + HALF) + oy
        inside = (y >= vec.i32(y0)) & (y < vec.i32(y1))
        end = vec.select(inside, stop, vec.i32(-1))
        _draw_span(frame, target, rule, primitive, row, 1, start, end, np.int64(0), np.int64(0))


_fill = filler(1, _points, _draw_span, _draw_point)


@device_function
def draw_sample_rows(frame, memory, first_row, last_row):
    """Clear the rows, all of one band, and draw everything that touches them.

    Then ``owners`` has -1 where a pixel sees nothing, MIXED where its samples have ids of their own, in ``sample_ids``
    from eight times ``slots`` on, and otherwise ``ids`` has the pixel's primitive id.

    Args:
        memory: the thread's SAMPLE_BAND.
    """
    band_index, stride = first_row // BAND_ROWS, frame.stride
    # Shifted, so that index 0 is the image's first pixel.
    before = 4 * first_row * stride
    band = _new_band()
    band.sample_ids, band.sample_inv_z = memory.sample_ids, memory.sample_inv_z
    band.ids, band.slots = i32_at(address(memory.ids) - before), i32_at(address(memory.slots) - before)
    band.owners = i32_at(address(memory.owners) - before)
    band.far, band.near = f32_at(address(memory.far) - before), f32_at(address(memory.near) - before)
    # Nothing at or beyond this 1/z is accepted: the far plane needs no test of its own.
    empty = vec.f32(np.nextafter(np.float32(1.0 / frame.far), np.float32(-1.0)))
    none = vec.i32(-1)
    for at in range(first_row * stride, last_row * stride, vec.LANES):
        vec.store(band.owners, at, none)
        vec.store(band.slots, at, none)
        vec.store(band.far, at, empty)
        vec.store(band.near, at, empty)
    scratch = _scratch_array()
    scratch[TAKEN] = 0
    target = _new_target()
    target.band, target.scratch = band, scratch
    count = count_primitives(frame, band_index)
    heap = allocate(4 * (3 * count + BUCKETS))
    ordered, starts = i32_at(heap), i32_at(heap + 12 * count)
    found, keys = i32_at(heap + 4 * count), i32_at(heap + 8 * count)
    for k in range(front_to_back(frame, band_index, found, keys, starts, ordered)):
        if is_set(frame.stop):
            break
        owner = np.int64(ordered[k])
        place = frame.binned + owner * BINNED_BYTES
        primitive = binned_at(place)
        if primitive.kind == SMALL:
            draw_small_samples(frame, band, small_at(place), owner, first_row, last_row, scratch)
        else:
            target.owner = owner
            _fill(frame, target, 0, primitive, first_row, last_row)
    release(heap)
