"""The device's post-processing of disparity images: minconf, depth range, maxdeptherr, seg and fill."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from renderers.compiler.jit import kernel
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.model import DISPARITY_SCALE

SEGMENT_STEP: Final = 2.0
"""Maximum disparity step between neighbours of one segment, pixels (as in the vendor's viewers and drivers)."""
FILL_SHARE: Final = 0.05
"""Maximum share of the pixels that are filled, the smallest holes first (manual)."""
FILL_CONFIDENCE: Final = 128
"""Confidence of filled pixels, units of 1/255: 0.5 (manual)."""
_MAX_UNITS: Final = 32767
"""Maximum disparity, units of 1/16 pixel: OpenCV's segmentation takes signed 16-bit numbers."""
_AT_IMAGE_EDGE: Final = -1_000_000
"""Stored as the lowest border disparity of holes at the edge of the image, which makes their range too large to be
filled."""


@dataclass(frozen=True, slots=True)
class Filters:
    """The device's parameters of the same names, in the device's units."""

    minconf: float = 0.5
    """Minimum confidence, 0 to 1."""
    seg: int = 200
    """Minimum size of a segment, pixels of an image in High quality."""
    fill: int = 3
    """Maximum disparity step on the border of a hole that is filled, pixels; 0 disables filling."""
    maxdeptherr: float = 100.0
    """Maximum depth error, metres: ``disparity_error Z^2 / (f t)`` with depth Z, focal length f and baseline t."""
    mindepth: float = 0.1
    """Minimum depth, metres."""
    maxdepth: float = 100.0
    """Maximum depth, metres."""

    @property
    def fills(self) -> bool:
        """True if holes are filled: filling is enabled, and ``minconf`` permits the confidence of filled pixels."""
        return self.fill > 0 and self.min_confidence <= FILL_CONFIDENCE

    @property
    def min_confidence(self) -> int:
        """``minconf`` in units of a confidence image, 1/255."""
        return int(np.ceil(self.minconf * 255.0 - 1e-9))


def apply_filters(depth: DepthImages, filters: Filters, focal_times_baseline: float, divisor: int) -> None:
    """Remove and fill pixels in place, in the device's order: confidence and range, segments, holes.

    Args:
        depth: images to change.
        filters: the device's parameters.
        focal_times_baseline: focal length at this resolution times baseline, pixels times metres.
        divisor: width of the camera images divided by that of these images; converts ``seg``.
    """
    unit = DISPARITY_SCALE
    min_units = max(int(np.ceil(focal_times_baseline / filters.maxdepth / unit - 1e-9)), 1)
    max_units = min(int(np.floor(focal_times_baseline / filters.mindepth / unit + 1e-9)), _MAX_UNITS)
    _apply_limits(
        depth.disparity, depth.error, depth.confidence, filters.min_confidence, min_units, max_units,
        float(focal_times_baseline * depth.error_scale / unit**2), float(filters.maxdeptherr),
    )  # fmt: skip
    min_size = round(filters.seg * 4 / divisor**2)
    if min_size > 1:
        _remove_segments(depth, min_size)
    if filters.fills:
        fill_holes(depth, filters.fill)


@kernel("void(uint16[:,::1], uint8[:,::1], uint8[:,::1], int64, int64, int64, float64, float64)")
def _apply_limits(
    disparity, error, confidence, min_confidence, min_disparity, max_disparity, depth_error_factor, max_depth_error
):
    """Remove pixels beyond the limits; disparities and their limits are in units of 1/16 pixel.

    The depth error in metres is ``depth_error_factor * error / disparity^2``, with error and disparity in the units of
    their images.
    """
    height, width = disparity.shape
    for row in range(height):
        for column in range(width):
            units = float(disparity[row, column])
            if (
                confidence[row, column] < min_confidence
                or units < min_disparity
                or units > max_disparity
                or float(error[row, column]) * depth_error_factor > max_depth_error * units * units
            ):
                disparity[row, column] = 0
                error[row, column] = 0
                confidence[row, column] = 0


def _remove_segments(depth: DepthImages, min_size: int) -> None:
    """Remove connected segments of fewer than ``min_size`` pixels."""
    cv2.filterSpeckles(depth.disparity.view(np.int16), 0, min_size - 1, round(SEGMENT_STEP / DISPARITY_SCALE))
    valid = depth.disparity != 0
    np.multiply(depth.error, valid, out=depth.error)
    np.multiply(depth.confidence, valid, out=depth.confidence)


def fill_holes(depth: DepthImages, max_step: int) -> None:
    """Fill holes in place, the smallest first, up to ``FILL_SHARE`` of the pixels.

    Args:
        depth: images to change.
        max_step: maximum difference of the disparities on a hole's border, pixels.
    """
    disparity = depth.disparity
    label_count, labels = cv2.connectedComponents((disparity == 0).view(np.uint8), connectivity=4, ltype=cv2.CV_32S)
    # Arrays by label: size of the hole, and lowest and highest disparity on its border. Valid pixels have label 0.
    size = np.zeros(label_count, np.int32)
    lowest = np.full(label_count, 65536, np.int32)
    highest = np.full(label_count, -1, np.int32)
    _measure_holes(disparity, labels, size, lowest, highest)
    fillable = (size > 0) & (highest >= 0) & (highest - lowest <= round(max_step / DISPARITY_SCALE))
    order = np.argsort(np.where(fillable, size, np.iinfo(np.int32).max), kind="stable")
    smallest_first = order[: int(fillable.sum())]
    is_filled = np.zeros(label_count, np.bool_)
    is_filled[smallest_first[np.cumsum(size[smallest_first]) <= FILL_SHARE * disparity.size]] = True
    _fill_rows(disparity, depth.error, depth.confidence, labels, is_filled)


@kernel("void(uint16[:,::1], int32[:,::1], int32[::1], int32[::1], int32[::1])")
def _measure_holes(disparity, labels, size, lowest, highest):
    """Write the size of every hole, pixels, and the range of the disparities on its border, units of 1/16 pixel.

    Args:
        disparity: (H, W) uint16, units of 1/16 pixel, 0: hole.
        labels: (H, W) int32, number of the pixel's hole; 0: valid pixel.
        size: (labels,) int32, output, initially 0.
        lowest: (labels,) int32, output, initially above all disparities.
        highest: (labels,) int32, output, initially -1.
    """
    height, width = disparity.shape
    for row in range(height):
        for column in range(width):
            hole = labels[row, column]
            if hole == 0:
                continue
            size[hole] += 1
            if row == 0 or column == 0 or row == height - 1 or column == width - 1:
                lowest[hole] = _AT_IMAGE_EDGE
                continue
            for neighbour in (
                disparity[row - 1, column],
                disparity[row + 1, column],
                disparity[row, column - 1],
                disparity[row, column + 1],
            ):
                if neighbour != 0:
                    lowest[hole] = min(lowest[hole], neighbour)
                    highest[hole] = max(highest[hole], neighbour)


@kernel("void(uint16[:,::1], uint8[:,::1], uint8[:,::1], int32[:,::1], boolean[::1])")
def _fill_rows(disparity, error, confidence, labels, is_filled):
    """Fill the holes with ``is_filled[label]`` row by row, linearly between the valid pixels left and right of them.

    Those pixels exist, because holes at the edge of the image are not filled.
    """
    height, width = disparity.shape
    for row in range(height):
        column = 1
        while column < width:
            if not is_filled[labels[row, column]]:
                column += 1
                continue
            start = column
            while is_filled[labels[row, column]]:
                column += 1
            left = float(disparity[row, start - 1])
            right = float(disparity[row, column])
            larger_error = max(error[row, start - 1], error[row, column])
            for hole_column in range(start, column):
                fraction = (hole_column - start + 1.0) / (column - start + 1.0)
                disparity[row, hole_column] = int(left + (right - left) * fraction + 0.5)
                error[row, hole_column] = larger_error
                confidence[row, hole_column] = FILL_CONFIDENCE
