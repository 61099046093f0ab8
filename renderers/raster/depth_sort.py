"""In which order the records of a band with several samples a pixel are drawn: the nearest first.

What lies behind is passed over then, not drawn and drawn over. The order decides only what costs more to find out,
never what is seen: of two records at the same 1/z, the one with the lower number is seen, whichever comes first.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import i32_at, u16_at
from renderers.raster.layout import (
    CHUNK,
    J_BANDS,
    J_CHUNKS,
    J_OFFSETS,
    J_RANGES,
    J_RECORDS,
    J_SMALL,
    J_STOP,
    J_TALL,
    R_HIGH,
    RECORD_BYTES,
    SMALL_BANDS,
)

_BITS: Final = 9
BUCKETS: Final = 1 << _BITS
"""Records of one bucket keep the order in which they are listed. By the bits of 1/z, which grow as its logarithm: a
triangle near the eye leaves the others most of the buckets."""


@inlined
def _met(job, band, chunk):
    """Whether records of a chunk may touch a band."""
    ranges = i32_at(job[J_RANGES])
    return band >= ranges[4 * chunk] and band <= ranges[4 * chunk + 1]


@inner
def count_records(job, band):
    """How many records may touch a band."""
    lists, count = job[J_BANDS], np.int64(0)
    for chunk in range(job[J_CHUNKS]):
        if _met(job, band, chunk):
            offsets = i32_at(job[J_OFFSETS] + 4 * chunk * (2 * lists + 4))
            count += np.int64(offsets[band + 1]) - np.int64(offsets[band]) + np.int64(offsets[2 * lists + 2])
    return count


@inlined
def _note(records, place, found, keys, count):
    """One more record and its greatest 1/z, the bits of which are ordered as the value is."""
    found[count] = place
    keys[count] = max(records[RECORD_BYTES // 4 * place + R_HIGH], 0)
    return count + 1


@inner
def front_to_back(job, band, found, keys, starts, sorted_places):
    """Write the places among all of the records that may touch a band, the nearest first; return how many there are, 0
    when the frame is not wanted any more.

    Args:
        found, keys, sorted_places: pointers to room for ``count_records`` int32. starts: to BUCKETS int32.
    """
    lists, records = job[J_BANDS], i32_at(job[J_RECORDS])
    count = np.int64(0)
    for chunk in range(job[J_CHUNKS]):
        if not _met(job, band, chunk):
            continue
        if is_set(job[J_STOP]):
            return np.int64(0)
        offsets = i32_at(job[J_OFFSETS] + 4 * chunk * (2 * lists + 4))
        small = u16_at(job[J_SMALL] + 2 * chunk * CHUNK * SMALL_BANDS)
        for k in range(offsets[band], offsets[band + 1]):
            count = _note(records, chunk * CHUNK + np.int64(small[k]), found, keys, count)
        tall = u16_at(job[J_TALL] + 2 * chunk * CHUNK)
        for k in range(offsets[2 * lists + 2]):
            count = _note(records, chunk * CHUNK + np.int64(tall[k]), found, keys, count)
    nearest, farthest = np.int64(0), np.int64(0x7FFFFFFF)
    for k in range(count):
        key = np.int64(keys[k])
        nearest, farthest = max(nearest, key), min(farthest, key)
    shift = max(vec.highest_bit(max(nearest - farthest, np.int64(1))) + 1 - _BITS, 0)
    for bucket in range(BUCKETS):
        starts[bucket] = 0
    for k in range(count):
        bucket = (nearest - keys[k]) >> shift
        keys[k] = bucket
        starts[bucket] += 1
    total = 0
    for bucket in range(BUCKETS):
        here = starts[bucket]
        starts[bucket] = total
        total += here
    for k in range(count):
        bucket = keys[k]
        to = np.int64(starts[bucket])
        starts[bucket] = to + 1
        sorted_places[to] = found[k]
    return count
