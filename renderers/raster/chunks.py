"""Search of a CHUNK for what lies in a bin."""

from __future__ import annotations

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined


@inlined
def primitives_in_bin(chunk, k, bin_index):
    """Return which of the eight primitives from ``k`` on touch a bin, a bit for each, int64."""
    bins, searched = vec.load(chunk.bins, k), vec.i32(bin_index)
    touches = ((bins & vec.i32(0xFFFF)) <= searched) & ((bins >> vec.i32(16)) >= searched)
    return vec.movemask(touches & _used_lanes(k, chunk.count))


@inlined
def pixels_between(chunk, k, begin, end):
    """Return which of the eight tiny triangles' pixels from ``k`` on are in ``begin .. end``, a bit for each, int64."""
    pixels = vec.load(chunk.pixels, k)
    return vec.movemask((pixels >= vec.i32(begin)) & (pixels < vec.i32(end)) & _used_lanes(k, chunk.pixel_count))


@inlined
def _used_lanes(k, count):
    """Return m8: lanes that hold one of ``count`` values, ``k`` of which come before the first lane."""
    return vec.iota() < vec.i32(count - k)
