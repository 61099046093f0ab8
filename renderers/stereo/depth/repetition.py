"""Repeated texture: pixels whose window matches the right image at another disparity as well."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

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
    small_right = cv2.resize(right, (columns, rows), interpolation=cv2.INTER_AREA)
    half_pixels = [small_right, cv2.addWeighted(small_right, 0.5, np.roll(small_right, 1, axis=1), 0.5, 0.0)]
    exact = cv2.resize(disparity, (columns, rows), interpolation=cv2.INTER_NEAREST)
    exact_steps = exact * np.float32(HALF / SCALE)
    candidates = min(int(exact_steps.max() / HALF) + 2, columns) * HALF
    costs = np.full((candidates, rows, columns), 255, np.uint8)
    for candidate in range(candidates):
        whole, half = divmod(candidate, HALF)
        difference = cv2.absdiff(small_left[:, whole:], half_pixels[half][:, : columns - whole])
        is_same = cv2.inRange(exact_steps[:, whole:], candidate - MIN_DISTANCE * HALF, candidate + MIN_DISTANCE * HALF)
        cv2.max(cv2.blur(difference, (WINDOW, WINDOW)), is_same, dst=costs[candidate, :, whole:])
    contrast = cv2.blur(cv2.absdiff(small_left, cv2.blur(small_left, (WINDOW, 1))), (WINDOW, WINDOW))
    repeated = (costs.min(axis=0) <= MAX_COST * contrast) & (contrast >= MIN_CONTRAST) & (exact > 0.0)
    second = np.zeros((rows, columns), np.float32)
    second[repeated] = costs[:, repeated].argmin(axis=0) * (SCALE / HALF)
    return np.asarray(cv2.resize(second, (width, height), interpolation=cv2.INTER_NEAREST), np.float32)
