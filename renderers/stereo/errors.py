"""Error model of ground-truth depth: measured disparity, error and confidence from the exact disparity.

The manual defines the disparity error d_eps as the standard deviation of the measured disparity, and the confidence as
the probability that the true disparity lies within +-3 d_eps of the measured one. Accordingly:

* Every pixel gets Gaussian noise of standard deviation d_eps.
* A pixel becomes an outlier (beyond 3 d_eps) with a probability that grows with the local slope of the disparity,
  because matching windows fail on slanted surfaces and edges. The manual has no figures for this; the slopes are our
  choice.
* The confidence is the exact probability of the event above for this noise and these outliers.
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
from renderers.stereo.noise import NORMAL_TABLE, random64

ERROR_TOLERANCE: Final = 0.05
"""Maximum relative difference between a pixel's error and the value in the error image."""


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """Parameters of the errors, in pixels of the disparity image."""

    sigma: float
    """Standard deviation of the measured disparity, rounding included; 0 disables noise and outliers."""
    error_scale: float = DISPARITY_SCALE
    """Pixels per unit of the error image; see ``error_scale``."""
    slope_half: float = 0.5
    """Disparity change between neighbouring pixels at which half of the measurements are outliers."""
    slope_free: float = 0.08
    """Largest disparity change between neighbouring pixels without outliers."""


@dataclass(frozen=True, slots=True, eq=False)
class DepthImages:
    """Disparity, error and confidence images of one frame."""

    disparity: NDArray[np.uint16]
    """(H, W) uint16, units of 1/16 pixel, 0: invalid."""
    error: NDArray[np.uint8]
    """(H, W) uint8, units of ``error_scale`` pixels, 0 where invalid."""
    confidence: NDArray[np.uint8]
    """(H, W) uint8, units of 1/255, 0 where invalid."""
    error_scale: float = DISPARITY_SCALE
    """Pixels per unit of ``error``: 1/16 divided by a power of two."""


def error_scale(sigma: float, disparities: int) -> float:
    """Return the pixels per unit of an error image.

    The result is the device's 1/16 if it represents ``sigma`` within ``ERROR_TOLERANCE``, else the first half, quarter,
    and so on that does. The disparity message has the same unit, so the range of disparities in 16 bits limits how fine
    it can be.

    Args:
        sigma: standard deviation of the disparity, pixels; 0: no noise.
        disparities: range of the disparities, pixels.
    """
    scale = DISPARITY_SCALE
    largest = disparities + 4.0 * sigma + 1.0  # noise and outliers included
    while abs(round(sigma / scale) * scale - sigma) > ERROR_TOLERANCE * sigma and largest / scale * 2 <= 65535:
        scale /= 2
    return scale


def add_errors(true: NDArray[np.float32], model: ErrorModel, key: np.uint64) -> DepthImages:
    """Return the depth images that a camera with these errors measures.

    Args:
        true: (H, W) float32, exact disparity in pixels, 0: not measurable.
        model: magnitude of the errors.
        key: random key of the frame (``noise.frame_key``).
    """
    # The smallest error that the image can represent is one unit, about as much as rounding to 1/16 pixel alone.
    wait_until_compiled("stereo")
    unit = min(max(round(model.sigma / model.error_scale), 1), 255)
    if model.sigma > 0.0:
        disparity, confidence = _with_noise(true, model, unit * model.error_scale, key)
    else:
        valid = true > 0.0
        disparity = np.where(valid, np.floor(np.clip(true * 16.0, 1.0, 65535.0) + 0.5), 0.0).astype(np.uint16)
        confidence = np.where(valid, np.uint8(255), np.uint8(0))
    error = np.where(disparity != 0, np.uint8(unit), np.uint8(0))
    return DepthImages(disparity, error, confidence, model.error_scale)


def _with_noise(
    true: NDArray[np.float32], model: ErrorModel, d_eps: float, key: np.uint64
) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Return disparity and confidence."""
    disparity = np.empty(true.shape, np.uint16)
    confidence = np.empty(true.shape, np.uint8)
    # Rounding to 1/16 pixel is uniform noise of variance 1/16^2 / 12; the Gaussian part makes up the rest of sigma.
    noise = max(model.sigma**2 - DISPARITY_SCALE**2 / 12.0, 1e-12) ** 0.5
    inside = _probability_within(3.0 * d_eps, noise)
    _add_noise(
        true, np.uint64(key), noise, d_eps, inside, model.slope_free, model.slope_half,
        NORMAL_TABLE, disparity, confidence,
    )  # fmt: skip
    return disparity, confidence


def _probability_within(limit: float, sigma: float) -> float:
    """Return P(|noise + rounding| <= limit) of a pixel that is no outlier; rounding is uniform over 1/16 pixel."""
    normal = NormalDist(0.0, sigma)
    half = DISPARITY_SCALE / 2
    offsets = (np.arange(64) + 0.5) / 64 * 2 * half - half
    return float(np.mean([normal.cdf(limit + o) - normal.cdf(-limit + o) for o in offsets]))


@cached_njit(nogil=True)
def _add_noise(true, key, sigma, d_eps, inside, slope_free, slope_half, normal, disparity, confidence):
    height, width = true.shape
    rise = np.float32(0.5 / (slope_half - slope_free))
    free = np.float32(slope_free)
    limit = np.float32(3.0 * d_eps)
    inside32 = np.float32(inside)
    table = normal * np.float32(sigma)
    outlier = np.empty(width, np.float32)  # the slope, then the probability of an outlier
    for k in range(height):
        row = true[k]
        _steepest(row, true[max(k - 1, 0)], true[min(k + 1, height - 1)], outlier)
        confidences = confidence[k]
        for i in range(width):
            probability = min(max((outlier[i] - free) * rise, np.float32(0.0)), np.float32(1.0))
            outlier[i] = probability
            # The confidence is rounded to a byte first; the outliers below follow the rounded value.
            level = np.floor((np.float32(1.0) - probability) * inside32 * np.float32(255.0))
            confidences[i] = np.uint8(np.int32(level)) if row[i] > np.float32(0.0) else np.uint8(0)
        values = disparity[k]
        random = np.uint64(0)
        for i in range(width):
            if i & 3 == 0:
                random = random64(key, k * width + i)
            d = row[i]
            value = 0
            if d > np.float32(0.0):
                e = table[random & np.uint64(4095)]
                if outlier[i] > np.float32(0.0):
                    r = random64(~key, k * width + i)
                    u = np.float32(r >> np.uint64(40)) * np.float32(2.0**-24)
                    if u * inside32 < inside32 - np.float32(confidences[i]) / np.float32(255.0):
                        # Beyond 3 d_eps even after rounding, and within the step that the segmentation allows.
                        v = np.float32((r >> np.uint64(13)) & np.uint64(1023)) * np.float32(1.0 / 1024.0)
                        e = limit + np.float32(0.07) + np.float32(0.75) * v
                        if (r >> np.uint64(12)) & np.uint64(1):
                            e = -e
                # Below one unit the disparity means "infinitely far", which the device encodes as 1.
                units = min(max((d + e) * np.float32(16.0), np.float32(1.0)), np.float32(65535.0))
                value = int(units + np.float32(0.5))
            values[i] = value
            random >>= np.uint64(16)


@njit
def _steepest(row, above, below, slope):
    """Write the largest step to a valid neighbour above, below, left and right, (W,) float32."""
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
