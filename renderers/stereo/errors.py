"""The device's error model: measured disparity, its error and its confidence from the exact disparity.

The manual: the disparity error d_eps is the standard deviation of the measured disparity, and the confidence is the
probability that the true disparity lies within +-3 d_eps of the measured one. So here:

* most pixels get Gaussian noise of sigma d_eps,
* a pixel is an outlier (beyond 3 d_eps) with a probability that grows with how fast disparity changes around it:
  slanted surfaces and edges are what makes matching windows fail,
* the confidence is the probability of the stated event under exactly this injection.

How the probability of outliers depends on the surface is our choice; the manual gives no figures for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.noise import KERNELS_VERSION, NORMAL_TABLE, random64

_VERSION = KERNELS_VERSION
ERROR_TOLERANCE: Final = 0.05
"""Largest relative difference between a pixel's error and what the error image says."""


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """Parameters of the injected errors, in pixels of the image they are applied to."""

    sigma: float
    """Standard deviation of the measured disparity, pixels, its rounding included; 0: no noise, no outliers, confidence
    1."""
    error_scale: float = DISPARITY_SCALE
    """Pixels per unit of the error image; see ``error_scale``."""
    slope_half: float = 0.5
    """Disparity change from pixel to pixel at which half of the measurements fail."""
    slope_free: float = 0.08
    """Up to this change nothing fails."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What the stereo camera gives."""

    disparity: NDArray[np.uint16]
    """(H, W) uint16, 1/16 pixel, 0: invalid."""
    error: NDArray[np.uint8]
    """(H, W) uint8, units of ``error_scale`` pixels, 0 where invalid."""
    confidence: NDArray[np.uint8]
    """(H, W) uint8, 1/255, 0 where invalid."""
    error_scale: float = DISPARITY_SCALE
    """Pixels per unit of ``error``: 1/16 divided by a power of two."""


def error_scale(sigma: float, disparities: int) -> float:
    """Return the pixels per unit of an error image: the device's 1/16 where it says ``sigma`` to ``ERROR_TOLERANCE``,
    else the first half, quarter, … that does.

    Disparities are sent in the same unit, so that it cannot be finer than their range in 16 bits allows.

    Args:
        sigma: standard deviation of the disparity, pixels; 0: no noise.
        disparities: range of the disparities, pixels.
    """
    scale = DISPARITY_SCALE
    largest = disparities + 4.0 * sigma + 1.0  # noise and outliers included
    while abs(round(sigma / scale) * scale - sigma) > ERROR_TOLERANCE * sigma and largest / scale * 2 <= 65535:
        scale /= 2
    return scale


def measure(true: NDArray[np.float32], model: ErrorModel, key: np.uint64) -> Measured:
    """Injects the errors.

    Args:
        true: (H, W) float32 exact disparity in pixels, 0: not measurable.
        model: how large the errors are.
        key: of this frame (``noise.frame_key``).
    """
    wait_until_compiled("stereo")
    disparity = np.empty(true.shape, np.uint16)
    confidence = np.empty(true.shape, np.uint8)
    # The error image cannot say less than one unit; rounding to 1/16 pixel alone is an error of that order.
    unit = min(max(round(model.sigma / model.error_scale), 1), 255)
    d_eps = unit * model.error_scale
    # Rounding adds a variance of its own (uniform over 1/16 pixel): together they are sigma.
    noise = max(model.sigma**2 - DISPARITY_SCALE**2 / 12.0, 1e-12) ** 0.5 if model.sigma > 0.0 else 0.0
    inside = _within_three(noise, d_eps)
    _measure(
        true, np.uint64(key), noise, d_eps, inside, model.slope_free, model.slope_half,
        NORMAL_TABLE, disparity, confidence,
    )  # fmt: skip
    error = np.where(disparity != 0, np.uint8(unit), np.uint8(0))
    return Measured(disparity, error, confidence, model.error_scale)


def _within_three(sigma: float, d_eps: float) -> float:
    """P(|noise + rounding| <= 3 d_eps) of a pixel that is no outlier; rounding is uniform over 1/16 pixel."""
    if sigma <= 0.0:
        return 1.0
    normal = NormalDist(0.0, sigma)
    half = DISPARITY_SCALE / 2
    offsets = (np.arange(64) + 0.5) / 64 * 2 * half - half
    return float(np.mean([normal.cdf(3 * d_eps + o) - normal.cdf(-3 * d_eps + o) for o in offsets]))


@cached_njit(nogil=True)
def _measure(true, key, sigma, d_eps, inside, slope_free, slope_half, normal, disparity, confidence):
    height, width = true.shape
    if not sigma > 0.0:
        for k in range(height):
            _round(true[k], disparity[k], confidence[k])
        return
    rise = np.float32(0.5 / (slope_half - slope_free))
    free = np.float32(slope_free)
    limit = np.float32(3.0 * d_eps)
    inside32 = np.float32(inside)
    table = normal * np.float32(sigma)
    slope = np.empty(width, np.float32)
    for k in range(height):
        row = true[k]
        _steepest(row, true[max(k - 1, 0)], true[min(k + 1, height - 1)], slope)
        beliefs = confidence[k]
        for i in range(width):
            fail = min(max((slope[i] - free) * rise, np.float32(0.0)), np.float32(1.0))
            slope[i] = fail
            # Confidence first, as the byte that is sent; the outliers are then injected to fit it.
            belief = np.floor((np.float32(1.0) - fail) * inside32 * np.float32(255.0))
            beliefs[i] = np.uint8(np.int32(belief)) if row[i] > np.float32(0.0) else np.uint8(0)
        values = disparity[k]
        random = np.uint64(0)
        for i in range(width):
            if i & 3 == 0:
                random = random64(key, k * width + i)
            d = row[i]
            value = 0
            if d > np.float32(0.0):
                e = table[random & np.uint64(4095)]
                if slope[i] > np.float32(0.0):
                    r = random64(~key, k * width + i)
                    u = np.float32(r >> np.uint64(40)) * np.float32(2.0**-24)
                    if u * inside32 < inside32 - np.float32(beliefs[i]) / np.float32(255.0):
                        # Beyond 3 d_eps even after rounding, and within the step that the segmentation allows.
                        v = np.float32((r >> np.uint64(13)) & np.uint64(1023)) * np.float32(1.0 / 1024.0)
                        e = limit + np.float32(0.07) + np.float32(0.75) * v
                        if (r >> np.uint64(12)) & np.uint64(1):
                            e = -e
                value = _units(d + e)
            values[i] = value
            random >>= np.uint64(16)


@njit(inline="always")
def _units(d):
    """A disparity in 1/16 pixel, to nearest; below one unit it says "infinitely far", which the device encodes as 1."""
    return np.int32(min(max(d * np.float32(16.0), np.float32(1.0)), np.float32(65535.0)) + np.float32(0.5))


@cached_njit(nogil=True)
def _round(row, values, beliefs):
    for i in range(len(row)):
        valid = row[i] > np.float32(0.0)
        values[i] = np.uint16(_units(row[i])) if valid else np.uint16(0)
        beliefs[i] = np.uint8(255) if valid else np.uint8(0)


@cached_njit(nogil=True)
def _steepest(row, above, below, slope):
    """(W,) float32: largest step to a valid neighbour above, below, left and right."""
    zero = np.float32(0.0)
    width = len(row)
    for i in range(width):
        d = row[i]
        up = abs(above[i] - d) if above[i] > zero else zero
        down = abs(below[i] - d) if below[i] > zero else zero
        slope[i] = max(up, down)
    for i in range(width - 1):
        step = abs(row[i + 1] - row[i]) if row[i + 1] > zero else zero
        slope[i] = max(slope[i], step)
    for i in range(1, width):
        step = abs(row[i - 1] - row[i]) if row[i - 1] > zero else zero
        slope[i] = max(slope[i], step)
