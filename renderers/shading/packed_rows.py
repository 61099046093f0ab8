"""Packed rows: finished rows of an image as int32 per pixel, red in the lowest byte."""

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function
from renderers.compiler.kernel_types import I32, I64, U8, Pointer

_PREFETCH_DISTANCE: Final = 1024
"""Number of pixels between the one that is written and the one that is prefetched."""


@device_function
def write_packed_row(color: Pointer[U8], packed_row: Pointer[I32], width: I64) -> None:
    """Write a packed row, rounded up to whole vectors, to a row of the image, (width, 3)."""
    # A vector store overruns by up to four bytes. The last pixels are stored singly, to keep the next row intact.
    vector_end = max(width - 2, 0) // vec.LANES * vec.LANES
    for x in range(0, vector_end, vec.LANES):
        vec.prefetch(color, 3 * (x + _PREFETCH_DISTANCE))
        vec.store_rgb(color, 3 * x, vec.load(packed_row, x))
    for x in range(vector_end, width):
        for k in range(3):
            color[3 * x + k] = packed_row[x] >> (8 * k)
