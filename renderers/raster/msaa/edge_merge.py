"""What pixels of two records see, and which records look the same where they meet: triangles of one surface that share
an edge and its normals."""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import i32_at, i64_at, u32_at
from renderers.primitive_ids import instance_of
from renderers.raster.layout import (
    A_COLUMNS,
    A_ELEMENTS,
    A_NORMALS,
    A_TOPOLOGY,
    J_ALL_INSTANCES,
    J_ALL_MESHES,
    J_FIRST_RECORD,
)


@inlined
def _other(seen, first, other):
    return vec.select(seen == first, other, seen)


@inlined
def _counted(seen, record, count):
    return vec.select(seen == record, count + vec.i32(1), count)


@inlined
def pairs_of(samples):
    """Of eight pixels, which see two records and nothing else, the record of more samples, or of the first one, the
    other one, and how many samples see that.

    Args:
        samples: eight f32x8, the bits of what each pixel sees, sample by sample.
    """
    s0, s1, s2, s3 = vec.bits_of(samples[0]), vec.bits_of(samples[1]), vec.bits_of(samples[2]), vec.bits_of(samples[3])
    s4, s5, s6, s7 = vec.bits_of(samples[4]), vec.bits_of(samples[5]), vec.bits_of(samples[6]), vec.bits_of(samples[7])
    other = _other(s4, s0, _other(s3, s0, _other(s2, s0, _other(s1, s0, s0))))
    other = _other(s7, s0, _other(s6, s0, _other(s5, s0, other)))
    own = _counted(s4, s0, _counted(s3, s0, _counted(s2, s0, _counted(s1, s0, vec.i32(1)))))
    own = _counted(s7, s0, _counted(s6, s0, _counted(s5, s0, own)))
    rest = _counted(s4, other, _counted(s3, other, _counted(s2, other, _counted(s1, other, vec.i32(0)))))
    rest = _counted(s7, other, _counted(s6, other, _counted(s5, other, rest)))
    two = (s0 != other) & ((s0 | other) >= vec.i32(0)) & (own + rest == vec.i32(vec.LANES))
    turned = rest > own
    return two, vec.select(turned, other, s0), vec.select(turned, s0, other), vec.least(own, rest)


@inner
def _ask_for(job, record, known):
    """Fill ``known`` with what ``joined`` needs of the instance of a record."""
    first = i64_at(job[J_FIRST_RECORD])
    instance = instance_of(first, job[J_ALL_INSTANCES], record, 0)
    mesh = i64_at(job[J_ALL_MESHES] + 8 * A_COLUMNS * instance)
    known[0], known[1] = first[instance], first[instance + 1]
    known[2] = mesh[A_ELEMENTS] if mesh[A_TOPOLOGY] == 3 and mesh[A_NORMALS] != 0 else 0


@inlined
def joined(job, a, b, known):
    """Whether two records are triangles with normals of one instance that share an edge.

    Args:
        known: pointer to 3 int64 about the instance asked for last: its first record, the one after its last, and the
            address of its elements (0: they are no triangles with normals).
    """
    if a < known[0] or a >= known[1]:
        _ask_for(job, a, known)
    if b < known[0] or b >= known[1] or known[2] == 0:
        return False
    # Triangles that are drawn have three corners: which of two is asked about the other's does not matter.
    low, high = min(a, b) - known[0], max(a, b) - known[0]
    p, q = u32_at(known[2] + 12 * low), u32_at(known[2] + 12 * high)
    if high < 2:
        shared = 0
        for i in range(3):
            shared += (p[i] == q[0]) | (p[i] == q[1]) | (p[i] == q[2])
        return shared >= 2
    corners = vec.load(q, -5)  # and the five before them
    met = (corners == vec.i32(p[0])) | (corners == vec.i32(p[1])) | (corners == vec.i32(p[2]))
    return vec.count_bits(vec.bits(met) >> 5) >= 2


@inlined
def apart(job, shown, others, begin, count, known):
    """Which of up to eight pairs of records, ``count`` from ``begin`` on, are not of ``joined``; a mask."""
    a, b = vec.load(shown, begin), vec.load(others, begin)
    zero, one, two, three = vec.i32(0), vec.i32(1), vec.i32(2), vec.i32(3)
    different = (np.int64(1) << min(count, vec.LANES)) - 1
    pending = different
    while pending != 0:  # once, where all are of one instance
        record = np.int64(shown[begin + vec.lowest_bit(pending)])
        if record < known[0] or record >= known[1]:
            _ask_for(job, record, known)
        first, end = vec.i32(known[0]), vec.i32(known[1])
        own = (a >= first) & (a < end)
        both = own & (b >= first) & (b < end)
        pending &= ~vec.bits(own)
        if known[2] == 0 or vec.bits(both) == 0:
            continue
        elements = i32_at(known[2])
        p, q = vec.select(both, a - first, zero) * three, vec.select(both, b - first, zero) * three
        q0, q1, q2 = vec.gather(elements, q), vec.gather(elements, q + one), vec.gather(elements, q + two)
        p0, p1, p2 = vec.gather(elements, p), vec.gather(elements, p + one), vec.gather(elements, p + two)
        met0 = (p0 == q0) | (p0 == q1) | (p0 == q2)
        met1 = (p1 == q0) | (p1 == q1) | (p1 == q2)
        met2 = (p2 == q0) | (p2 == q1) | (p2 == q2)
        different &= ~vec.bits(both & ((met0 & met1) | (met0 & met2) | (met1 & met2)))
    return different
