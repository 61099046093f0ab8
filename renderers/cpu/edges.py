"""From a band's samples to what is shaded: one record for every pixel, and more for those at edges.

Triangles of one surface that meet within a pixel look the same there: where they share an edge and its normals, they
are shaded once, as one. What is left are silhouettes, creases and seams.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from renderers import simd as vec
from renderers.cpu.layout import (
    A_COLUMNS,
    A_ELEMENTS,
    A_NORMALS,
    A_TOPOLOGY,
    J_ALL_INSTANCES,
    J_ALL_MESHES,
    J_COLUMNS,
    J_FIRST_RECORD,
    J_HEIGHT,
    J_PAIRED,
    J_SAMPLE_IDS,
    J_SAMPLE_INV_Z,
    J_STRIDE,
    J_WIDTH,
)
from renderers.cpu.multisample import raster_samples
from renderers.cpu.visibility import BAND_ROWS
from renderers.jit import kernel
from renderers.pointers import f64_at, i32_at, i64_at, u8_at, u32_at
from renderers.samples import (
    E_COLORS,
    E_COUNTS,
    E_IDS,
    E_MIXED,
    E_MIXES,
    E_PLACES,
    E_RECORDS,
    E_ROOM,
    E_SAMPLE_IDS,
    E_SAMPLE_INV_Z,
    E_WEIGHTS,
)

_REACH: Final = 32
"""Places that an entry moves to lie beside those of its own instance: rows are nearly sorted, and never take long."""


@njit(nogil=True, error_model="numpy")
def _ones(bits):  # type: ignore[no-untyped-def]
    """How many of eight bits are set."""
    bits = bits - ((bits >> 1) & 0x55)
    bits = (bits & 0x33) + ((bits >> 2) & 0x33)
    return (bits + (bits >> 4)) & 0x0F


@njit(nogil=True, error_model="numpy")
def _ask_for(job, record, known):  # type: ignore[no-untyped-def]
    """Fill ``known`` with what ``_joined`` needs of the instance of a record."""
    first = i64_at(job[J_FIRST_RECORD])
    low, high = np.int64(0), job[J_ALL_INSTANCES]
    while high - low > 1:
        middle = (low + high) >> 1
        if first[middle] <= record:
            low = middle
        else:
            high = middle
    mesh = i64_at(job[J_ALL_MESHES] + 8 * A_COLUMNS * low)
    known[0], known[1] = first[low], first[low + 1]
    known[2] = mesh[A_ELEMENTS] if mesh[A_TOPOLOGY] == 3 and mesh[A_NORMALS] != 0 else 0


@njit(nogil=True, error_model="numpy", forceinline=True)
def _joined(job, a, b, known):  # type: ignore[no-untyped-def]
    """Whether two records are triangles with normals of one instance that share an edge.

    Args:
        known: pointer to 3 int64 about the instance asked for last: its first record, the one after its last, and the
            address of its elements (0: they are no triangles with normals).
    """
    if a < known[0] or a >= known[1]:
        _ask_for(job, a, known)
    if b < known[0] or b >= known[1] or known[2] == 0:
        return False
    p, q = u32_at(known[2] + 12 * (a - known[0])), u32_at(known[2] + 12 * (b - known[0]))
    shared = 0
    for i in range(3):
        shared += (p[i] == q[0]) | (p[i] == q[1]) | (p[i] == q[2])
    return shared >= 2


@njit(nogil=True, error_model="numpy")
def _add(records, places, weights, count, record, place, weight):  # type: ignore[no-untyped-def]
    """One more entry of a row, among the last ones in the order of records."""
    at = count
    least = max(count - _REACH, 0)
    while at > least and records[at - 1] > record:
        records[at], places[at], weights[at] = records[at - 1], places[at - 1], weights[at - 1]
        at -= 1
    records[at], places[at], weights[at] = record, place, weight


@njit(nogil=True, error_model="numpy")
def _sort_out(job, edges, band, scratch, known):  # type: ignore[no-untyped-def]
    """Fill E_IDS and the lists of the band's rows.

    Args:
        scratch: pointer to 32 int32. known: see ``_joined``.
    """
    stride, width, room = job[J_STRIDE], job[J_WIDTH], edges[E_ROOM]
    paired = job[J_PAIRED]
    number_of_samples = vec.LANES >> paired
    everybody = np.int64(255) if paired == 0 else np.int64(15)
    for row in range(min(BAND_ROWS, job[J_HEIGHT] - band * BAND_ROWS)):
        samples = i32_at(edges[E_SAMPLE_IDS] + 4 * number_of_samples * row * stride)
        ids = i32_at(edges[E_IDS] + 4 * row * stride)
        records = i32_at(edges[E_RECORDS] + 4 * row * room)
        places = i32_at(edges[E_PLACES] + 4 * row * room)
        weights = u8_at(edges[E_WEIGHTS] + row * room)
        mixes = i32_at(edges[E_MIXES] + 4 * row * stride)
        count = mixed = 0
        for x in range(width):
            at = number_of_samples * x
            seen = vec.load(samples, at)  # of four samples, the next pixel's, too
            same = vec.bits(seen == vec.spread0(seen)) & everybody
            if same == everybody:
                ids[x] = samples[at]
                continue
            # Most often, two triangles of a smooth surface meet.
            one, other = np.int64(samples[at]), np.int64(samples[at + vec.lowest_bit(everybody & ~same)])
            others = vec.bits(seen == vec.i32(other)) & everybody
            if same | others == everybody and one >= 0 and other >= 0 and _joined(job, one, other, known):
                ids[x] = one if _ones(same) >= _ones(others) else other
                continue
            # Each record once: scratch has its number, its samples, the group it is in, and the group's samples.
            remaining, found, nothing = everybody, 0, 0
            while remaining != 0:
                record = samples[at + vec.lowest_bit(remaining)]
                same = vec.bits(seen == vec.i32(np.int64(record))) & everybody
                remaining &= ~same
                number = _ones(same) << paired
                if record < 0:
                    nothing = number
                    continue
                group = np.int64(found)
                for k in range(found):
                    if _joined(job, np.int64(scratch[k]), np.int64(record), known):
                        group = np.int64(scratch[16 + k])
                        break
                scratch[found], scratch[8 + found], scratch[16 + found] = record, number, group
                scratch[24 + found] = 0
                scratch[24 + group] += number
                found += 1
            best = 0
            for k in range(1, found):
                if scratch[24 + k] > scratch[24 + best]:
                    best = k
            own = np.int64(scratch[24 + best])
            for each in range(found):
                if scratch[16 + each] != each:
                    continue
                largest = each
                for k in range(each + 1, found):
                    if scratch[16 + k] == each and scratch[8 + k] > scratch[8 + largest]:
                        largest = k
                if each == best:
                    ids[x] = scratch[largest]
                else:
                    _add(records, places, weights, count, scratch[largest], x, scratch[24 + each])
                    count += 1
            if own < vec.LANES:
                mixes[mixed] = (x << 8) | (own << 4) | nothing
                mixed += 1
        i32_at(edges[E_COUNTS])[row] = count
        i32_at(edges[E_MIXED])[row] = mixed


@kernel("void(int64, int64, int64, int64)")
def draw_samples(job_at, lens_at, band, edges_at):  # type: ignore[no-untyped-def]
    """Raster a band of the picture with eight samples a pixel and find out what is to be shaded.

    Args:
        job_at, lens_at: as for ``resolve.draw_band``. edges_at: address of E_COLUMNS int64.
    """
    job, edges = i64_at(job_at), i64_at(edges_at)
    own_job = np.empty(J_COLUMNS, np.int64)
    for k in range(J_COLUMNS):
        own_job[k] = job[k]
    # Kernels count pixels from the picture's first row.
    before = 4 * (vec.LANES >> job[J_PAIRED]) * band * BAND_ROWS * job[J_STRIDE]
    own_job[J_SAMPLE_IDS] = edges[E_SAMPLE_IDS] - before
    own_job[J_SAMPLE_INV_Z] = edges[E_SAMPLE_INV_Z] - before
    job = i64_at(np.int64(own_job.ctypes.data))
    raster_samples(job, f64_at(lens_at), band)
    own_scratch = np.empty(32, np.int32)
    own_known = np.zeros(3, np.int64)
    _sort_out(job, edges, band, i32_at(np.int64(own_scratch.ctypes.data)), i64_at(np.int64(own_known.ctypes.data)))
    own_job[0] = own_scratch[0] = own_known[0] = 0  # the pointers above do not keep the arrays alive


@kernel("void(int64, int64, int64, int64, int64, int64, int64)")
def mix_edges(edges_at, stride, width, row_begin, row_end, background, picture_at):  # type: ignore[no-untyped-def]
    """Mix the band's pixels at edges as they are shown, as VTK mixes them.

    Args:
        edges_at: address of E_COLUMNS int64, E_COLORS filled. stride: J_STRIDE.
        row_begin, row_end: the band's rows of the picture.
        background: red, green, blue, lowest byte first.
        picture_at: address of (H, W, 3) uint8, which has the colours of E_IDS.
    """
    edges = i64_at(edges_at)
    room = edges[E_ROOM]
    own_sums = np.empty(3 * width, np.int32)
    sums = i32_at(np.int64(own_sums.ctypes.data))
    for y in range(row_begin, row_end):
        row = y - row_begin
        picture = u8_at(picture_at + 3 * y * width)
        mixes = i32_at(edges[E_MIXES] + 4 * row * stride)
        mixed = np.int64(i32_at(edges[E_MIXED])[row])
        for k in range(mixed):
            mix = np.int64(mixes[k])
            x, own, nothing = mix >> 8, (mix >> 4) & 15, mix & 15
            for c in range(3):
                sums[3 * x + c] = own * picture[3 * x + c] + nothing * ((background >> (8 * c)) & 255)
        places = i32_at(edges[E_PLACES] + 4 * row * room)
        weights = u8_at(edges[E_WEIGHTS] + row * room)
        colors = u8_at(edges[E_COLORS] + 3 * row * room)
        for k in range(i32_at(edges[E_COUNTS])[row]):
            x, weight = np.int64(places[k]), np.int64(weights[k])
            for c in range(3):
                sums[3 * x + c] += weight * colors[3 * k + c]
        for k in range(mixed):
            x = np.int64(mixes[k]) >> 8
            for c in range(3):
                picture[3 * x + c] = (sums[3 * x + c] + vec.LANES // 2) // vec.LANES
    own_sums[0] = 0  # the pointer above does not keep the array alive
