"""Storage of a band's samples.

Most pixels see one primitive with all samples. For those, only the index of the binned primitive and a range of 1/z is
kept. A pixel at an edge gets a slot, where each sample has its own primitive id and 1/z.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import as_i32
from renderers.raster.fill import box_origin
from renderers.raster.layout import BINNED_BYTES, SMALL, SUBPIXEL, binned_at, small_at
from renderers.raster.small_triangles import box_of

MIXED: Final = -2
"""Instead of the index of a pixel's primitive: its samples have primitives of their own."""


@inlined
def sample_slopes(frame, dx, dy):
    """Return f32x8: 1/z at the samples minus 1/z at the pixel's centre."""
    samples, pixel = frame.sample_offsets, vec.f32(1.0 / SUBPIXEL)
    across, down = vec.to_f32(vec.load(samples, 0)) * pixel, vec.to_f32(vec.load(samples, vec.LANES)) * pixel
    return vec.f32(dx) * across + vec.f32(dy) * down


@inlined
def slope_range(frame, dx, dy):
    """Return the minimum and maximum of ``sample_slopes``, f32x8 with equal lanes; infinite if not finite."""
    reach = np.float32(frame.sample_reach) * np.float32(1.0 / SUBPIXEL)
    # Rounded as the sums at the samples are, none of which is farther out.
    slope = abs(np.float32(dx)) * reach + abs(np.float32(dy)) * reach
    if not slope < np.inf:
        slope = np.float32(np.inf)
    return vec.f32(-slope), vec.f32(slope)


@inlined
def cover(band, at, w, lowest, highest, low, high, full, touched, ids, owner):
    """Draw a primitive into eight pixels as far as whole pixels are concerned.

    Pixels that it covers wholly and in front of everything become its own; those that it lies behind are skipped.

    Args:
        band: a SAMPLE_BAND. at: index of the first pixel.
        w: f32x8: 1/z at the centres before it is clamped to ``low`` and ``high``.
        lowest, highest: as from ``slope_range``.
        full, touched: m8: pixels of which all samples are covered, and some may be.
        ids, owner: i32x8: primitive id and index of the binned primitive.

    Returns:
        Mask of the pixels whose samples must be tested one by one.
    """
    # NaN is never in front of everything; on the near side it counts as ``low``, as for clamped samples.
    farther, nearer = vec.minimum(high, w + lowest), vec.maximum(w + highest, low)
    old_far, old_near = vec.load_volatile(band.far, at), vec.load_volatile(band.near, at)
    whole = full & (farther > old_near)
    open_pixels = touched & (nearer >= old_far) & ~whole  # at the same 1/z ids decide
    vec.store(band.far, at, vec.select(whole, farther, old_far))
    vec.store(band.near, at, vec.select(whole | open_pixels, vec.maximum(nearer, old_near), old_near))
    vec.store(band.ids, at, vec.select(whole, ids, vec.load_volatile(band.ids, at)))
    vec.store(band.owners, at, vec.select(whole, owner, vec.load_volatile(band.owners, at)))
    return vec.movemask(open_pixels)


@device_function
def _expand(frame, band, at, first, owner):
    """Write the samples of a pixel that all see one primitive.

    Args:
        at: index of the pixel. first: index of its first sample. owner: index of the binned primitive.
    """
    y = at // frame.stride
    x = at - y * frame.stride
    place = frame.binned + owner * BINNED_BYTES
    primitive = binned_at(place)
    if primitive.kind == SMALL:
        small = small_at(place)
        box_x, box_y, _, _ = box_of(small)
        here = small.base + small.dy * np.float32(y - box_y)
        w = vec.f32(here + small.dx * np.float32(x - box_x)) + sample_slopes(frame, small.dx, small.dy)
    else:
        box_x, box_y = box_origin(primitive)
        base = primitive.base + primitive.dy * np.float64(y - box_y)
        slopes = sample_slopes(frame, primitive.dx, primitive.dy)
        w = vec.f32(base + primitive.dx * np.float64(x - box_x)) + slopes
    vec.store(band.sample_ids, first, vec.i32(primitive.id))
    w = vec.minimum(vec.maximum(w, vec.f32(primitive.low)), vec.f32(primitive.high))
    vec.store(band.sample_inv_z, first, w)


@inlined
def _open_slot(frame, band, taken, at):
    """Give a pixel a slot if it has none.

    Returns:
        Index of the pixel's first sample, the owner before, and the new ``taken``.
    """
    slot = np.int64(band.slots[at])
    new = slot < 0
    slot = taken if new else slot
    band.slots[at] = slot
    owner = np.int64(band.owners[at])
    if owner >= 0:
        _expand(frame, band, at, vec.LANES * slot, owner)
    band.owners[at] = MIXED
    return vec.LANES * slot, owner, taken + new


@inlined
def _wins(w, old, ids, old_ids):
    """Return m8: samples at which a primitive is in front of another one. Empty samples have the id -1."""
    return (w > old) | ((w == old) & (ids < old_ids))


@inlined
def test_two_pixels(frame, band, taken, a, b, w, covered, ids):
    """``test_samples`` of two pixels with four samples: the first four lanes belong to pixel ``a``."""
    first_a, owner_a, taken = _open_slot(frame, band, taken, a)
    first_b, owner_b, taken = _open_slot(frame, band, taken, b)
    empty = vec.join_halves(vec.i32(owner_a), vec.i32(owner_b)) == vec.i32(-1)
    behind = vec.join_halves(vec.f32(band.far[a]), vec.f32(band.far[b]))
    depths, sample_ids = band.sample_inv_z, band.sample_ids
    old = vec.join_halves(vec.load_volatile(depths, first_a), vec.load_volatile(depths, first_b))
    old = vec.select(empty, behind, old)
    old_ids = vec.join_halves(vec.load_volatile(sample_ids, first_a), vec.load_volatile(sample_ids, first_b))
    old_ids = vec.select(empty, vec.i32(-1), old_ids)
    covered = covered & _wins(w, old, ids, old_ids)
    w = vec.select(covered, w, old)
    seen = vec.select(covered, ids, old_ids)
    vec.store(depths, first_a, vec.low_twice(w))
    vec.store(depths, first_b, vec.high_twice(w))
    vec.store(sample_ids, first_a, vec.low_twice(seen))
    vec.store(sample_ids, first_b, vec.high_twice(seen))
    bits = vec.float_bits(w)
    least = vec.minimum(bits, vec.swapped_pairs(bits))
    least = vec.minimum(least, vec.swapped(least))
    far_bits = as_i32(band.far)
    far_bits[a], far_bits[b] = vec.lane0(least), vec.lane4(least)
    return taken


@inlined
def test_samples(frame, band, taken, at, w, covered, ids):
    """Write those of a pixel's covered samples that are nearer than what is stored.

    Without a branch: which samples are, and whether the pixel was empty, cannot be predicted.

    Args:
        taken: number of slots in use. at: index of the pixel.

    Returns:
        The new ``taken``.
    """
    first, owner, taken = _open_slot(frame, band, taken, at)
    # An empty pixel's far limit is its 1/z.
    empty = vec.i32(owner) == vec.i32(-1)
    old = vec.select(empty, vec.f32(band.far[at]), vec.load_volatile(band.sample_inv_z, first))
    old_ids = vec.select(empty, vec.i32(-1), vec.load_volatile(band.sample_ids, first))
    covered = covered & _wins(w, old, ids, old_ids)
    w = vec.select(covered, w, old)
    vec.store(band.sample_inv_z, first, w)
    vec.store(band.sample_ids, first, vec.select(covered, ids, old_ids))
    # Bits are ordered as the values are: none is negative but that of empty samples.
    as_i32(band.far)[at] = vec.minimum_of(vec.float_bits(w))
    return taken
