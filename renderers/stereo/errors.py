"""Error model of ground-truth depth: measured disparity, error and confidence from the exact disparity.

The manual defines the disparity error (its d_eps) as the standard deviation of the measured disparity, and the
confidence as the probability that the measured disparity is within 3 disparity errors of the true one. Accordingly:

* Every pixel gets Gaussian noise whose standard deviation is the disparity error.
* A pixel becomes an outlier (beyond 3 disparity errors) with a probability that grows with the local slope of the
  disparity, because matching windows fail on slanted surfaces and edges. The manual has no figures for this; the slopes
  are our choice.
* The confidence is the exact probability, for this noise and these outliers, that a pixel is within 3 disparity errors.
"""

from __future__ import annotations

from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo.depth_images import DepthImages
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.noise import NORMAL_TABLE, random64

ERROR_TOLERANCE: Final = 0.05
"""Maximum relative difference between a pixel's error and the value in the error image."""
OUTLIER_FREE_SLOPE: Final = 0.08
"""Disparity change between neighbouring pixels up to which no measurement is an outlier, pixels."""
HALF_OUTLIERS_SLOPE: Final = 0.5
"""Disparity change between neighbouring pixels at which half of the measurements are outliers, pixels."""
_OUTLIERS_PER_SLOPE: Final = np.float32(0.5 / (HALF_OUTLIERS_SLOPE - OUTLIER_FREE_SLOPE))
"""Increase of the outlier probability per pixel of slope."""


def choose_error_scale(sigma: float, disparity_count: int) -> float:
    """Return the pixels per unit of an error image.

    The device's unit is 1/16 pixel. The unit is halved until rounding to it changes ``sigma`` by at most
    ``ERROR_TOLERANCE``. The disparity message has the same unit and 16 bits, which limits the halving.

    Args:
        sigma: standard deviation of the disparity, pixels; 0: no noise.
        disparity_count: number of disparities that the camera measures, and therefore the largest one, pixels.
    """
    scale = DISPARITY_SCALE
    largest = disparity_count + 4.0 * sigma + 1.0  # noise and outliers included
    while abs(round(sigma / scale) * scale - sigma) > ERROR_TOLERANCE * sigma and largest / scale * 2 <= 65535:
        scale /= 2
    return scale


def add_errors(
    true_disparity: NDArray[np.float32], sigma: float, key: np.uint64, error_scale: float = DISPARITY_SCALE
) -> DepthImages:
    """Return the depth images that a camera measures with the errors of this model.

    Args:
        true_disparity: (H, W) float32, exact disparity in pixels, 0: not measurable.
        sigma: standard deviation of the measured disparity in pixels, rounding included; 0: no noise, no outliers.
        key: random key of the frame (``noise.frame_key``).
        error_scale: pixels per unit of the error image (``choose_error_scale``).
    """
    wait_until_compiled("stereo")
    # At least one unit: the error image holds 0 for invalid pixels.
    error_units = min(max(round(sigma / error_scale), 1), 255)
    if sigma > 0.0:
        disparity, confidence = _add_noise(true_disparity, sigma, error_units * error_scale, key)
    else:
        valid = true_disparity > 0.0
        units = np.floor(np.clip(true_disparity * 16.0, 1.0, 65535.0) + 0.5)
        disparity = np.where(valid, units, 0.0).astype(np.uint16)
        confidence = np.where(valid, np.uint8(255), np.uint8(0))
    error = np.where(disparity != 0, np.uint8(error_units), np.uint8(0))
    return DepthImages(disparity, error, confidence, error_scale)


def _add_noise(
    true_disparity: NDArray[np.float32], sigma: float, disparity_error: float, key: np.uint64
) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Return the disparity image with noise and outliers, and the confidence image.

    Args:
        true_disparity: (H, W) float32, pixels.
        sigma: standard deviation of the measured disparity, pixels.
        disparity_error: ``sigma`` as the error image represents it, pixels.
        key: random key of the frame.
    """
    disparity = np.empty(true_disparity.shape, np.uint16)
    confidence = np.empty(true_disparity.shape, np.uint8)
    # Rounding to 1/16 pixel is uniform noise of variance 1/16^2 / 12; the Gaussian part makes up the rest of sigma.
    gaussian_sigma = max(sigma**2 - DISPARITY_SCALE**2 / 12.0, 1e-12) ** 0.5
    inlier_confidence = _probability_within(3.0 * disparity_error, gaussian_sigma)
    _add_noise_and_outliers(
        true_disparity,
        np.uint64(key),
        gaussian_sigma,
        disparity_error,
        inlier_confidence,
        NORMAL_TABLE,
        disparity,
        confidence,
    )
    return disparity, confidence


def _probability_within(limit: float, gaussian_sigma: float) -> float:
    """Return P(|noise + rounding| <= limit) of a pixel that is no outlier; rounding is uniform over 1/16 pixel."""
    normal = NormalDist(0.0, gaussian_sigma)
    roundings = ((np.arange(64) + 0.5) / 64 - 0.5) * DISPARITY_SCALE
    return float(np.mean([normal.cdf(limit + rounding) - normal.cdf(-limit + rounding) for rounding in roundings]))


@kernel("void(float32[:,::1], uint64, float64, float64, float64, float32[::1], uint16[:,::1], uint8[:,::1])")
def _add_noise_and_outliers(
    true_disparity, key, gaussian_sigma, disparity_error, inlier_confidence, normal_table, disparity, confidence
):
    """Write the measured disparity, in units of 1/16 pixel, and the confidence, in units of 1/255.

    Args:
        true_disparity: (H, W) float32, pixels, 0: not measurable.
        key: random key of the frame.
        gaussian_sigma: standard deviation of the noise without rounding, pixels.
        disparity_error: the disparity error of the error image, pixels.
        inlier_confidence: confidence of a pixel that is certainly no outlier, 0 to 1.
        normal_table: ``noise.NORMAL_TABLE``.
        disparity: (H, W) uint16, output.
        confidence: (H, W) uint8, output.
    """
    height, width = true_disparity.shape
    zero, one = np.float32(0.0), np.float32(1.0)
    outlier_free_slope = np.float32(OUTLIER_FREE_SLOPE)
    error_limit = np.float32(3.0 * disparity_error)
    max_confidence = np.float32(inlier_confidence)
    gaussian_table = normal_table * np.float32(gaussian_sigma)
    slope = np.empty(width, np.float32)
    outlier_probability = np.empty(width, np.float32)
    for row in range(height):
        true_row = true_disparity[row]
        _steepest_slope(true_row, true_disparity[max(row - 1, 0)], true_disparity[min(row + 1, height - 1)], slope)
        confidence_row = confidence[row]
        for column in range(width):
            probability = min(max((slope[column] - outlier_free_slope) * _OUTLIERS_PER_SLOPE, zero), one)
            outlier_probability[column] = probability
            # Outliers are drawn below with the probability that this rounded confidence states.
            confidence_units = np.floor((one - probability) * max_confidence * np.float32(255.0))
            confidence_row[column] = np.uint8(np.int32(confidence_units)) if true_row[column] > zero else np.uint8(0)
        disparity_row = disparity[row]
        gaussian_bits = np.uint64(0)
        for column in range(width):
            if column & 3 == 0:
                gaussian_bits = random64(key, row * width + column)
            exact = true_row[column]
            measured_units = 0
            if exact > zero:
                deviation = gaussian_table[gaussian_bits & np.uint64(4095)]
                if outlier_probability[column] > zero:
                    outlier_bits = random64(~key, row * width + column)
                    uniform = np.float32(outlier_bits >> np.uint64(40)) * np.float32(2.0**-24)
                    if uniform * max_confidence < max_confidence - np.float32(confidence_row[column]) / np.float32(
                        255.0
                    ):
                        # 0.07 is more than rounding can undo. At the default error the sum is below
                        # ``filters.SEGMENT_STEP``, so outliers are not removed as separate segments.
                        excess = np.float32((outlier_bits >> np.uint64(13)) & np.uint64(1023)) * np.float32(1.0 / 1024)
                        deviation = error_limit + np.float32(0.07) + np.float32(0.75) * excess
                        if (outlier_bits >> np.uint64(12)) & np.uint64(1):
                            deviation = -deviation
                # Below one unit the disparity means "infinitely far", which the device encodes as 1.
                units = min(max((exact + deviation) * np.float32(16.0), one), np.float32(65535.0))
                measured_units = int(units + np.float32(0.5))
            disparity_row[column] = measured_units
            gaussian_bits >>= np.uint64(16)


@device_function
def _steepest_slope(row, row_above, row_below, slope):
    """Write the largest disparity difference of each pixel of a row to its four neighbours that are valid.

    Args:
        row: (W,) float32 disparities, pixels, 0: invalid.
        row_above: (W,) float32.
        row_below: (W,) float32.
        slope: (W,) float32, output, pixels.
    """
    zero = np.float32(0.0)
    width = len(row)
    for i in range(width):
        up = abs(row_above[i] - row[i]) if row_above[i] > zero else zero
        down = abs(row_below[i] - row[i]) if row_below[i] > zero else zero
        slope[i] = max(up, down)
    for i in range(width - 1):
        right = abs(row[i + 1] - row[i]) if row[i + 1] > zero else zero
        slope[i] = max(slope[i], right)
    for i in range(1, width):
        left = abs(row[i - 1] - row[i]) if row[i - 1] > zero else zero
        slope[i] = max(slope[i], left)
