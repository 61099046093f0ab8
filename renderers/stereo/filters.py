"""The device's post-processing of disparity images: minconf, depth range, maxdeptherr, seg and fill."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo.errors import DepthImages
from renderers.stereo.model import DISPARITY_SCALE

SEGMENT_STEP = 2.0
"""Maximum disparity step between neighbours of one segment, pixels (as in the vendor's viewers and drivers)."""
FILL_SHARE = 0.05
"""Maximum share of the pixels that are filled, the smallest holes first (manual)."""
_MAX_DISPARITY = 32767
"""Units of 1/16 pixel: OpenCV's segmentation takes signed 16 bits."""
FILL_CONFIDENCE = 128
"""0.5, the confidence of filled pixels (manual)."""


@dataclass(frozen=True, slots=True)
class Filters:
    """The device's parameters of the same names, in its units."""

    minconf: float = 0.5
    seg: int = 200
    """Minimum size of a segment, pixels of an image in High quality."""
    fill: int = 3
    """Maximum disparity step on the border of a hole that is filled, pixels; 0 disables filling."""
    maxdeptherr: float = 100.0
    """Maximum depth error ``d_eps Z^2 / (f t)``, metres."""
    mindepth: float = 0.1
    """Metres."""
    maxdepth: float = 100.0
    """Metres."""

    @property
    def fills(self) -> bool:
        """True if holes are filled. ``minconf`` applies to filled pixels, too."""
        return self.fill > 0 and self.min_confidence <= FILL_CONFIDENCE

    @property
    def min_confidence(self) -> int:
        """``minconf`` in units of a confidence image, 1/255."""
        return int(np.ceil(self.minconf * 255.0 - 1e-9))


def apply_filters(depth: DepthImages, filters: Filters, focal_times_baseline: float, divisor: int) -> None:
    """Remove and fill pixels in place, in the device's order: confidence and range, segments, holes.

    Args:
        depth: images to change.
        filters: limits.
        focal_times_baseline: f t at this resolution, pixels times metres.
        divisor: resolution divisor of the quality, which converts ``seg``.
    """
    wait_until_compiled("stereo")
    unit, ft = DISPARITY_SCALE, focal_times_baseline
    lowest = max(int(np.ceil(ft / filters.maxdepth / unit - 1e-9)), 1)
    highest = min(int(np.floor(ft / filters.mindepth / unit + 1e-9)), _MAX_DISPARITY)
    _apply_limits(
        depth.disparity, depth.error, depth.confidence, filters.min_confidence, lowest, highest,
        float(ft * depth.error_scale / unit**2), float(filters.maxdeptherr),
    )  # fmt: skip
    min_size = round(filters.seg * 4 / divisor**2)
    if min_size > 1:
        _remove_segments(depth, min_size)
    if filters.fills:
        fill_holes(depth, filters.fill)


@cached_njit(nogil=True)
def _apply_limits(disparity, error, confidence, minconf, lowest, highest, z_eps_factor, maxdeptherr):
    height, width = disparity.shape
    for k in range(height):
        for i in range(width):
            d = float(disparity[k, i])
            # z_eps = d_eps f t / d^2, with both in units
            if (
                confidence[k, i] < minconf
                or d < lowest
                or d > highest
                or float(error[k, i]) * z_eps_factor > maxdeptherr * d * d
            ):
                disparity[k, i] = 0
                error[k, i] = 0
                confidence[k, i] = 0


def _remove_segments(depth: DepthImages, min_size: int) -> None:
    """Remove connected segments of fewer than ``min_size`` pixels."""
    cv2.filterSpeckles(depth.disparity.view(np.int16), 0, min_size - 1, round(SEGMENT_STEP / DISPARITY_SCALE))
    valid = depth.disparity != 0
    np.multiply(depth.error, valid, out=depth.error)
    np.multiply(depth.confidence, valid, out=depth.confidence)


def fill_holes(depth: DepthImages, fill: int) -> None:
    """Fill holes whose border differs by at most ``fill`` pixels, the smallest first, up to ``FILL_SHARE``."""
    wait_until_compiled("stereo")
    max_step = round(fill / DISPARITY_SCALE)
    disparity = depth.disparity
    count, labels = cv2.connectedComponents((disparity == 0).view(np.uint8), connectivity=4, ltype=cv2.CV_32S)
    size = np.zeros(count, np.int32)
    low = np.full(count, 65536, np.int32)
    high = np.full(count, -1, np.int32)
    _measure_holes(disparity, labels, size, low, high)
    size[0] = 0
    fillable = (size > 0) & (high >= 0) & (high - low <= max_step)
    order = np.argsort(np.where(fillable, size, np.iinfo(np.int32).max), kind="stable")
    chosen = np.zeros(count, np.bool_)
    ordered = order[: int(fillable.sum())]
    chosen[ordered[np.cumsum(size[ordered]) <= FILL_SHARE * disparity.size]] = True
    _interpolate(disparity, depth.error, depth.confidence, labels, chosen, FILL_CONFIDENCE)


@cached_njit(nogil=True)
def _measure_holes(disparity, labels, size, low, high):
    """Write the size and the range of border disparities of every hole.

    A hole at the edge of the image has no border there: its ``low`` becomes so small that it is never filled.
    """
    height, width = disparity.shape
    for k in range(height):
        for i in range(width):
            hole = labels[k, i]
            if hole == 0:
                continue
            size[hole] += 1
            if k == 0 or i == 0 or k == height - 1 or i == width - 1:
                low[hole] = -1000000
                continue
            for d in (disparity[k - 1, i], disparity[k + 1, i], disparity[k, i - 1], disparity[k, i + 1]):
                if d != 0:
                    low[hole] = min(low[hole], d)
                    high[hole] = max(high[hole], d)


@cached_njit(nogil=True)
def _interpolate(disparity, error, confidence, labels, chosen, filled):
    """Fill the chosen holes along each row, linearly between the two ends of the hole."""
    height, width = disparity.shape
    for k in range(height):
        i = 1
        while i < width:
            if not chosen[labels[k, i]]:
                i += 1
                continue
            start = i
            while chosen[labels[k, i]]:
                i += 1
            first = float(disparity[k, start - 1])
            last = float(disparity[k, i])
            worst = max(error[k, start - 1], error[k, i])
            for j in range(start, i):
                share = (j - start + 1.0) / (i - start + 1.0)
                disparity[k, j] = int(first + (last - first) * share + 0.5)
                error[k, j] = worst
                confidence[k, j] = filled
