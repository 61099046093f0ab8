"""Depth test and write of eight pixels: the innermost step of raster."""

from __future__ import annotations

import numpy as np
from numba import njit

from renderers import simd as vec
from renderers.cpu.layout import J_BEFORE_IDS, J_BEFORE_INV_Z, J_BEYOND_IDS, J_BEYOND_INV_Z, J_IDS, J_INV_Z
from renderers.pointers import f32_at, i32_at


@njit(nogil=True, error_model="numpy")
def _between(job, pixel, w, identity):  # type: ignore[no-untyped-def]
    """Lanes that lie strictly beyond the one and before the other given layer, by depth and then by record."""
    zero = vec.i32(0)
    accepted = zero == zero
    if job[J_BEYOND_IDS] != 0:
        other = vec.load(i32_at(job[J_BEYOND_IDS]), pixel)
        limit = vec.load(f32_at(job[J_BEYOND_INV_Z]), pixel)
        accepted = accepted & (other >= zero) & ((w < limit) | ((w == limit) & (identity > other)))
    if job[J_BEFORE_IDS] != 0:
        other = vec.load(i32_at(job[J_BEFORE_IDS]), pixel)
        limit = vec.load(f32_at(job[J_BEFORE_INV_Z]), pixel)
        accepted = accepted & ((other < zero) | (w > limit) | ((w == limit) & (identity < other)))
    return accepted


@njit(nogil=True, error_model="numpy", forceinline=True)
def blend(job, layered, depths, ids, pixel, w, covered, identity):  # type: ignore[no-untyped-def]
    """Write the covered lanes that are nearer than what is there.

    Records come in the order of their numbers, so that of two at the same depth the first stays.

    Args:
        layered: whether there are layers to lie between.
        w, covered, identity: f32x8, m8, i32x8 of the pixels from index ``pixel`` on.
    """
    old = vec.load_again(depths, pixel)
    covered = covered & (w > old)
    if layered:
        covered = covered & _between(job, pixel, w, identity)
    vec.store(depths, pixel, vec.select(covered, w, old))
    vec.store(ids, pixel, vec.select(covered, identity, vec.load_again(ids, pixel)))


@njit(nogil=True, error_model="numpy")
def blend_one(job, layered, pixel, w, identity):  # type: ignore[no-untyped-def]
    """As ``blend`` for one covered pixel, whatever the order of records."""
    depths = f32_at(job[J_INV_Z])
    ids = i32_at(job[J_IDS])
    old = depths[pixel]
    other = ids[pixel]
    # Without a branch: which of two overlapping meshes is nearer cannot be predicted.
    accepted = (w > old) | ((w == old) & (identity < other))
    if layered:
        accepted = accepted & (vec.bits(_one_between(job, pixel, w, identity)) != 0)
    depths[pixel] = w if accepted else old
    ids[pixel] = identity if accepted else other


@njit(nogil=True, error_model="numpy")
def _one_between(job, pixel, w, identity):  # type: ignore[no-untyped-def]
    """Lane 0 of ``_between``; the layers are read where the eight pixels end, not past the picture."""
    start = pixel & ~np.int64(vec.LANES - 1)
    lane = vec.iota() == vec.i32(pixel - start)
    return lane & _between(job, start, vec.f32(w), vec.i32(identity))
