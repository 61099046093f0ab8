"""Tone curves, and sRGB encoding.

Khronos' "PBR Neutral" (specification 1.0, 2024): colours below 0.76 keep hue and saturation, brighter ones are
compressed towards white. "ACES": Stephen Hill's fit of the Academy's reference rendering and output
transforms (sRGB to AP1 with their saturation, one rational function, back), with the exposure of 1 / 0.6 that three.js,
Babylon.js and the Khronos sample viewer apply first. Or none.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.color import linear_values_from_srgb
from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.pointers import i32_at

TONES: Final = ("neutral", "aces", "none")
_ACES_EXPOSURE: Final = 1.0 / 0.6
_START: Final = 0.8 - 0.04
_DESATURATION: Final = 0.15
_LEAST: Final = np.float32(2.0**-13)
"""Smaller than the linear value of the lowest level above 0, 0.5 / 255 / 12.92."""
_LEAST_BITS: Final = int(_LEAST.view(np.int32))
_CELL: Final = 16
"""Low bits of a float32 within one cell of the table: 2^-7 of an octave, narrower than any level."""


@inlined
def _neutral(r, g, b):
    """Khronos' curve on linear colours. NaN becomes 0."""
    zero, one, start = vec.f32(0.0), vec.f32(1.0), vec.f32(_START)
    r, g, b = vec.maximum(r, zero), vec.maximum(g, zero), vec.maximum(b, zero)
    x = vec.minimum(r, vec.minimum(g, b))
    offset = vec.select(x < vec.f32(0.08), x - vec.f32(6.25) * x * x, vec.f32(0.04))
    r, g, b = r - offset, g - offset, b - offset
    peak = vec.maximum(r, vec.maximum(g, b))
    d = one - start
    new_peak = one - d * d / (peak + d - start)
    bright, white = peak >= start, peak >= vec.f32(1e30)
    w = one / (vec.f32(_DESATURATION) * (peak - new_peak) + one)
    scale = vec.select(bright, new_peak / peak * w, one)
    added = vec.select(bright, new_peak * (one - w), zero)
    return (
        vec.select(white, one, r * scale + added),
        vec.select(white, one, g * scale + added),
        vec.select(white, one, b * scale + added),
    )


@inlined
def _mixed(a, b, c, x, y, z):
    return vec.f32(a) * x + vec.f32(b) * y + vec.f32(c) * z


@inlined
def _aces_channel(v):
    above = v * (v + vec.f32(0.0245786)) - vec.f32(0.000090537)
    return above / (v * (vec.f32(0.983729) * v + vec.f32(0.4329510)) + vec.f32(0.238081))


@inlined
def _aces(r, g, b):
    """Hill's fit on linear colours. NaN becomes 0."""
    # Beyond 1e6 the curve is white to the last digit; squares of anything larger might not be finite.
    zero, bound, exposure = vec.f32(0.0), vec.f32(1e6), vec.f32(_ACES_EXPOSURE)
    r = vec.minimum(vec.maximum(r, zero), bound) * exposure
    g = vec.minimum(vec.maximum(g, zero), bound) * exposure
    b = vec.minimum(vec.maximum(b, zero), bound) * exposure
    x = _aces_channel(_mixed(0.59719, 0.35458, 0.04823, r, g, b))
    y = _aces_channel(_mixed(0.07600, 0.90834, 0.01566, r, g, b))
    z = _aces_channel(_mixed(0.02840, 0.13383, 0.83777, r, g, b))
    return _none(
        _mixed(1.60475, -0.53108, -0.07367, x, y, z),
        _mixed(-0.10208, 1.10813, -0.00605, x, y, z),
        _mixed(-0.00327, -0.07276, 1.07602, x, y, z),
    )


@inlined
def _none(r, g, b):
    zero, one = vec.f32(0.0), vec.f32(1.0)
    return (
        vec.minimum(vec.maximum(r, zero), one),
        vec.minimum(vec.maximum(g, zero), one),
        vec.minimum(vec.maximum(b, zero), one),
    )


@device_function
def shown(tone, r, g, b):
    """Apply the tone curve ``TONES[tone]`` to linear colours (f32x8 each)."""
    if tone == 0:
        return _neutral(r, g, b)
    if tone == 1:
        return _aces(r, g, b)
    return _none(r, g, b)


def _thresholds() -> NDArray[np.float32]:
    """Return (256,) float32: the least c for which ``round(255 srgb(c))`` is k; the first is 0."""
    shown = np.maximum(np.arange(256) - 0.5, 0.0) / 255.0
    single: NDArray[np.float32] = linear_values_from_srgb(shown).astype(np.float32)
    return single


def _cells(thresholds: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return (1665,) int32, one for each cell of 2^16 neighbouring float32 from _LEAST to 1.

    A cell holds the level of its first value times 2^16, plus the number of its values at or above the next threshold.
    """
    bits = np.arange(_LEAST_BITS, int(np.float32(1.0).view(np.int32)) + (1 << _CELL), 1 << _CELL, dtype=np.int32)
    levels = np.searchsorted(thresholds, bits.view(np.float32), side="right") - 1
    following = np.searchsorted(thresholds, (bits + (1 << _CELL)).view(np.float32), side="right") - 1
    assert (following - levels).max() <= 1
    next_bits = thresholds[np.minimum(levels + 1, 255)].view(np.int32)
    above = np.where(levels < 255, np.maximum(bits + (1 << _CELL) - next_bits, 0), 0)
    cells: NDArray[np.int32] = ((levels << _CELL) + above).astype(np.int32)
    return cells


SRGB_CELLS: Final = _cells(_thresholds())


@inlined
def srgb_byte(c, cells):
    """Return ``round(255 srgb(c))`` of an f32x8 as i32x8. Below 0 and NaN is 0, above 1 is 255.

    The table is exact for every float32. ``pow`` would differ between machines.

    Args:
        cells: address of ``SRGB_CELLS``.
    """
    c = vec.minimum(vec.maximum(c, vec.f32(_LEAST)), vec.f32(1.0))
    bits = vec.float_bits(c) - vec.i32(_LEAST_BITS)
    cell = vec.gather(i32_at(cells), bits >> vec.i32(_CELL))
    return (cell + (bits & vec.i32((1 << _CELL) - 1))) >> vec.i32(_CELL)
