"""Arrays of one chunk of primitives within a frame's memory: what setup writes and bands read."""

from __future__ import annotations

from renderers.compiler.device_function import inlined
from renderers.compiler.pointers import advance
from renderers.raster.layout import CHUNK, MAX_BINS, MAX_TINY_PIXELS


@inlined
def bin_starts_of(frame, chunk):
    """Return pointer to the int32 that say where a chunk's bins start.

    They are: starts of the bins in ``bins_of``, and their end; starts of the bins in ``tiny_pixels_of``, and their end;
    number of tall primitives without the back faces that are kept, and with them.
    """
    return advance(frame.bin_starts, chunk * (2 * frame.bin_count + 4))


@inlined
def bins_of(frame, chunk):
    """Return pointer to (MAX_BINS * CHUNK) uint16: primitives of the chunk, bin by bin."""
    return advance(frame.bins, chunk * CHUNK * MAX_BINS)


@inlined
def tall_of(frame, chunk):
    """Return pointer to (CHUNK,) uint16: primitives of the chunk that touch more than MAX_BINS bands."""
    return advance(frame.tall, chunk * CHUNK)


@inlined
def bands_of(frame, chunk):
    """Return pointer to 4 int32: first and last band that the chunk touches, and the same of back faces kept."""
    return advance(frame.chunk_bands, 4 * chunk)


@inlined
def tiny_pixels_of(frame, chunk):
    """Return pointer to (MAX_TINY_PIXELS, 4) int32: pixel, bits of 1/z, primitive id and bin, bin by bin."""
    return advance(frame.tiny_pixels, 4 * chunk * MAX_TINY_PIXELS)


@inlined
def primitives_of(frame, chunk):
    """Return the chunk's primitives, (CHUNK,) BINNED."""
    return frame.binned[chunk * CHUNK]
