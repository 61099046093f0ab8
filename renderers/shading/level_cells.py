"""Encoding of linear colours as bytes by a table, for ``gamma`` and ``studio.tone_mapping``.

The tables are exact for every float32, whereas the results of ``pow`` differ between machines. A cell is a range of
2^16 neighbouring float32, 2^-7 of an octave. It is narrower than any level, so that it contains at most two levels.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import I32, Pointer
from renderers.compiler.simd import F32x8, I32x8

CELL_BITS: Final = 16
CELL_SIZE: Final = 1 << CELL_BITS
_LOWEST: Final = np.float32(2.0**-20)
"""First value of a table. Level 1 begins above it, at (0.5 / 255)^2.2 with gamma, at 0.5 / 255 / 12.92 in sRGB."""
_FIRST_CELL: Final = int(_LOWEST.view(np.int32)) >> CELL_BITS


def cell_starts(lowest: np.float32) -> NDArray[np.int32]:
    """Return the bits of the first float32 of each cell from ``lowest`` to 1, and of the one after them."""
    one_bits = int(np.float32(1.0).view(np.int32))
    return np.arange(int(lowest.view(np.int32)), one_bits + 2 * CELL_SIZE, CELL_SIZE, dtype=np.int32)


def level_thresholds(decode: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> NDArray[np.float32]:
    """Return the least linear value of each level, (256,) float32; the first is 0. ``decode`` makes linear values."""
    return decode(np.maximum(np.arange(256) - 0.5, 0.0) / 255.0).astype(np.float32)


def level_cells(thresholds: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return the table for ``encoded_pixels``, (2561,) int32, one for each cell from _LOWEST to 1.

    The sum of a cell's entry and the bits of a value has the value's level in its third byte. An entry is the level of
    the cell's first value times 2^16, plus the number of values at or above the next threshold, minus the bits of the
    first value, modulo 2^32.
    """
    bits = cell_starts(_LOWEST)
    levels = np.searchsorted(thresholds, bits.view(np.float32), side="right") - 1
    assert np.diff(levels).max() <= 1  # a cell has at most one threshold
    next_threshold_bits = thresholds[np.minimum(levels + 1, 255)].view(np.int32)
    above = np.where(levels < 255, np.maximum(bits + CELL_SIZE - next_threshold_bits, 0), 0)
    cells: NDArray[np.int32] = ((levels << CELL_BITS) + above - bits)[:-1].astype(np.int32)
    return cells


@inlined
def _level(c: F32x8, cells: Pointer[I32]) -> I32x8:
    """Return the level, 0 .. 255, in the third byte. The lower bytes are undefined."""
    bits = vec.float_bits(vec.minimum(vec.maximum(c, vec.f32(_LOWEST)), vec.f32(1.0)))
    return vec.gather(cells, (bits >> vec.i32(CELL_BITS)) - vec.i32(_FIRST_CELL)) + bits


@inlined
def encoded_pixels(r: F32x8, g: F32x8, b: F32x8, cells: Pointer[I32]) -> I32x8:
    """Return eight linear colours, clamped to 0 .. 1 (NaN to 0), as packed pixels, by a table from ``level_cells``."""
    red, green = _level(r, cells) >> vec.i32(16), _level(g, cells) >> vec.i32(8)
    return red | (green & vec.i32(0xFF00)) | (_level(b, cells) & vec.i32(0xFF0000))
