"""What the device does to a disparity image after matching: minconf, depth range, maxdeptherr, seg and fill."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo.errors import Measured
from renderers.stereo.model import DISPARITY_SCALE

SEGMENT_STEP = 2.0
"""Pixels: neighbours whose disparities differ by more belong to different segments (the vendor's viewers and drivers
cut surfaces at 2 pixels)."""
FILL_SHARE = 0.05
"""At most this share of the pixels is filled; the smallest holes first (manual)."""
_LARGEST = 32767
"""Units, 2048 pixels: OpenCV's segmentation works on signed 16 bits."""
FILL_CONFIDENCE = 128
"""0.5, the confidence of filled pixels (manual)."""


@dataclass(frozen=True, slots=True)
class Filters:
    """The device's parameters of the same names, in its units."""

    minconf: float = 0.5
    seg: int = 200
    """Pixels of an image in High quality; smaller segments are removed."""
    fill: int = 3
    """Largest disparity step on the border of a hole that is filled, pixels; 0: nothing is filled."""
    maxdeptherr: float = 100.0
    """Metres; pixels with a larger depth error ``d_eps Z^2 / (f t)`` are removed."""
    mindepth: float = 0.1
    """Metres."""
    maxdepth: float = 100.0
    """Metres."""

    @property
    def fills(self) -> bool:
        """True if holes are filled; ``minconf`` holds for filled pixels as well."""
        return self.fill > 0 and self.least_confidence <= FILL_CONFIDENCE

    @property
    def least_confidence(self) -> int:
        """``minconf`` in units of a confidence image, 1/255."""
        return int(np.ceil(self.minconf * 255.0 - 1e-9))


def apply_filters(measured: Measured, filters: Filters, focal_times_baseline: float, divisor: int) -> None:
    """Removes and fills pixels in place, in the device's order: confidence and range, segments, holes.

    Args:
        measured: disparity, error and confidence; changed.
        filters: the limits.
        focal_times_baseline: f t in pixel metres of this resolution.
        divisor: of the quality, to convert ``seg``.
    """
    wait_until_compiled("stereo")
    unit, ft = DISPARITY_SCALE, focal_times_baseline
    lowest = max(int(np.ceil(ft / filters.maxdepth / unit - 1e-9)), 1)
    highest = min(int(np.floor(ft / filters.mindepth / unit + 1e-9)), _LARGEST)
    d, e, c = measured.disparity, measured.error, measured.confidence
    _remove(
        d, e, c, filters.least_confidence, lowest, highest, ft * measured.error_scale / unit**2, filters.maxdeptherr
    )
    smallest = round(filters.seg * 4 / divisor**2)
    if smallest > 1:
        _remove_segments(measured, smallest)
    if filters.fills:
        fill_holes(measured, filters.fill)


@cached_njit(nogil=True)
def _remove(disparity, error, confidence, minconf, lowest, highest, z_eps_factor, maxdeptherr):
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


def _remove_segments(measured: Measured, smallest: int) -> None:
    """Removes connected segments of fewer than ``smallest`` pixels."""
    cv2.filterSpeckles(measured.disparity.view(np.int16), 0, smallest - 1, round(SEGMENT_STEP / DISPARITY_SCALE))
    _forget(measured.disparity.reshape(-1), measured.error.reshape(-1), measured.confidence.reshape(-1))


@cached_njit(nogil=True)
def _forget(disparity, error, confidence):
    """No disparity: no error, no confidence."""
    for i in range(len(disparity)):
        valid = disparity[i] != 0
        error[i] = error[i] if valid else np.uint8(0)
        confidence[i] = confidence[i] if valid else np.uint8(0)


def fill_holes(measured: Measured, fill: int) -> None:
    """Fills holes whose border differs by at most ``fill`` pixels, the smallest first, up to ``FILL_SHARE``."""
    wait_until_compiled("stereo")
    step = round(fill / DISPARITY_SCALE)
    disparity = measured.disparity
    count, labels = cv2.connectedComponents((disparity == 0).view(np.uint8), connectivity=4, ltype=cv2.CV_32S)
    size = np.zeros(count, np.int32)
    low = np.full(count, 65536, np.int32)
    high = np.full(count, -1, np.int32)
    _measure_holes(disparity, labels, size, low, high)
    size[0] = 0
    fillable = (size > 0) & (high >= 0) & (high - low <= step)
    order = np.argsort(np.where(fillable, size, np.iinfo(np.int32).max), kind="stable")
    chosen = np.zeros(count, np.bool_)
    ordered = order[: int(fillable.sum())]
    chosen[ordered[np.cumsum(size[ordered]) <= FILL_SHARE * disparity.size]] = True
    _interpolate(disparity, measured.error, measured.confidence, labels, chosen, FILL_CONFIDENCE)


@cached_njit(nogil=True)
def _measure_holes(disparity, labels, size, low, high):
    """Size and border of every hole. A hole at the edge of the image has no border there: low is set below all."""
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
    """Along each row, linearly between the two ends of the hole."""
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
