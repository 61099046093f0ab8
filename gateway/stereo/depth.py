"""Depth images from rendered depth or from a pair of images, with the device's options for them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.stereo.auto_exposure import span
from gateway.stereo.config import StereoConfig
from gateway.stereo.settings import StreamSettings
from renderers.stereo.errors import ErrorModel, Measured, error_scale, measure
from renderers.stereo.exposure import Exposure
from renderers.stereo.filters import Filters, apply_filters, fill_holes
from renderers.stereo.matching import match
from renderers.stereo.noise import Stream, frame_key
from renderers.stereo.sensor import Taken
from renderers.stereo.truth import DepthRange, true_disparity


def measure_depth(
    config: StereoConfig,
    left: NDArray[np.float32],
    right: NDArray[np.float32],
    settings: StreamSettings,
    number: int,
) -> Measured:
    """Ground-truth depth with the injected errors. Double shot has nothing to fill: no reflection makes holes here.

    Args:
        left, right: (H, W) float32 depth from both cameras at the depth images' resolution, metres.
        settings: of the frame.
        number: of the frame.
    """
    divisor, filters = settings.quality.divisor, settings.filters
    ft = _focal_times_baseline(config, divisor)
    limits = DepthRange(config.model.nearest_depth(filters.mindepth, filters.maxdepth, divisor), filters.maxdepth)
    true = true_disparity(left, right, ft, limits)
    _cut(true, settings)
    sigma = config.d_eps / divisor / settings.averaged**0.5 if config.noise else 0.0
    scale = error_scale(sigma, config.model.disparity_range(divisor, filters.mindepth, filters.maxdepth))
    measured = measure(true, ErrorModel(sigma, scale), frame_key(config.seed, number, Stream.DISPARITY))
    if not config.noise:
        # Nothing to repair: every hole is one that the geometry makes.
        filters = Filters(0.0, 0, 0, filters.maxdeptherr, filters.mindepth, filters.maxdepth)
    apply_filters(measured, filters, ft, divisor)
    return measured


def match_depth(
    config: StereoConfig,
    left: Taken,
    right: Taken,
    exposure: Exposure,
    settings: StreamSettings,
    second: tuple[Taken, Taken, Exposure] | None,
) -> Measured:
    """Depth by matching two images.

    Args:
        exposure: of the images.
        settings: of the frame.
        second: for double shot, a pair without the projector's light; None: half the resolution of the first one.
    """
    divisor, filters = settings.quality.divisor, settings.filters
    ft = _focal_times_baseline(config, divisor)
    nearest = config.model.nearest_depth(filters.mindepth, filters.maxdepth, divisor)
    filters = replace(filters, mindepth=nearest)
    searched = config.model.disparity_range(divisor, filters.mindepth, filters.maxdepth)
    sigma = exposure.sigma(128.0) * config.noise_factor / settings.averaged**0.5
    first = _match_within(left.image, right.image, searched, sigma, settings)
    if not settings.double_shot:
        apply_filters(first, filters, ft, divisor)
        return first
    if second is not None:
        other_sigma = second[2].sigma(128.0) * config.noise_factor / settings.averaged**0.5
        other = _match_within(second[0].image, second[1].image, searched, other_sigma, settings)
    else:
        other = _match_halved(left.image, right.image, searched, sigma)
        _cut(other.disparity, settings)
    return _combine(first, other, filters, ft, divisor)


def _focal_times_baseline(config: StereoConfig, divisor: int) -> float:
    return config.model.intrinsics(divisor).focal_length * config.model.baseline


def _combine(first: Measured, second: Measured, filters: Filters, ft: float, divisor: int) -> Measured:
    """Both filtered, holes of the first filled from the second, and what remains as ``fill`` says."""
    for one in (first, second):
        apply_filters(one, replace(filters, fill=0), ft, divisor)
    holes = first.disparity == 0
    for mine, theirs in (
        (first.disparity, second.disparity), (first.error, second.error), (first.confidence, second.confidence)
    ):  # fmt: skip
        mine[holes] = theirs[holes]
    if filters.fills:
        fill_holes(first, filters.fill)
    return first


def _match_within(
    left: NDArray[np.uint8], right: NDArray[np.uint8], searched: int, sigma: float, settings: StreamSettings
) -> Measured:
    """Only the rows and columns of the depth region are matched, which takes less time."""
    region = settings.depth_region
    if region is None:
        return match(left, right, searched, sigma)
    height, width = left.shape
    divisor = settings.quality.divisor
    rows, columns = span(region[1], region[3], divisor), span(region[0], region[2], divisor)
    whole = Measured(np.zeros_like(left, np.uint16), np.zeros_like(left), np.zeros_like(left))
    if rows.start >= height or columns.start >= width:
        return whole
    # What lies at the region's left edge is found that much farther left in the right image.
    begin = max(columns.start - searched, 0)
    cut = np.s_[rows, begin : columns.stop]
    part = match(np.ascontiguousarray(left[cut]), np.ascontiguousarray(right[cut]), searched, sigma)
    for target, found in (
        (whole.disparity, part.disparity), (whole.error, part.error), (whole.confidence, part.confidence)
    ):  # fmt: skip
        target[rows, columns] = found[:, columns.start - begin :]
    return whole


def _match_halved(left: NDArray[np.uint8], right: NDArray[np.uint8], searched: int, sigma: float) -> Measured:
    """At half the resolution, where windows are twice as wide; enlarged again."""
    height, width = left.shape
    size = (-(-width // 2), -(-height // 2))
    small = [np.asarray(cv2.resize(i, size, interpolation=cv2.INTER_AREA), np.uint8) for i in (left, right)]
    found = match(small[0], small[1], -(-searched // 2), sigma / 2)

    def enlarged(values: NDArray[np.uint8] | NDArray[np.uint16], factor: int) -> NDArray[np.uint16]:
        large = np.repeat(np.repeat(values, 2, axis=0), 2, axis=1)[:height, :width]
        return np.ascontiguousarray(large.astype(np.uint16) * factor)

    error = np.minimum(enlarged(found.error, 2), 255).astype(np.uint8)
    return Measured(enlarged(found.disparity, 2), error, enlarged(found.confidence, 1).astype(np.uint8))


def _cut(values: NDArray[np.float32] | NDArray[np.uint16], settings: StreamSettings) -> None:
    """Nothing outside the depth region."""
    region = settings.depth_region
    if region is None:
        return
    divisor = settings.quality.divisor
    rows, columns = span(region[1], region[3], divisor), span(region[0], region[2], divisor)
    outside = np.ones(values.shape, np.bool_)
    outside[rows, columns] = False
    values[outside] = 0
