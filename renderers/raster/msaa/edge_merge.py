"""Pairs of primitives at edge pixels, and which of them look the same there: triangles of one instance that share an
edge and its normals."""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import address, i32_at, u32_at
from renderers.primitive_ids import instance_of
from renderers.raster.layout import TRIANGLES


@inlined
def _second(seen, first, other):
    return vec.select(seen == first, other, seen)


@inlined
def _counted(seen, primitive_id, count):
    return vec.select(seen == primitive_id, count + vec.i32(1), count)


@inlined
def pairs_of(samples):
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
    other = _second(s4, s0, _second(s3, s0, _second(s2, s0, _second(s1, s0, s0))))
    other = _second(s7, s0, _second(s6, s0, _second(s5, s0, other)))
    own = _counted(s4, s0, _counted(s3, s0, _counted(s2, s0, _counted(s1, s0, vec.i32(1)))))
    own = _counted(s7, s0, _counted(s6, s0, _counted(s5, s0, own)))
    rest = _counted(s4, other, _counted(s3, other, _counted(s2, other, _counted(s1, other, vec.i32(0)))))
    rest = _counted(s7, other, _counted(s6, other, _counted(s5, other, rest)))
    two = (s0 != other) & ((s0 | other) >= vec.i32(0)) & (own + rest == vec.i32(vec.LANES))
    turned = rest > own
    return two, vec.select(turned, other, s0), vec.select(turned, s0, other), vec.minimum(own, rest)


@device_function
def _look_up(frame, primitive_id, known):
    """Fill ``known`` with what ``are_joined`` needs of a primitive's instance."""
    first = frame.first_ids
    index = instance_of(first, frame.instance_count, primitive_id, 0)
    instance = frame.instances[index]
    known[0], known[1] = first[index], first[index + 1]
    has_normals = instance.topology == TRIANGLES and instance.mesh_normals != 0
    known[2] = address(instance.mesh_indices) if has_normals else 0


@inlined
def are_joined(frame, a, b, known):
    """Return whether two primitives are triangles with normals of one instance that share an edge.

    Args:
        known: pointer to 3 int64 about the instance looked up last: its first primitive id, the one after its last, and
            the address of its indices (0: no triangles with normals).
    """
    if a < known[0] or a >= known[1]:
        _look_up(frame, a, known)
    if b < known[0] or b >= known[1] or known[2] == 0:
        return False
    # Visible triangles have three different corners: the test is symmetric.
    low, high = min(a, b) - known[0], max(a, b) - known[0]
    p, q = u32_at(known[2] + 12 * low), u32_at(known[2] + 12 * high)
    if high < 2:
        shared = 0
        for i in range(3):
            shared += (p[i] == q[0]) | (p[i] == q[1]) | (p[i] == q[2])
        return shared >= 2
    corners = vec.load(q, -5)  # and the five before them
    met = (corners == vec.i32(p[0])) | (corners == vec.i32(p[1])) | (corners == vec.i32(p[2]))
    return vec.count_bits(vec.movemask(met) >> 5) >= 2


@inlined
def separate_pairs(frame, firsts, seconds, begin, count, known):
    """Return a mask of those of up to eight pairs, ``count`` from ``begin`` on, for which ``are_joined`` is False."""
    a, b = vec.load(firsts, begin), vec.load(seconds, begin)
    zero, one, two, three = vec.i32(0), vec.i32(1), vec.i32(2), vec.i32(3)
    separate = (np.int64(1) << min(count, vec.LANES)) - 1
    pending = separate
    while pending != 0:  # once, if all are of one instance
        primitive_id = np.int64(firsts[begin + vec.lowest_bit(pending)])
        if primitive_id < known[0] or primitive_id >= known[1]:
            _look_up(frame, primitive_id, known)
        first, end = vec.i32(known[0]), vec.i32(known[1])
        own = (a >= first) & (a < end)
        both = own & (b >= first) & (b < end)
        pending &= ~vec.movemask(own)
        if known[2] == 0 or vec.movemask(both) == 0:
            continue
        indices = i32_at(known[2])
        p, q = vec.select(both, a - first, zero) * three, vec.select(both, b - first, zero) * three
        q0, q1, q2 = vec.gather(indices, q), vec.gather(indices, q + one), vec.gather(indices, q + two)
        p0, p1, p2 = vec.gather(indices, p), vec.gather(indices, p + one), vec.gather(indices, p + two)
        met0 = (p0 == q0) | (p0 == q1) | (p0 == q2)
        met1 = (p1 == q0) | (p1 == q1) | (p1 == q2)
        met2 = (p2 == q0) | (p2 == q1) | (p2 == q2)
        separate &= ~vec.movemask(both & ((met0 & met1) | (met0 & met2) | (met1 & met2)))
    return separate
