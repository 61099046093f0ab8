"""Depth test and write of eight pixels: the innermost step of raster."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, i32_at
from renderers.raster.layout import J_BEFORE_IDS, J_BEFORE_INV_Z, J_BEYOND_IDS, J_BEYOND_INV_Z, J_IDS, J_INV_Z

PLAIN: Final = 0
"""Records come in the order of their numbers: of two at the same depth the first stays."""
LAYERED: Final = 1
"""As PLAIN, and only what lies between the job's layers."""
TIES: Final = 2
"""Records come on top of others of any number: of two at the same depth the lower number wins."""


@inner
def _between(job, pixel, w, identity):
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


@inlined
def blend(job, rule, depths, ids, pixel, w, covered, identity):
    """Write the covered lanes that are nearer than what is there.

    Args:
        rule: PLAIN, LAYERED or TIES.
        w, covered, identity: f32x8, m8, i32x8 of the pixels from index ``pixel`` on.
    """
    old = vec.load_again(depths, pixel)
    if rule == TIES:
        covered = covered & ((w > old) | ((w == old) & (identity < vec.load(ids, pixel))))
    else:
        covered = covered & (w > old)
    if rule == LAYERED:
        covered = covered & _between(job, pixel, w, identity)
    vec.store(depths, pixel, vec.select(covered, w, old))
    vec.store_where(ids, pixel, covered, identity)


@inner
def blend_one(job, rule, pixel, w, identity):
    """As ``blend`` for one covered pixel, whatever the order of records."""
    depths = f32_at(job[J_INV_Z])
    ids = i32_at(job[J_IDS])
    old = depths[pixel]
    other = ids[pixel]
    # Without a branch: which of two overlapping meshes is nearer cannot be predicted.
    accepted = (w > old) | ((w == old) & (identity < other))
    if rule == LAYERED:
        accepted = accepted & (vec.bits(_one_between(job, pixel, w, identity)) != 0)
    depths[pixel] = w if accepted else old
    ids[pixel] = identity if accepted else other


@inner
def _one_between(job, pixel, w, identity):
    """Lane 0 of ``_between``; the layers are read where the eight pixels end, not past the picture."""
    start = pixel & ~np.int64(vec.LANES - 1)
    lane = vec.iota() == vec.i32(pixel - start)
    return lane & _between(job, start, vec.f32(w), vec.i32(identity))
