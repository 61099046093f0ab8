"""Primitives that look the same where they meet: triangles of one instance that share an edge and its vertex normals.

Pixels that see two of them are shaded once, as one.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import address, i32_at, u32_at
from renderers.compiler.structs import I64, Struct
from renderers.primitive_ids import instance_of
from renderers.raster.layout import TOPOLOGY_TRIANGLES

CACHE: Final = Struct(
    "InstanceCache",
    {
        "first_id": I64,  # first primitive id of the instance
        "end_id": I64,  # the one after its last
        "indices": I64,  # address of its indices; 0: no triangles with normals
    },
)
"""The instance that was looked up last. All zero at first."""


@inlined
def _first_other_than(ids, first_ids, other_ids):
    """Return ``ids`` where they differ from ``first_ids``, else ``other_ids``."""
    return vec.select(ids == first_ids, other_ids, ids)


@inlined
def _count_equal(ids, wanted_ids, count):
    """Return ``count``, plus one where ``ids`` are the wanted ones."""
    return vec.select(ids == wanted_ids, count + vec.i32(1), count)


@inlined
def find_pairs(samples):
    """Find the two primitives of each of eight pixels.

    Args:
        samples: eight f32x8: the bits of each pixel's primitive ids, sample by sample.

    Returns:
        m8: pixels that see two primitives and nothing else; i32x8: the id with more samples (the first of equals), the
        other id, and the number of samples of the other.
    """
    s0, s1, s2, s3 = (
        vec.float_bits(samples[0]),
        vec.float_bits(samples[1]),
        vec.float_bits(samples[2]),
        vec.float_bits(samples[3]),
    )
    s4, s5, s6, s7 = (
        vec.float_bits(samples[4]),
        vec.float_bits(samples[5]),
        vec.float_bits(samples[6]),
        vec.float_bits(samples[7]),
    )
    other = _first_other_than(s2, s0, _first_other_than(s1, s0, s0))
    other = _first_other_than(s4, s0, _first_other_than(s3, s0, other))
    other = _first_other_than(s7, s0, _first_other_than(s6, s0, _first_other_than(s5, s0, other)))
    count = _count_equal(s3, s0, _count_equal(s2, s0, _count_equal(s1, s0, vec.i32(1))))
    count = _count_equal(s5, s0, _count_equal(s4, s0, count))
    count = _count_equal(s7, s0, _count_equal(s6, s0, count))
    other_count = _count_equal(s3, other, _count_equal(s2, other, _count_equal(s1, other, vec.i32(0))))
    other_count = _count_equal(s5, other, _count_equal(s4, other, other_count))
    other_count = _count_equal(s7, other, _count_equal(s6, other, other_count))
    is_pair = (s0 != other) & ((s0 | other) >= vec.i32(0)) & (count + other_count == vec.i32(vec.LANES))
    swapped = other_count > count
    return is_pair, vec.select(swapped, other, s0), vec.select(swapped, s0, other), vec.minimum(count, other_count)


@device_function
def _load_instance(frame, primitive_id, cache):
    """Fill the CACHE with a primitive's instance."""
    first_ids = frame.first_ids
    index = instance_of(first_ids, frame.instance_count, primitive_id, 0)
    instance = frame.instances[index]
    cache.first_id, cache.end_id = first_ids[index], first_ids[index + 1]
    has_normals = instance.topology == TOPOLOGY_TRIANGLES and instance.mesh_normals != 0
    cache.indices = address(instance.mesh_indices) if has_normals else 0


@inlined
def share_smooth_edge(frame, a, b, cache):
    """Return whether two primitives are triangles with normals of one instance that share an edge.

    Args:
        a, b: primitive ids.
        cache: a CACHE.
    """
    if a < cache.first_id or a >= cache.end_id:
        _load_instance(frame, a, cache)
    if b < cache.first_id or b >= cache.end_id or cache.indices == 0:
        return False
    # Visible triangles have three different corners: the test is symmetric.
    low, high = min(a, b) - cache.first_id, max(a, b) - cache.first_id
    p, q = u32_at(cache.indices + 12 * low), u32_at(cache.indices + 12 * high)
    if high < 2:
        shared = 0
        for i in range(3):
            shared += (p[i] == q[0]) | (p[i] == q[1]) | (p[i] == q[2])
        return shared >= 2
    corners = vec.load(q, -5)  # and the five before them
    is_shared = (corners == vec.i32(p[0])) | (corners == vec.i32(p[1])) | (corners == vec.i32(p[2]))
    return vec.count_bits(vec.movemask(is_shared) >> 5) >= 2


@inlined
def find_separate_pairs(frame, firsts, seconds, begin, count, cache):
    """Return a mask of those of up to eight pairs, ``count`` from ``begin`` on, that do not ``share_smooth_edge``."""
    a, b = vec.load(firsts, begin), vec.load(seconds, begin)
    zero, one, two, three = vec.i32(0), vec.i32(1), vec.i32(2), vec.i32(3)
    separate = (np.int64(1) << min(count, vec.LANES)) - 1
    pending = separate
    while pending != 0:  # once, if all are of one instance
        primitive_id = np.int64(firsts[begin + vec.lowest_bit(pending)])
        if primitive_id < cache.first_id or primitive_id >= cache.end_id:
            _load_instance(frame, primitive_id, cache)
        first_id, end_id = vec.i32(cache.first_id), vec.i32(cache.end_id)
        in_instance = (a >= first_id) & (a < end_id)
        both_in_instance = in_instance & (b >= first_id) & (b < end_id)
        pending &= ~vec.movemask(in_instance)
        if cache.indices == 0 or vec.movemask(both_in_instance) == 0:
            continue
        indices = i32_at(cache.indices)
        p = vec.select(both_in_instance, a - first_id, zero) * three
        q = vec.select(both_in_instance, b - first_id, zero) * three
        q0, q1, q2 = vec.gather(indices, q), vec.gather(indices, q + one), vec.gather(indices, q + two)
        p0, p1, p2 = vec.gather(indices, p), vec.gather(indices, p + one), vec.gather(indices, p + two)
        shared0 = (p0 == q0) | (p0 == q1) | (p0 == q2)
        shared1 = (p1 == q0) | (p1 == q1) | (p1 == q2)
        shared2 = (p2 == q0) | (p2 == q1) | (p2 == q2)
        share_edge = (shared0 & shared1) | (shared0 & shared2) | (shared1 & shared2)
        separate &= ~vec.movemask(both_in_instance & share_edge)
    return separate
