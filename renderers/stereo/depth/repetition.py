"""Repeated texture: pixels whose window matches the right image at another disparity as well."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel

SCALE: Final = 4
"""Images are compared at 1/4 of their resolution: finer patterns than 8 pixels do not count."""
HALF: Final = 2
"""Candidate disparities have steps of 1/2 pixel at that resolution."""
WINDOW: Final = 5
"""Side of a window, pixels at that resolution."""
MIN_DISTANCE: Final = 3.0
"""Minimum difference of a second match from the exact disparity, pixels at that resolution."""
MAX_COST: Final = 0.4
"""Maximum difference of the windows of a second match, relative to the contrast of the window. Random textures reach
0.7, a chequerboard 0.1 to 0.3."""
MIN_CONTRAST: Final = 4.0
"""Minimum contrast of a window along its rows, grey levels: without contrast, nothing is repeated."""
_CANDIDATE_BITS: Final = 12
"""Bits of a candidate's number. A match is stored as the sum of its differences above these bits."""


def second_match(
    left: NDArray[np.uint8], right: NDArray[np.uint8], disparity: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the second disparity at which a window matches, up to the largest one of the image.

    Args:
        left: (H, W) uint8, rectified.
        right: (H, W) uint8, rectified.
        disparity: (H, W) float32, exact disparity, pixels, 0: unknown.

    Returns:
        (H, W) float32, pixels, 0: the texture is not repeated.
    """
    height, width = left.shape
    rows, columns = max(height // SCALE, 1), max(width // SCALE, 1)
    small_left = cv2.resize(left, (columns, rows), interpolation=cv2.INTER_AREA)
    contrast = cv2.blur(cv2.absdiff(small_left, cv2.blur(small_left, (WINDOW, 1))), (WINDOW, WINDOW))
    if not (contrast >= MIN_CONTRAST).any():
        return np.zeros((height, width), np.float32)
    small_right = cv2.resize(right, (columns, rows), interpolation=cv2.INTER_AREA)
    half_pixels = cv2.addWeighted(small_right, 0.5, np.roll(small_right, 1, axis=1), 0.5, 0.0)
    border = WINDOW // 2
    images = np.pad((small_left, small_right, half_pixels), ((0, 0), (border, border), (border, border)), "edge")
    exact = cv2.resize(disparity, (columns, rows), interpolation=cv2.INTER_NEAREST) * np.float32(HALF / SCALE)
    candidates = min(min(int(exact.max() / HALF) + 2, columns) * HALF, 1 << _CANDIDATE_BITS)
    best = np.full((rows, columns), np.iinfo(np.int32).max, np.int32)
    _find_second(images, np.rint(exact).astype(np.int32), candidates, best)
    sums, steps = best >> _CANDIDATE_BITS, best & ((1 << _CANDIDATE_BITS) - 1)
    is_repeated = (sums <= contrast * np.float32(MAX_COST * WINDOW**2)) & (contrast >= MIN_CONTRAST) & (exact > 0.0)
    second = (is_repeated * steps).astype(np.float32) * np.float32(SCALE / HALF)
    return np.asarray(cv2.resize(second, (width, height), interpolation=cv2.INTER_NEAREST), np.float32)


@kernel("void(uint8[:,:,::1], int32[:,::1], int64, int32[:,::1])")
def _find_second(images, exact, candidates, best):
    """Write the candidate whose windows differ least, of those that are not near the exact disparity.

    Args:
        images: (3, h + ``WINDOW`` - 1, w + ``WINDOW`` - 1) uint8: left, right, and right moved by half a pixel, with
            a border of half a window.
        exact: (h, w) int32, exact disparity, candidate steps.
        candidates: number of candidates.
        best: (h, w) int32, output, sum of differences and candidate (``_CANDIDATE_BITS``), initially the largest
            number.
    """
    for candidate in range(candidates):
        whole = candidate // HALF
        left, right = images[0, :, whole:], images[1 + candidate % HALF]
        column_sums = np.zeros(left.shape[1], np.int32)  # differences of a window's rows
        for row in range(WINDOW - 1):
            _add_differences(column_sums, left[row], right[row], np.int32(1))
        for row in range(len(exact)):
            _add_differences(column_sums, left[row + WINDOW - 1], right[row + WINDOW - 1], np.int32(1))
            _keep_smallest(column_sums, exact[row, whole:], np.int32(candidate), best[row, whole:])
            _add_differences(column_sums, left[row], right[row], np.int32(-1))


@inlined
def _keep_smallest(column_sums, exact, candidate, best):
    """Write the matches of a candidate that are better than those before; arguments are those of one row."""
    for column in range(len(exact)):
        total = np.int32(0)
        for x in range(WINDOW):
            total += column_sums[column + x]
        match = (total << np.int32(_CANDIDATE_BITS)) + candidate
        is_far = abs(exact[column] - candidate) > np.int32(MIN_DISTANCE * HALF)
        best[column] = min(best[column], match) if is_far else best[column]


@inlined
def _add_differences(column_sums, left, right, sign):
    """Add or subtract the differences of two rows; ``sign``: 1 or -1."""
    for x in range(len(column_sums)):
        column_sums[x] += sign * abs(np.int32(left[x]) - np.int32(right[x]))
