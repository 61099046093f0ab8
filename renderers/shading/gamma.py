"""Gamma of the headlight looks: linear light to bytes, and back."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import address, i32_at
from renderers.shading.vec3 import saturate

GAMMA: Final = 2.2
"""VTK's physically based shader ends with ``pow(color, 1.0 / 2.2)``, not with the piecewise sRGB function."""

_STEPS: Final = 4096
"""Number of cells of LINEAR_FROM_GAMMA."""
_LOWEST: Final = np.float32(2.0**-20)
"""First value of GAMMA_CELLS, below the linear value of the lowest level above 0, (0.5 / 255)^2.2."""
_LOWEST_BITS: Final = int(_LOWEST.view(np.int32))
_DARK: Final = np.float32(2.0**-40)
"""Smaller linear values are encoded as 0: a thousandth of a level."""
_DARK_BITS: Final = int(_DARK.view(np.int32))
_CELL_BITS: Final = 16
"""Low bits of the float32 within one cell of a table: a cell is 2^-7 of an octave, narrower than any level."""
_CELL_SIZE: Final = 1 << _CELL_BITS


def _cell_bits(lowest_bits: int) -> NDArray[np.int32]:
    """Return the bits of every _CELL_SIZE-th float32 from a value to 1, and the one after it."""
    one_bits = int(np.float32(1.0).view(np.int32))
    return np.arange(lowest_bits, one_bits + 2 * _CELL_SIZE, _CELL_SIZE, dtype=np.int32)


def _level_thresholds() -> NDArray[np.float32]:
    """Return (256,) float32: the least c for which ``round(255 c^(1/2.2))`` is k; the first is 0."""
    encoded = np.maximum(np.arange(256) - 0.5, 0.0) / 255.0
    thresholds: NDArray[np.float32] = (encoded**GAMMA).astype(np.float32)
    return thresholds


def _gamma_cells() -> NDArray[np.int32]:
    """Return (2561,) int32, one for each cell of 2^16 neighbouring float32 from _LOWEST to 1.

    Adding the bits of a value gives its level in the third byte: a cell holds the level of its first value times 2^16,
    plus the number of its values at or above the next threshold, minus the bits of its first value, modulo 2^32.
    """
    bits = _cell_bits(_LOWEST_BITS)
    levels = np.searchsorted(THRESHOLDS, bits.view(np.float32), side="right") - 1
    assert np.diff(levels).max() <= 1  # a cell has at most one threshold
    next_threshold_bits = THRESHOLDS[np.minimum(levels + 1, 255)].view(np.int32)
    above = np.where(levels < 255, np.maximum(bits + _CELL_SIZE - next_threshold_bits, 0), 0)
    cells: NDArray[np.int32] = ((levels << _CELL_BITS) + above - bits)[:-1].astype(np.int32)
    return cells


def _gamma_from_linear() -> NDArray[np.float32]:
    """Return (5122,) float32: ``c^(1/2.2)`` of every 2^16th float32 from _DARK to 1.

    The first is 0. The last is for interpolation at 1.
    """
    linear = _cell_bits(_DARK_BITS).view(np.float32).astype(np.float64)
    encoded: NDArray[np.float32] = (linear ** (1.0 / GAMMA)).astype(np.float32)
    encoded[0] = 0.0
    return encoded


def _linear_from_gamma() -> NDArray[np.float32]:
    """Return (_STEPS + 2,) float32: ``(i / _STEPS)^2.2``. The last entry is for interpolation at 1."""
    return (np.minimum(np.arange(_STEPS + 2) / _STEPS, 1.0) ** GAMMA).astype(np.float32)


THRESHOLDS: Final = _level_thresholds()
GAMMA_CELLS: Final = _gamma_cells()
GAMMA_FROM_LINEAR: Final = _gamma_from_linear()
LINEAR_FROM_GAMMA: Final = _linear_from_gamma()


@inlined
def _gamma_level(c, cells):
    """Return ``round(255 c^(1/2.2))`` of an f32x8 in the third byte of an i32x8; the lower bytes are undefined.

    The table is exact for every float32. ``pow`` would differ between machines. Below 0 and NaN is 0, above 1 is 255.
    """
    c = vec.minimum(vec.maximum(c, vec.f32(_LOWEST)), vec.f32(1.0))
    bits = vec.float_bits(c)
    cells_by_high_bits = i32_at(address(cells) - 4 * (_LOWEST_BITS >> _CELL_BITS))
    return vec.gather(cells_by_high_bits, bits >> vec.i32(_CELL_BITS)) + bits


@inlined
def gamma_pixels(r, g, b, cells):
    """Return eight linear colours (f32x8 each) as packed pixels, red in the lowest byte.

    Args:
        cells: pointer to ``GAMMA_CELLS``.
    """
    red, green = _gamma_level(r, cells) >> vec.i32(16), _gamma_level(g, cells) >> vec.i32(8)
    return red | (green & vec.i32(0xFF00)) | (_gamma_level(b, cells) & vec.i32(0xFF0000))


@inlined
def byte_from_unit(c):
    """Return ``round(255 c)`` of an f32x8 as i32x8. Below 0 and NaN is 0, above 1 is 255."""
    return vec.to_i32(saturate(c) * vec.f32(255.0) + vec.f32(0.5))


@device_function
def decode_gamma(c, linear_from_gamma):
    """Return ``c^2.2`` of an f32x8 in 0 .. 1 (clamped; NaN is 0), to 1e-7.

    Args:
        linear_from_gamma: pointer to ``LINEAR_FROM_GAMMA``.
    """
    step = saturate(c) * vec.f32(float(_STEPS))
    cell = vec.to_i32(step)
    low, high = vec.gather(linear_from_gamma, cell), vec.gather(linear_from_gamma, cell + vec.i32(1))
    return low + (step - vec.to_f32(cell)) * (high - low)


@inlined
def encode_gamma(c, gamma_from_linear):
    """Return ``c^(1/2.2)`` of an f32x8 in 0 .. 1 (clamped; NaN is 0), to 2e-6.

    Args:
        gamma_from_linear: pointer to ``GAMMA_FROM_LINEAR``.
    """
    c = vec.minimum(vec.maximum(c, vec.f32(_DARK)), vec.f32(1.0))
    bits = vec.float_bits(c) - vec.i32(_DARK_BITS)
    cell = bits >> vec.i32(_CELL_BITS)
    low, high = vec.gather(gamma_from_linear, cell), vec.gather(gamma_from_linear, cell + vec.i32(1))
    t = vec.to_f32(bits & vec.i32(_CELL_SIZE - 1)) * vec.f32(1.0 / _CELL_SIZE)
    return low + t * (high - low)
