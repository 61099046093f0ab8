"""Semi-global matching of a rectified pair, with an error and a confidence for each match."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo.depth_images import DepthImages
from renderers.stop import check_stop

WINDOW: Final = 5
"""Side of the matching window, pixels."""
BASE_ERROR: Final = 0.2
"""Sub-pixel error of a match on good texture, pixels (measured against exact disparity)."""
NOISE_WEIGHT: Final = 1.5
"""Weight of the ratio of image noise to texture in the error."""
MIN_NOISE_SIGMA: Final = 0.3
"""Minimum standard deviation of the image noise, grey levels: images without noise still have rounding errors."""


def match_pair(
    left: NDArray[np.uint8], right: NDArray[np.uint8], disparity_count: int, noise_sigma: float
) -> DepthImages:
    """Return depth images by matching a pair.

    A pixel is valid if the match from left to right and the match from right to left agree.

    Args:
        left: (H, W) uint8, rectified: a point's row is the same in both images.
        right: (H, W) uint8, likewise.
        disparity_count: number of disparities to search, pixels.
        noise_sigma: standard deviation of the image noise, grey levels.
    """
    wait_until_compiled("stereo")
    check_stop()
    searched_count = -(-disparity_count // 16) * 16
    # OpenCV leaves the first `searched_count` columns invalid. Padding of that width keeps all columns of the image.
    padded = [cv2.copyMakeBorder(image, 0, 0, searched_count, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=searched_count,
        blockSize=WINDOW,
        P1=8 * WINDOW * WINDOW,
        P2=32 * WINDOW * WINDOW,
        disp12MaxDiff=1,
        preFilterCap=31,
        uniquenessRatio=5,
        speckleWindowSize=0,
        speckleRange=0,
        mode=cv2.StereoSGBM_MODE_SGBM,
    )
    matches = np.asarray(matcher.compute(padded[0], padded[1]), np.int16)[:, searched_count:]
    check_stop()  # OpenCV itself cannot be stopped: half a second for 1280 x 960 pixels
    images = DepthImages(np.zeros_like(left, np.uint16), np.zeros_like(left), np.zeros_like(left))
    _rate_matches(
        np.ascontiguousarray(matches), left, right, disparity_count, float(max(noise_sigma, MIN_NOISE_SIGMA)),
        images.disparity, images.error, images.confidence,
    )  # fmt: skip
    return images


@kernel("void(int16[:,::1], uint8[:,::1], uint8[:,::1], int64, float64, uint16[:,::1], uint8[:,::1], uint8[:,::1])")
def _rate_matches(matches, left, right, disparity_count, noise_sigma, disparity, error, confidence):
    """Write the valid disparities with their error and confidence, from windows of 5 x 5 pixels.

    The error follows from texture and noise. The confidence is low if the window has no texture. It is also low if
    the left and right windows differ, beyond the noise, by more than about 30 % of their texture.

    Args:
        matches: (H, W) int16, OpenCV's disparities in units of 1/16 pixel.
        left: (H, W) uint8.
        right: (H, W) uint8.
        disparity_count: maximum disparity, pixels.
        noise_sigma: standard deviation of the image noise, grey levels.
        disparity: (H, W) uint16, output, initially 0.
        error: (H, W) uint8, output, initially 0.
        confidence: (H, W) uint8, output, initially 0.
    """
    height, width = matches.shape
    for row in range(height):
        for column in range(width):
            sixteenths = int(matches[row, column])
            # No match (0 or less), or a match with the padding beyond the left edge of the right image.
            if sixteenths <= 0 or sixteenths > disparity_count * 16 or column * 16 < sixteenths:
                continue
            pixels = sixteenths / 16.0
            level_sum, square_sum, difference_sum, count = 0.0, 0.0, 0.0, 0
            for window_row in range(row - 2, row + 3):
                y = min(max(window_row, 0), height - 1)
                for window_column in range(column - 2, column + 3):
                    x = min(max(window_column, 1), width - 2)
                    x_right = x - pixels
                    if x_right < 0.0 or x_right > width - 1.001:
                        continue
                    x_floor = int(x_right)
                    fraction = x_right - x_floor
                    right_level = right[y, x_floor] * (1.0 - fraction) + right[y, x_floor + 1] * fraction
                    left_level = float(left[y, x])
                    level_sum += left_level
                    square_sum += left_level * left_level
                    difference_sum += abs(right_level - left_level)
                    count += 1
            if count == 0:
                continue
            texture = np.sqrt(max(square_sum / count - (level_sum / count) ** 2, 0.0))
            difference = difference_sum / count
            noise_error = NOISE_WEIGHT * noise_sigma / (texture + 0.25 * noise_sigma)
            disparity_error = np.sqrt(BASE_ERROR * BASE_ERROR + noise_error**2 / count)
            disagreement = max(difference - noise_sigma, 0.0) / (texture + 2.0 * noise_sigma)
            texture_support = texture * texture / (texture * texture + 1.5 * noise_sigma * noise_sigma)
            agreement = texture_support * min(max(1.15 - 0.5 * disagreement, 0.0), 0.997)
            # Calibrated on rendered scenes with exact disparity; rather too low than too high.
            doubt = 1.0 - agreement
            probability = max(1.0 - 2.0 * doubt - 8.0 * doubt * doubt, 0.0)
            disparity[row, column] = sixteenths
            error[row, column] = int(min(max(np.rint(disparity_error * 16.0), 1.0), 255.0))
            confidence[row, column] = int(probability * 255.0)
