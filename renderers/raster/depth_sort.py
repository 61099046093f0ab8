"""Front-to-back order of a band's primitives, for rasterization with several samples per pixel.

What lies behind is then skipped instead of drawn and overdrawn. The order affects cost only: of two primitives at the
same 1/z, the one with the lower id is visible, whichever comes first.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import address, i32_at, u16_at
from renderers.raster.layout import BINNED_BYTES, CHUNK, MAX_BINS

_BITS: Final = 9
BUCKETS: Final = 1 << _BITS
"""Buckets of the sort, which is stable within each. Keys are the bits of 1/z, which grow as its logarithm: a triangle
near the camera leaves most of the buckets to the others."""
_HIGH: Final = 15
"""Index of BINNED.high among its int32."""


@inlined
def _touches(frame, band_index, chunk):
    """Return whether primitives of a chunk may touch a band."""
    bands = i32_at(address(frame.chunk_bands) + 16 * chunk)
    return band_index >= bands[0] and band_index <= bands[1]


@device_function
def count_primitives(frame, band_index):
    """Return the number of primitives that may touch a band."""
    bins, count = frame.band_count, np.int64(0)
    for chunk in range(frame.chunk_count):
        if _touches(frame, band_index, chunk):
            starts = i32_at(address(frame.bin_starts) + 4 * chunk * (2 * bins + 4))
            count += np.int64(starts[band_index + 1]) - np.int64(starts[band_index]) + np.int64(starts[2 * bins + 2])
    return count


@inlined
def _append(binned, index, found, keys, count):
    """Append a primitive and the bits of its greatest 1/z, which are ordered as the values are; return the count."""
    found[count] = index
    keys[count] = max(binned[BINNED_BYTES // 4 * index + _HIGH], 0)
    return count + 1


@device_function
def front_to_back(frame, band_index, found, keys, starts, ordered):
    """Write the indices of the primitives that may touch a band, the nearest first.

    Args:
        found, keys, ordered: pointers to room for ``count_primitives`` int32. starts: to BUCKETS int32.

    Returns:
        Their number; 0 if the stop flag is set.
    """
    bins, binned = frame.band_count, i32_at(frame.binned)
    count = np.int64(0)
    for chunk in range(frame.chunk_count):
        if not _touches(frame, band_index, chunk):
            continue
        if is_set(frame.stop):
            return np.int64(0)
        bin_starts = i32_at(address(frame.bin_starts) + 4 * chunk * (2 * bins + 4))
        members = u16_at(address(frame.bins) + 2 * chunk * CHUNK * MAX_BINS)
        for k in range(bin_starts[band_index], bin_starts[band_index + 1]):
            count = _append(binned, chunk * CHUNK + np.int64(members[k]), found, keys, count)
        tall = u16_at(address(frame.tall) + 2 * chunk * CHUNK)
        for k in range(bin_starts[2 * bins + 2]):
            count = _append(binned, chunk * CHUNK + np.int64(tall[k]), found, keys, count)
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
        ordered[to] = found[k]
    return count
