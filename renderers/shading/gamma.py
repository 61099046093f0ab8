"""Gamma of the headlight looks: linear light to bytes, and back."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import f32_at, i32_at

GAMMA: Final = 2.2
"""VTK's physically based shader ends with ``pow(color, 1.0 / 2.2)``, not with the piecewise sRGB function."""

_STEPS: Final = 4096
"""Number of cells of DECODED."""
_LEAST: Final = np.float32(2.0**-20)
"""Smaller than the linear value of the lowest level above 0, (0.5 / 255)^2.2."""
_LEAST_BITS: Final = int(_LEAST.view(np.int32))
_CELL: Final = 16
"""Low bits of a float32 within one cell of the gamma table. A cell is 2^-7 of an octave, narrower than any level, so it
holds at most one threshold (checked below)."""


def _thresholds() -> NDArray[np.float32]:
    """Return (256,) float32: the least c for which ``round(255 c^(1/2.2))`` is k; the first is 0."""
    levels = np.arange(256)
    result = (np.maximum(levels - 0.5, 0.0) / 255.0) ** GAMMA
    single: NDArray[np.float32] = result.astype(np.float32)
    return single


def _gamma_cells() -> NDArray[np.int32]:
    """Return (2561,) int32, one for each cell of 2^16 neighbouring float32 from _LEAST to 1.

    Adding the bits of a value gives its level in the third byte: a cell holds the level of its first value times 2^16,
    plus the number of its values at or above the next threshold, minus the bits of its first value, modulo 2^32.
    """
    bits = np.arange(_LEAST_BITS, int(np.float32(1.0).view(np.int32)) + 2 * (1 << _CELL), 1 << _CELL, dtype=np.int32)
    starts = bits.view(np.float32)
    levels = np.searchsorted(THRESHOLDS, starts, side="right") - 1
    assert np.diff(levels).max() <= 1
    following = THRESHOLDS[np.minimum(levels + 1, 255)].view(np.int32)
    above = np.where(levels < 255, np.maximum(bits + (1 << _CELL) - following, 0), 0)
    cells: NDArray[np.int32] = ((levels << _CELL) + above - bits)[:-1].astype(np.int32)
    return cells


DARK: Final = np.float32(2.0**-40)
"""Smaller linear values are shown as 0: a thousandth of a level."""
_DARK_BITS: Final = int(DARK.view(np.int32))


def _encoded() -> NDArray[np.float32]:
    """Return (5122,) float32: ``c^(1/2.2)`` of every 2^16th float32 from DARK to 1.

    The first is 0. The last is for interpolation at 1.
    """
    bits = np.arange(_DARK_BITS, int(np.float32(1.0).view(np.int32)) + 2 * (1 << _CELL), 1 << _CELL, dtype=np.int32)
    result: NDArray[np.float32] = (bits.view(np.float32).astype(np.float64) ** (1.0 / GAMMA)).astype(np.float32)
    result[0] = 0.0
    return result


def _decoded() -> NDArray[np.float32]:
    """Return (_STEPS + 2,) float32: ``(i / _STEPS)^2.2``. The last entry is for interpolation at 1."""
    return (np.minimum(np.arange(_STEPS + 2) / _STEPS, 1.0) ** GAMMA).astype(np.float32)


DECODED: Final = _decoded()
ENCODED: Final = _encoded()
THRESHOLDS: Final = _thresholds()
GAMMA_CELLS: Final = _gamma_cells()


@inlined
def _gamma_level(c, cells):
    """Return ``round(255 c^(1/2.2))`` of an f32x8 in the third byte of an i32x8; the lower bytes are undefined.

    The table is exact for every float32. ``pow`` would differ between machines. Below 0 and NaN is 0, above 1 is 255.
    """
    c = vec.minimum(vec.maximum(c, vec.f32(_LEAST)), vec.f32(1.0))
    bits = vec.float_bits(c)
    return vec.gather(i32_at(cells - 4 * (_LEAST_BITS >> _CELL)), bits >> vec.i32(_CELL)) + bits


@inlined
def gamma_pixels(r, g, b, cells):
    """Return eight linear colours (f32x8 each) as packed pixels, red in the lowest byte.

    Args:
        cells: address of ``GAMMA_CELLS``.
    """
    red, green = _gamma_level(r, cells) >> vec.i32(_CELL), _gamma_level(g, cells) >> vec.i32(8)
    return red | (green & vec.i32(0xFF00)) | (_gamma_level(b, cells) & vec.i32(0xFF0000))


@inlined
def plain_byte(c):
    """Return ``round(255 c)`` of an f32x8 as i32x8. Below 0 and NaN is 0, above 1 is 255."""
    c = vec.minimum(vec.maximum(c, vec.f32(0.0)), vec.f32(1.0))
    return vec.to_i32(c * vec.f32(255.0) + vec.f32(0.5))


@device_function
def decode_gamma(c, decoded):
    """Return ``c^2.2`` of an f32x8 in 0..1 (clamped; NaN is 0), to 1e-7. ``decoded``: address of ``DECODED``."""
    at = vec.minimum(vec.maximum(c, vec.f32(0.0)), vec.f32(1.0)) * vec.f32(float(_STEPS))
    cell = vec.to_i32(at)
    table = f32_at(decoded)
    low = vec.gather(table, cell)
    return low + (at - vec.to_f32(cell)) * (vec.gather(table, cell + vec.i32(1)) - low)


@inlined
def encode_gamma(c, encoded):
    """Return ``c^(1/2.2)`` of an f32x8 in 0..1 (clamped; NaN is 0), to 2e-6. ``encoded``: address of ``ENCODED``."""
    c = vec.minimum(vec.maximum(c, vec.f32(DARK)), vec.f32(1.0))
    bits = vec.float_bits(c) - vec.i32(_DARK_BITS)
    cell = bits >> vec.i32(_CELL)
    table = f32_at(encoded)
    low = vec.gather(table, cell)
    share = vec.to_f32(bits & vec.i32((1 << _CELL) - 1)) * vec.f32(1.0 / (1 << _CELL))
    return low + share * (vec.gather(table, cell + vec.i32(1)) - low)
