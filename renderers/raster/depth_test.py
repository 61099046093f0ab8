"""Depth test and write of eight pixels: the innermost step of rasterization."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at, i32_at

IN_ORDER: Final = 0
"""Primitives are drawn in the order of their ids: of two at the same depth the first stays."""
PEELED: Final = 1
"""As IN_ORDER, and only what lies between the frame's layers."""
ANY_ORDER: Final = 2
"""Of two primitives at the same depth, the one with the lower id wins."""


@device_function
def _between(frame, pixel, w, ids):
    """Return the lanes strictly beyond one and before the other of the frame's layers, by depth, then id."""
    zero = vec.i32(0)
    accepted = zero == zero
    if frame.beyond_ids != 0:
        other = vec.load(i32_at(frame.beyond_ids), pixel)
        limit = vec.load(f32_at(frame.beyond_inv_z), pixel)
        accepted = accepted & (other >= zero) & ((w < limit) | ((w == limit) & (ids > other)))
    if frame.before_ids != 0:
        other = vec.load(i32_at(frame.before_ids), pixel)
        limit = vec.load(f32_at(frame.before_inv_z), pixel)
        accepted = accepted & ((other < zero) | (w > limit) | ((w == limit) & (ids < other)))
    return accepted


@inlined
def depth_test(frame, layer, rule, pixel, w, covered, ids):
    """Write those of the covered lanes that are nearer than the layer.

    Args:
        rule: IN_ORDER, PEELED or ANY_ORDER; a constant makes faster code.
        w, covered, ids: f32x8, m8, i32x8: 1/z, coverage and primitive id of the pixels from index ``pixel`` on.
    """
    old = vec.load_volatile(layer.inv_z, pixel)
    if rule == ANY_ORDER:
        covered = covered & ((w > old) | ((w == old) & (ids < vec.load(layer.ids, pixel))))
    else:
        covered = covered & (w > old)
    if rule == PEELED:
        covered = covered & _between(frame, pixel, w, ids)
    vec.store(layer.inv_z, pixel, vec.select(covered, w, old))
    vec.store_where(layer.ids, pixel, covered, ids)


@device_function
def depth_test_pixel(frame, layer, rule, pixel, w, primitive_id):
    """``depth_test`` of one covered pixel, for primitives in any order."""
    old = layer.inv_z[pixel]
    other = layer.ids[pixel]
    # Without a branch: which of two overlapping meshes is nearer cannot be predicted.
    accepted = (w > old) | ((w == old) & (primitive_id < other))
    if rule == PEELED:
        accepted = accepted & (vec.movemask(_pixel_between(frame, pixel, w, primitive_id)) != 0)
    layer.inv_z[pixel] = w if accepted else old
    layer.ids[pixel] = primitive_id if accepted else other


@device_function
def _pixel_between(frame, pixel, w, primitive_id):
    """``_between`` of one pixel. The layers are read from the start of its eight pixels, not past the image."""
    start = pixel & ~np.int64(vec.LANES - 1)
    lane = vec.iota() == vec.i32(pixel - start)
    return lane & _between(frame, start, vec.f32(w), vec.i32(primitive_id))
