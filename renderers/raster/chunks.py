"""Arrays of one chunk of primitives within a frame's memory: what setup writes and bands read."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.pointers import address, i32_at, u16_at
from renderers.raster.layout import BINNED_BYTES, CHUNK, MAX_BINS, MAX_TINY_PIXELS

_PREFETCH_DISTANCE: Final = 6
"""Number of primitives of a bin between the one that is drawn and the one that is prefetched."""


@inlined
def bin_starts_of(frame, chunk):
    """Return pointer to the int32 that say where a chunk's bins start.

    They are: starts of the bins in ``bins_of``, and their end; starts of the bins in ``tiny_pixels_of``, and their end;
    number of tall primitives without the back faces that are kept, and with them.
    """
    return i32_at(address(frame.bin_starts) + 4 * chunk * (2 * frame.bin_count + 4))


@inlined
def bins_of(frame, chunk):
    """Return pointer to (MAX_BINS * CHUNK) uint16: primitives of the chunk, bin by bin."""
    return u16_at(address(frame.bins) + 2 * chunk * CHUNK * MAX_BINS)


@inlined
def tall_of(frame, chunk):
    """Return pointer to (CHUNK,) uint16: primitives of the chunk that touch more than MAX_BINS bands."""
    return u16_at(address(frame.tall) + 2 * chunk * CHUNK)


@inlined
def bands_of(frame, chunk):
    """Return pointer to 4 int32: first and last band that the chunk touches, and the same of back faces kept."""
    return i32_at(address(frame.chunk_bands) + 16 * chunk)


@inlined
def tiny_pixels_of(frame, chunk):
    """Return pointer to (MAX_TINY_PIXELS, 4) int32: pixel, bits of 1/z, primitive id and bin, bin by bin."""
    return i32_at(address(frame.tiny_pixels) + 16 * chunk * MAX_TINY_PIXELS)


@inlined
def primitives_of(frame, chunk):
    """Return the address of the chunk's CHUNK primitives of BINNED_BYTES."""
    return frame.binned + chunk * CHUNK * BINNED_BYTES


@inlined
def prefetch_primitive(bins, k, end, primitives):
    """Prefetch the primitive ``_PREFETCH_DISTANCE`` after index ``k`` of a bin, whose primitives are not in sequence.

    Args:
        end: end of the bin.
        primitives: address of the chunk's primitives.
    """
    ahead = np.int64(bins[max(min(k + _PREFETCH_DISTANCE, end - 1), 0)])
    vec.prefetch(i32_at(primitives), BINNED_BYTES // 4 * ahead)
