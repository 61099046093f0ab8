"""From scene light to what a display shows.

Tone curves: Khronos' "PBR Neutral" (specification 1.0, 2024): colours below 0.76 keep hue and saturation, what is
brighter is compressed towards white. "ACES": Stephen Hill's fit of the Academy's reference rendering and output
transforms (sRGB to AP1 with their saturation, one rational function, back), with the exposure of 1 / 0.6 that three.js,
Babylon.js and the Khronos sample viewer put before it. Or none.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

TONES: Final = ("neutral", "aces", "none")
_ACES_EXPOSURE: Final = 1.0 / 0.6
_START: Final = 0.8 - 0.04
_DESATURATION: Final = 0.15
_STEPS: Final = 4096


@njit(nogil=True, error_model="numpy")
def neutral(r, g, b):  # type: ignore[no-untyped-def]
    """The tone curve on one linear colour >= 0; not a number becomes 0."""
    r, g, b = (max(0.0, r)), (max(0.0, g)), (max(0.0, b))
    x = min(r, min(g, b))
    offset = x - 6.25 * x * x if x < 0.08 else 0.04
    r, g, b = r - offset, g - offset, b - offset
    peak = max(r, max(g, b))
    if peak < _START:
        return r, g, b
    d = 1.0 - _START
    new_peak = 1.0 - d * d / (peak + d - _START)
    scale = new_peak / peak if peak < 1e30 else 0.0
    w = 1.0 / (_DESATURATION * (peak - new_peak) + 1.0)
    if peak >= 1e30:
        return 1.0, 1.0, 1.0
    white = new_peak * (1.0 - w)
    return r * scale * w + white, g * scale * w + white, b * scale * w + white


@njit(nogil=True, error_model="numpy")
def _aces_channel(v):  # type: ignore[no-untyped-def]
    return (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)


@njit(nogil=True, error_model="numpy")
def aces(r, g, b):  # type: ignore[no-untyped-def]
    """Hill's fit on one linear colour; not a number becomes 0."""
    # Beyond 1e6 the curve is white to the last digit; squares of anything larger might not be finite.
    r = min(max(0.0, r), 1e6) * _ACES_EXPOSURE
    g = min(max(0.0, g), 1e6) * _ACES_EXPOSURE
    b = min(max(0.0, b), 1e6) * _ACES_EXPOSURE
    x = _aces_channel(0.59719 * r + 0.35458 * g + 0.04823 * b)
    y = _aces_channel(0.07600 * r + 0.90834 * g + 0.01566 * b)
    z = _aces_channel(0.02840 * r + 0.13383 * g + 0.83777 * b)
    return (
        min(max(1.60475 * x - 0.53108 * y - 0.07367 * z, 0.0), 1.0),
        min(max(-0.10208 * x + 1.10813 * y - 0.00605 * z, 0.0), 1.0),
        min(max(-0.00327 * x - 0.07276 * y + 1.07602 * z, 0.0), 1.0),
    )


@njit(nogil=True, error_model="numpy")
def shown(tone, r, g, b):  # type: ignore[no-untyped-def]
    """One linear colour through the curve with a number of ``TONES``."""
    if tone == 0:
        return neutral(r, g, b)
    if tone == 1:
        return aces(r, g, b)
    return min(max(0.0, r), 1.0), min(max(0.0, g), 1.0), min(max(0.0, b), 1.0)


def _thresholds() -> NDArray[np.float32]:
    """(256,) float32: from ``thresholds[k]`` on, ``round(255 srgb(c))`` is at least k; the first is 0."""
    shown = np.maximum(np.arange(256) - 0.5, 0.0) / 255.0
    linear = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    single: NDArray[np.float32] = linear.astype(np.float32)
    return single


def _guesses(thresholds: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(_STEPS + 1,) uint8: the least level in every cell of width 1 / _STEPS of the square root."""
    ends = (np.arange(_STEPS + 1) / _STEPS) ** 2 * (1.0 - 1e-6)
    levels = np.searchsorted(thresholds, ends, side="right") - 1
    assert np.diff(levels).max() <= 1
    return levels.astype(np.uint8)


SRGB_THRESHOLDS: Final = _thresholds()
SRGB_GUESSES: Final = _guesses(SRGB_THRESHOLDS)


@njit(nogil=True, error_model="numpy")
def srgb_byte(c, thresholds, guesses):  # type: ignore[no-untyped-def]
    """``round(255 srgb(c))`` by comparison with exact thresholds: no ``pow``, so the same on every machine."""
    if not (c > 0.0):
        return np.uint8(0)
    if c >= 1.0:
        return np.uint8(255)
    c = np.float32(c)
    level = np.int64(guesses[np.int64(math.sqrt(c) * np.float32(_STEPS))])
    if level < 255 and c >= thresholds[level + 1]:
        level += 1
    return np.uint8(level)
