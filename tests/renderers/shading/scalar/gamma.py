"""Gamma of the headlight looks, one value at a time."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from renderers.shading.gamma import THRESHOLDS

_STEPS = 4096


def _guesses(thresholds: np.ndarray) -> np.ndarray:
    """(_STEPS + 1,) uint8: the least level in every cell of width 1 / _STEPS of the square root."""
    # A float32 square root may round into the next cell: begin a little before it.
    ends = (np.arange(_STEPS + 1) / _STEPS) ** 2 * (1.0 - 1e-6)
    levels = np.searchsorted(thresholds, ends, side="right") - 1
    assert np.diff(levels).max() <= 1
    return levels.astype(np.uint8)


GUESSES = _guesses(THRESHOLDS)


@njit(nogil=True, error_model="numpy")
def gamma_byte(c, thresholds, guesses):
    """``round(255 c^(1/2.2))`` by comparison with exact thresholds: no ``pow``, so the same on every machine.

    Args:
        c: float32 linear value; below 0 or NaN is 0, above 1 is 1.
        thresholds, guesses: pointers to ``THRESHOLDS`` and ``GUESSES``.
    """
    if not (c > np.float32(0.0)):
        return np.uint8(0)
    if c >= np.float32(1.0):
        return np.uint8(255)
    level = np.int64(guesses[np.int64(math.sqrt(c) * np.float32(_STEPS))])
    if level < 255 and c >= thresholds[level + 1]:
        level += 1
    return np.uint8(level)


@njit(nogil=True, error_model="numpy")
def plain_byte(c):
    """``round(255 c)`` of a float32; below 0 or NaN is 0, above 1 is 255."""
    if not (c > np.float32(0.0)):
        return np.uint8(0)
    if c >= np.float32(1.0):
        return np.uint8(255)
    return np.uint8(c * np.float32(255.0) + np.float32(0.5))


@njit(nogil=True, error_model="numpy")
def decode_gamma(c, linear_from_gamma):
    """``c^2.2`` of a float32 in 0..1 (clamped; NaN is 0), within 1e-7, by a pointer to ``LINEAR_FROM_GAMMA``."""
    if not (c > np.float32(0.0)):
        return np.float32(0.0)
    step = min(c, np.float32(1.0)) * np.float32(_STEPS)
    cell = np.int64(step)
    low = linear_from_gamma[cell]
    return low + (step - np.float32(cell)) * (linear_from_gamma[cell + 1] - low)
