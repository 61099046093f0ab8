"""Front-to-back order of a band's primitives, for rasterization with several samples per pixel.

Hidden primitives are then skipped instead of drawn and overdrawn. The order affects cost only: of two primitives at the
same 1/z, the one with the lower id is visible, whichever is drawn first.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import i32_at
from renderers.raster.chunks import bands_of, bin_starts_of, bins_of, tall_of
from renderers.raster.layout import BINNED_BYTES, CHUNK

_BITS: Final = 9
BUCKETS: Final = 1 << _BITS
"""Buckets of the sort, which is stable within each. Keys are the bits of 1/z, which grow as its logarithm: a triangle
near the camera leaves most of the buckets to the others."""
_INV_Z_MAX: Final = 15
"""Index of BINNED.inv_z_max among its int32."""


@inlined
def _touches(frame, band_index, chunk):
    """Return whether primitives of a chunk may touch a band."""
    bands = bands_of(frame, chunk)
    return band_index >= bands[0] and band_index <= bands[1]


@device_function
def count_primitives(frame, band_index):
    """Return the number of primitives that may touch a band."""
    bin_count, count = frame.bin_count, np.int64(0)
    for chunk in range(frame.chunk_count):
        if _touches(frame, band_index, chunk):
            starts = bin_starts_of(frame, chunk)
            count += np.int64(starts[band_index + 1]) - np.int64(starts[band_index])
            count += np.int64(starts[2 * bin_count + 2])
    return count


@inlined
def _append(binned, index, indices, keys, count):
    """Append a primitive and the bits of its greatest 1/z, which are ordered as the values are; return the count."""
    indices[count] = index
    keys[count] = max(binned[BINNED_BYTES // 4 * index + _INV_Z_MAX], 0)
    return count + 1


@device_function
def front_to_back(frame, band_index, indices, keys, starts, ordered):
    """Write the indices of the primitives that may touch a band, the nearest first.

    Args:
        indices, keys: pointers to scratch of ``count_primitives`` int32 each.
        starts: pointer to scratch of BUCKETS int32.
        ordered: pointer to ``count_primitives`` int32; gets the result.

    Returns:
        Their number; 0 if the stop flag is set.
    """
    bin_count, binned = frame.bin_count, i32_at(frame.binned)
    count = np.int64(0)
    for chunk in range(frame.chunk_count):
        if not _touches(frame, band_index, chunk):
            continue
        if is_set(frame.stop):
            return np.int64(0)
        bin_starts, bins, tall = bin_starts_of(frame, chunk), bins_of(frame, chunk), tall_of(frame, chunk)
        for k in range(bin_starts[band_index], bin_starts[band_index + 1]):
            count = _append(binned, chunk * CHUNK + np.int64(bins[k]), indices, keys, count)
        for k in range(bin_starts[2 * bin_count + 2]):
            count = _append(binned, chunk * CHUNK + np.int64(tall[k]), indices, keys, count)
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
        size = starts[bucket]
        starts[bucket] = total
        total += size
    for k in range(count):
        bucket = keys[k]
        position = np.int64(starts[bucket])
        starts[bucket] = position + 1
        ordered[position] = indices[k]
    return count
