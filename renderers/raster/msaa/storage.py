"""What is kept of a pixel with several samples: the place of the one record that covers it and bounds of its 1/z, or,
at edges, every sample in a slot of its own."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import as_f32, f32_at, f64_at, i32_at
from renderers.raster.layout import (
    J_MARGIN,
    J_RECORDS,
    J_SAMPLE_IDS,
    J_SAMPLE_INV_Z,
    J_SAMPLES,
    J_STRIDE,
    KIND_CLIPPED,
    KIND_LINE,
    KIND_SMALL,
    KIND_TRIANGLE,
    R_BASE,
    R_DX,
    R_DY,
    R_HIGH,
    R_ID,
    R_KIND,
    R_LOW,
    R_XY,
    RECORD_BYTES,
    S_BASE,
    S_BOX,
    S_DX,
    S_DY,
    SUBPIXEL,
)
from renderers.raster.primitive_setup import first_centre

MIXED: Final = -2
"""Instead of the place of a pixel's record: its samples have records of their own."""


@inlined
def rising_at(samples, dx, dy):
    """f32x8: 1/z at the samples less that at the centre."""
    pixel = vec.f32(1.0 / SUBPIXEL)
    across, down = vec.to_f32(vec.load(samples, 0)) * pixel, vec.to_f32(vec.load(samples, vec.LANES)) * pixel
    return vec.f32(dx) * across + vec.f32(dy) * down


@inlined
def reach_of(job, dx, dy):
    """f32x8: what ``rising_at`` is at least and at most, in all lanes; without bound where it is not finite."""
    margin = np.float32(job[J_MARGIN]) * np.float32(1.0 / SUBPIXEL)
    # Rounded as the sums at the samples are, none of which is farther out.
    reach = abs(np.float32(dx)) * margin + abs(np.float32(dy)) * margin
    if not reach < np.inf:
        reach = np.float32(np.inf)
    return vec.f32(-reach), vec.f32(reach)


@inlined
def cover(ids, owners, far, near, at, w, lowest, highest, low, high, full, touched, identity, place):
    """Give the pixels that a record takes wholly to it, eight from ``at`` on, and widen the bounds of others.

    Args:
        ids, owners, far, near: pointers to J_IDS, J_OWNERS, J_FAR and J_NEAR.
        w: f32x8, 1/z at the centres before it is bounded by ``low`` and ``high``. lowest, highest: f32x8, what is
            added to it at the samples, at least and at most.
        full, touched: m8, pixels of which all samples are covered, and some may be.
        identity, place: i32x8, the record's number and its place among all.

    Returns:
        A mask of the pixels whose samples must be looked at.
    """
    # Not a number: never in front of all, never behind all.
    farther, nearer = vec.least(high, w + lowest), vec.most(w + highest, low)
    old_far, old_near = vec.load_again(far, at), vec.load_again(near, at)
    whole = full & (farther > old_near)
    left_open = touched & (nearer >= old_far) & ~whole  # at the same 1/z numbers decide
    vec.store(far, at, vec.select(whole, farther, old_far))
    vec.store(near, at, vec.select(whole | left_open, vec.most(nearer, old_near), old_near))
    vec.store(ids, at, vec.select(whole, identity, vec.load_again(ids, at)))
    vec.store(owners, at, vec.select(whole, place, vec.load_again(owners, at)))
    return vec.bits(left_open)


@inner
def box_of(whole):
    """The pixel that R_BASE of a record that is not small belongs to."""
    kind = whole[R_KIND]
    a, b = np.int64(whole[R_XY]), np.int64(whole[R_XY + 1])
    if kind == KIND_TRIANGLE:
        c, d = np.int64(whole[R_XY + 2]), np.int64(whole[R_XY + 3])
        e, f = np.int64(whole[R_XY + 4]), np.int64(whole[R_XY + 5])
        return first_centre(min(a, c, e)), first_centre(min(b, d, f))
    if kind == KIND_LINE:
        corner = np.int64(whole[R_XY + 5])
        return corner & 0xFFFF, corner >> 16
    if kind == KIND_CLIPPED:
        return a, b
    return np.int64(0), np.int64(0)


@inner
def expand(job, at, first, owner):
    """Write the samples of a pixel that all see one record.

    Args:
        at: the pixel's number. first: the number of its first sample. owner: the place of its record.
    """
    y = at // job[J_STRIDE]
    x = at - y * job[J_STRIDE]
    record = job[J_RECORDS] + owner * RECORD_BYTES
    whole, fraction, samples = i32_at(record), f32_at(record), i32_at(job[J_SAMPLES])
    if whole[R_KIND] == KIND_SMALL:
        box = np.int64(whole[S_BOX])
        box_x = ((box & 0xFFFF) ^ 0x8000) - 0x8000
        slope, rise = fraction[S_DX], fraction[S_DY]
        here = fraction[S_BASE] + rise * np.float32(y - (box >> 16))
        w = vec.f32(here + slope * np.float32(x - box_x)) + rising_at(samples, slope, rise)
    else:
        plane = f64_at(record)
        box_x, box_y = box_of(whole)
        base = plane[R_BASE] + plane[R_DY] * np.float64(y - box_y)
        w = vec.f32(base + plane[R_DX] * np.float64(x - box_x)) + rising_at(samples, plane[R_DX], plane[R_DY])
    vec.store(i32_at(job[J_SAMPLE_IDS]), first, vec.i32(whole[R_ID]))
    w = vec.least(vec.most(w, vec.f32(fraction[R_LOW])), vec.f32(fraction[R_HIGH]))
    vec.store(f32_at(job[J_SAMPLE_INV_Z]), first, w)


@inlined
def _slot_of(job, owners, slots, taken, at):
    """The number of the first sample of a pixel whose samples are to have records of their own, the place of its record
    before, and the new ``taken``; as ``put``."""
    slot = np.int64(slots[at])
    new = slot < 0
    slot = taken if new else slot
    slots[at] = slot
    owner = np.int64(owners[at])
    if owner >= 0:
        expand(job, at, vec.LANES * slot, owner)
    owners[at] = MIXED
    return vec.LANES * slot, owner, taken + new


@inlined
def _wins(w, old, identity, seen):
    """m8: where a record is seen before another one; before nothing, which has the number -1, only where it is nearer
    than the far plane."""
    return (w > old) | ((w == old) & (identity < seen))


@inlined
def put_two(job, owners, slots, far, ids, depths, taken, a, b, w, covered, identity):
    """``put`` for two pixels ``a`` and ``b`` of four samples: the first four lanes are those of ``a``."""
    first_a, owner_a, taken = _slot_of(job, owners, slots, taken, a)
    first_b, owner_b, taken = _slot_of(job, owners, slots, taken, b)
    empty = vec.halves(vec.i32(owner_a), vec.i32(owner_b)) == vec.i32(-1)
    behind = vec.halves(vec.f32(as_f32(far)[a]), vec.f32(as_f32(far)[b]))
    old = vec.select(empty, behind, vec.halves(vec.load_again(depths, first_a), vec.load_again(depths, first_b)))
    seen = vec.halves(vec.load_again(ids, first_a), vec.load_again(ids, first_b))
    seen = vec.select(empty, vec.i32(-1), seen)
    covered = covered & _wins(w, old, identity, seen)
    w = vec.select(covered, w, old)
    seen = vec.select(covered, identity, seen)
    vec.store(depths, first_a, vec.low_twice(w))
    vec.store(depths, first_b, vec.high_twice(w))
    vec.store(ids, first_a, vec.low_twice(seen))
    vec.store(ids, first_b, vec.high_twice(seen))
    whole = vec.bits_of(w)
    least = vec.least(whole, vec.swapped_pairs(whole))
    least = vec.least(least, vec.swapped(least))
    far[a], far[b] = vec.lane0(least), vec.lane4(least)
    return taken


@inlined
def put(job, owners, slots, far, ids, depths, taken, at, w, covered, identity):
    """Write the covered samples of a pixel that are nearer than what is there; which of them are, and whether it was
    empty, cannot be predicted and is no branch.

    Args:
        owners, slots, far: pointers to J_OWNERS, J_SLOTS, and J_FAR as int32. ids, depths: to J_SAMPLE_IDS and
            J_SAMPLE_INV_Z. taken: how many slots are. at: the pixel's number.

    Returns:
        The new ``taken``.
    """
    first, owner, taken = _slot_of(job, owners, slots, taken, at)
    # What an empty pixel has is one of its bounds.
    empty = vec.i32(owner) == vec.i32(-1)
    old = vec.select(empty, vec.f32(as_f32(far)[at]), vec.load_again(depths, first))
    seen = vec.select(empty, vec.i32(-1), vec.load_again(ids, first))
    covered = covered & _wins(w, old, identity, seen)
    w = vec.select(covered, w, old)
    vec.store(depths, first, w)
    vec.store(ids, first, vec.select(covered, identity, seen))
    # Bits are ordered as the values are: but for the one that stands for nothing, none is negative.
    far[at] = vec.least_of(vec.bits_of(w))
    return taken
