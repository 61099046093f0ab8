"""Semi-global matching of a rectified pair, with an error and a confidence for each match."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo.errors import DepthImages
from renderers.stop import check_stop

BLOCK: Final = 5
"""Side of the matching window, pixels."""
BASE_ERROR: Final = 0.2
"""Sub-pixel error of a match on good texture, pixels (measured against exact disparity)."""
NOISE_WEIGHT: Final = 1.5
"""Weight of image noise, in proportion to texture, in the error."""
MIN_SIGMA: Final = 0.3
"""Lower limit of the image noise, grey levels: images without noise still have rounding errors."""


def match_pair(left: NDArray[np.uint8], right: NDArray[np.uint8], disparities: int, sigma: float) -> DepthImages:
    """Return depth images by matching a pair.

    A pixel is valid if matching from left to right and from right to left agree.

    Args:
        left: (H, W) uint8, rectified: a point's row is the same in both images.
        right: (H, W) uint8.
        disparities: range of the search, pixels.
        sigma: standard deviation of the image noise, grey levels.
    """
    wait_until_compiled("stereo")
    check_stop()
    height, width = left.shape
    searched = -(-disparities // 16) * 16
    # OpenCV leaves the first `searched` columns invalid; a border of that width keeps all columns of the image.
    padded = [cv2.copyMakeBorder(i, 0, 0, searched, 0, cv2.BORDER_REPLICATE) for i in (left, right)]
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=searched,
        blockSize=BLOCK,
        P1=8 * BLOCK * BLOCK,
        P2=32 * BLOCK * BLOCK,
        disp12MaxDiff=1,
        preFilterCap=31,
        uniquenessRatio=5,
        speckleWindowSize=0,
        speckleRange=0,
        mode=cv2.StereoSGBM_MODE_SGBM,
    )
    raw = np.asarray(matcher.compute(padded[0], padded[1]), np.int16)[:, searched:]
    check_stop()  # OpenCV itself cannot be stopped: half a second for 1280 x 960 pixels
    disparity = np.zeros((height, width), np.uint16)
    error = np.zeros((height, width), np.uint8)
    confidence = np.zeros((height, width), np.uint8)
    _rate_matches(
        np.ascontiguousarray(raw), left, right, disparities, float(max(sigma, MIN_SIGMA)), BASE_ERROR, NOISE_WEIGHT,
        disparity, error, confidence,
    )  # fmt: skip
    return DepthImages(disparity, error, confidence)


@cached_njit(nogil=True)
def _rate_matches(raw, left, right, disparities, sigma, base, weight, disparity, error, confidence):
    """Write the valid disparities with their error and confidence, from windows of 5 x 5 pixels.

    The error follows from texture and noise. The confidence is low for windows without texture, and where the two
    windows differ by more than a small part of their texture.
    """
    height, width = raw.shape
    for k in range(height):
        for i in range(width):
            units = int(raw[k, i])
            # Zero and below: no match. Beyond the left edge of the right image: a match with the added border.
            if units <= 0 or units > disparities * 16 or i * 16 < units:
                continue
            d = units / 16.0
            total, squares, residual, count = 0.0, 0.0, 0.0, 0
            for dk in range(-2, 3):
                y = min(max(k + dk, 0), height - 1)
                for di in range(-2, 3):
                    x = min(max(i + di, 1), width - 2)
                    s = x - d
                    if s < 0.0 or s > width - 1.001:
                        continue
                    j = int(s)
                    share = s - j
                    other = right[y, j] * (1.0 - share) + right[y, j + 1] * share
                    here = float(left[y, x])
                    total += here
                    squares += here * here
                    residual += abs(other - here)
                    count += 1
            if count == 0:
                continue
            texture = np.sqrt(max(squares / count - (total / count) ** 2, 0.0))
            residual /= count
            e = np.sqrt(base * base + (weight * sigma / (texture + 0.25 * sigma)) ** 2 / count)
            disagreement = max(residual - sigma, 0.0) / (texture + 2.0 * sigma)
            support = texture * texture / (texture * texture + 1.5 * sigma * sigma)
            agreement = support * min(max(1.15 - 0.5 * disagreement, 0.0), 0.997)
            # Calibrated on rendered scenes with exact disparity, on the pessimistic side.
            doubt = 1.0 - agreement
            probability = max(1.0 - 2.0 * doubt - 8.0 * doubt * doubt, 0.0)
            disparity[k, i] = units
            error[k, i] = int(min(max(np.rint(e * 16.0), 1.0), 255.0))
            confidence[k, i] = int(probability * 255.0)
