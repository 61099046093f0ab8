"""Depth images of one frame, as the rc_visard streams them, and exact ones from rendered depth.

Exact disparity is the best that any matcher could measure with this geometry.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F32, Array2, f32, i32

OCCLUSION_STEP: Final = 1.0
"""Disparity difference in pixels from which a nearer surface in the right image occludes a point: the tolerance of the
common left-right consistency check."""


@dataclass(frozen=True, slots=True, eq=False)
class DepthImages:
    """Disparity, error and confidence images of one frame."""

    disparity: NDArray[np.uint16]
    """(H, W) uint16, units of 1/16 pixel, 0: invalid."""
    error: NDArray[np.uint8]
    """(H, W) uint8, units of 1/16 pixel, 0 where invalid."""
    confidence: NDArray[np.uint8]
    """(H, W) uint8, units of 1/255, 0 where invalid."""


@dataclass(frozen=True, slots=True)
class DepthRange:
    """Range of depths that can be measured."""

    min_depth: float
    """Nearest depth, metres."""
    max_depth: float
    """Farthest depth, metres."""


def true_disparity(
    depth_left: NDArray[np.float32], depth_right: NDArray[np.float32], focal_times_baseline: float, limits: DepthRange
) -> NDArray[np.float32]:
    """Return the disparity of every pixel of the left image that both cameras see, (H, W) float32, pixels.

    It is ``focal_times_baseline / depth``; 0: background, out of range, occluded in the right image, or outside it
    (left edge of the field of view).
    """
    disparity = np.empty(depth_left.shape, np.float32)
    _true_disparity(depth_left, depth_right, focal_times_baseline, limits.min_depth, limits.max_depth, disparity)
    return disparity


@kernel
def _true_disparity(
    depth_left: Array2[np.float32],
    depth_right: Array2[np.float32],
    focal_times_baseline: F32,
    min_depth: F32,
    max_depth: F32,
    disparity: Array2[np.float32],
) -> None:
    """Write the disparity of every pixel to ``disparity``, (H, W); see ``true_disparity``."""
    height, width = depth_left.shape
    for row in range(height):
        for column in range(width):
            z = depth_left[row, column]
            pixels = f32(0.0)
            if min_depth <= z <= max_depth:
                pixels = focal_times_baseline / z
                x_right = f32(column) - pixels  # whole numbers are the centres of pixels
                if x_right < f32(-0.5):
                    pixels = f32(0.0)
                else:
                    left_column = max(int(np.floor(x_right)), 0)
                    # If one of the two pixels is background (+inf), nothing occludes the point.
                    farther = max(depth_right[row, left_column], depth_right[row, min(left_column + 1, width - 1)])
                    if focal_times_baseline / farther > pixels + f32(OCCLUSION_STEP):
                        pixels = f32(0.0)
            disparity[row, column] = pixels


def exact_images(true_disparity: NDArray[np.float32]) -> DepthImages:
    """Return depth images with rounding to 1/16 pixel as the only error: the error is 1 unit, the confidence 1."""
    disparity = sixteenths(true_disparity)
    valid = disparity > 0
    return DepthImages(disparity, valid.astype(np.uint8), np.where(valid, np.uint8(255), np.uint8(0)))


def sixteenths(disparity: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return disparities in units of 1/16 pixel, (H, W) uint16; 0 stays 0, and others are at least 1."""
    units = np.empty(disparity.shape, np.uint16)
    _write_sixteenths(disparity, units)
    return units


@kernel
def _write_sixteenths(disparity: Array2[np.float32], units: Array2[np.uint16]) -> None:
    """Write ``sixteenths``."""
    for row in range(disparity.shape[0]):
        for column in range(disparity.shape[1]):
            value = disparity[row, column] * f32(16.0) + f32(0.5)
            smallest = i32(disparity[row, column] > f32(0.0))
            units[row, column] = max(i32(min(value, f32(65535.0))), smallest)
