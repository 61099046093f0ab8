"""Bins of a chunk's primitives, and the search for what lies in one of them.

The bins that a primitive touches are packed as ``last << 16 | first``, int32.
"""

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import I64, i64
from renderers.compiler.simd import Mask8
from renderers.raster.layout import Chunk, RasterFrame
from renderers.visibility_buffer import BAND_ROWS


@device_function
def bin_range(first_row: I64, end_row: I64, base_bin: I64) -> tuple[I64, I64]:
    """Return the first and last bin of some rows; ``base_bin``: from ``base_bin_of``."""
    return base_bin + first_row // BAND_ROWS, base_bin + (end_row - 1) // BAND_ROWS


@inlined
def base_bin_of(frame: RasterFrame, is_culled: bool) -> I64:
    """Return the bin of the image's first band for a primitive; -1: it is culled, and not kept for later."""
    if not is_culled:
        return 0
    return frame.first_back_bin if frame.first_back_bin != 0 else -1


@inlined
def append_primitive(chunk: Chunk, first_bin: I64, last_bin: I64) -> None:
    """Add 1 to a Chunk's ``primitive_count``, and so keep the primitive that was written there, with its bins.

    If ``last_bin < first_bin`` it touches none, and is not kept: the next primitive is written over it.
    """
    if first_bin <= last_bin:
        chunk.bin_ranges[chunk.primitive_count] = last_bin << 16 | first_bin
        chunk.primitive_count += 1


@inlined
def bins_of(chunk: Chunk, k: I64) -> tuple[I64, I64]:
    """Return the first and last bin of a chunk's primitive ``k``."""
    return i64(chunk.bin_ranges[k] & 0xFFFF), i64(chunk.bin_ranges[k] >> 16)


@inlined
def primitives_in_bin(chunk: Chunk, k: I64, bin_index: I64) -> I64:
    """Return which of the eight primitives from ``k`` on touch a bin, a bit for each."""
    bins, searched = vec.load(chunk.bin_ranges, k), vec.i32(bin_index)
    first_bin, last_bin = bins & vec.i32(0xFFFF), bins >> vec.i32(16)
    return vec.movemask((first_bin <= searched) & (last_bin >= searched) & _used_lanes(k, chunk.primitive_count))


@inlined
def pixels_between(chunk: Chunk, k: I64, begin: I64, end: I64) -> I64:
    """Return which of the eight tiny triangles' pixels from ``k`` on are in ``begin .. end``, a bit for each."""
    pixels = vec.load(chunk.fragment_pixels, k)
    return vec.movemask((pixels >= vec.i32(begin)) & (pixels < vec.i32(end)) & _used_lanes(k, chunk.fragment_count))


@inlined
def _used_lanes(k: I64, count: I64) -> Mask8:
    """Return m8: lanes that hold one of ``count`` values, ``k`` of which come before the first lane."""
    return vec.iota() < vec.i32(count - k)
