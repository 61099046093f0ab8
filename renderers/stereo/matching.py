"""Disparity by semi-global matching of a rectified pair, with an error and a confidence of each match."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo.errors import Measured
from renderers.stop import check_stop

BLOCK: Final = 5
"""Side of the matching window, pixels."""
BASE_ERROR: Final = 0.2
"""Pixels: sub-pixel error of a match on good texture (measured against exact disparity)."""
NOISE_WEIGHT: Final = 1.5
"""How much of the error comes from noise in proportion to texture."""


def match(left: NDArray[np.uint8], right: NDArray[np.uint8], disparities: int, sigma: float) -> Measured:
    """Matches a pair.

    Args:
        left, right: (H, W) uint8, rectified: a point's row is the same in both.
        disparities: how many disparities are searched, pixels.
        sigma: noise of the images, grey levels.

    Returns:
        Disparity where a match was found that is consistent from left to right and from right to left.
    """
    wait_until_compiled("stereo")
    check_stop()
    height, width = left.shape
    searched = -(-disparities // 16) * 16
    # OpenCV gives nothing for the first `searched` columns; with a border that large only what lies outside is lost.
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
    _judge(np.ascontiguousarray(raw), left, right, disparities, max(sigma, 0.3), BASE_ERROR, NOISE_WEIGHT,
           disparity, error, confidence)  # fmt: skip
    return Measured(disparity, error, confidence)


@cached_njit(nogil=True)
def _judge(raw, left, right, disparities, sigma, base, weight, disparity, error, confidence):
    """Error from texture and noise, confidence from how well the two windows agree, both over 5 x 5 pixels.

    A window without texture, or one whose difference is not small against its texture, says little about the match.
    """
    height, width = raw.shape
    for k in range(height):
        for i in range(width):
            units = int(raw[k, i])
            # Below zero: no match. Beyond the left edge of the right image: matched with the border that we added.
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
            # Calibrated on rendered scenes with exact disparity, so that it rather promises too little.
            doubt = 1.0 - agreement
            belief = max(1.0 - 2.0 * doubt - 8.0 * doubt * doubt, 0.0)
            disparity[k, i] = units
            error[k, i] = int(min(max(np.rint(e * 16.0), 1.0), 255.0))
            confidence[k, i] = int(belief * 255.0)
