"""Depth images of a frame, from rendered depth or by matching, with the device's parameters.

One function per depth mode: ``ground_truth_depth`` and ``matched_depth``.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.stereo.config import StereoConfig
from gateway.stereo.settings import StreamSettings
from renderers.stereo.errors import DepthImages, ErrorModel, add_errors, error_scale
from renderers.stereo.exposure import Exposure
from renderers.stereo.filters import Filters, apply_filters, fill_holes
from renderers.stereo.matching import match_pair
from renderers.stereo.noise import NoiseStream, frame_key
from renderers.stereo.sensor import SensorImage
from renderers.stereo.truth import DepthRange, true_disparity


def ground_truth_depth(
    config: StereoConfig,
    left: NDArray[np.float32],
    right: NDArray[np.float32],
    settings: StreamSettings,
    number: int,
) -> DepthImages:
    """Return depth images from rendered depth, with modelled errors.

    ``double_shot`` has no effect, because there are no reflections that make holes.

    Args:
        config: model, noise and seed.
        left: (H, W) float32 depth from the left camera at the depth images' resolution, metres.
        right: (H, W) float32 depth from the right camera.
        settings: parameters of the frame.
        number: frame number.
    """
    divisor, filters = settings.quality.divisor, settings.filters
    ft = _focal_times_baseline(config, divisor)
    limits = DepthRange(config.model.nearest_depth(filters.mindepth, filters.maxdepth, divisor), filters.maxdepth)
    true = true_disparity(left, right, ft, limits)
    _clear_outside_region(true, settings)
    sigma = config.d_eps / divisor / settings.averaged**0.5 if config.noise else 0.0
    scale = error_scale(sigma, config.model.disparity_range(divisor, filters.mindepth, filters.maxdepth))
    images = add_errors(true, ErrorModel(sigma, scale), frame_key(config.seed, number, NoiseStream.DISPARITY))
    if not config.noise:
        # Every hole is one of the geometry, so segments and holes stay as they are.
        filters = Filters(0.0, 0, 0, filters.maxdeptherr, filters.mindepth, filters.maxdepth)
    apply_filters(images, filters, ft, divisor)
    return images


def matched_depth(
    config: StereoConfig,
    left: SensorImage,
    right: SensorImage,
    exposure: Exposure,
    settings: StreamSettings,
    second: tuple[SensorImage, SensorImage, Exposure] | None,
) -> DepthImages:
    """Return depth images by matching two images.

    Args:
        config: model and noise.
        left: image at the depth images' resolution.
        right: image at the depth images' resolution.
        exposure: exposure of the images, which determines their noise.
        settings: parameters of the frame.
        second: pair without the projector's light, for ``double_shot``; None: the first pair at half the resolution.
    """
    divisor, filters = settings.quality.divisor, settings.filters
    ft = _focal_times_baseline(config, divisor)
    nearest = config.model.nearest_depth(filters.mindepth, filters.maxdepth, divisor)
    filters = replace(filters, mindepth=nearest)
    disparities = config.model.disparity_range(divisor, filters.mindepth, filters.maxdepth)
    sigma = exposure.sigma(128.0) * config.noise_factor / settings.averaged**0.5
    first = _match_region(left.image, right.image, disparities, sigma, settings)
    if not settings.double_shot:
        apply_filters(first, filters, ft, divisor)
        return first
    if second is not None:
        other_sigma = second[2].sigma(128.0) * config.noise_factor / settings.averaged**0.5
        other = _match_region(second[0].image, second[1].image, disparities, other_sigma, settings)
    else:
        other = _match_half_resolution(left.image, right.image, disparities, sigma)
        _clear_outside_region(other.disparity, settings)
    return _combine(first, other, filters, ft, divisor)


def _focal_times_baseline(config: StereoConfig, divisor: int) -> float:
    return config.model.intrinsics(divisor).focal_length * config.model.baseline


def _combine(first: DepthImages, second: DepthImages, filters: Filters, ft: float, divisor: int) -> DepthImages:
    """Filter both, fill holes of the first from the second, then fill the remaining holes."""
    for images in (first, second):
        apply_filters(images, replace(filters, fill=0), ft, divisor)
    holes = first.disparity == 0
    np.copyto(first.disparity, second.disparity, where=holes)
    np.copyto(first.error, second.error, where=holes)
    np.copyto(first.confidence, second.confidence, where=holes)
    if filters.fills:
        fill_holes(first, filters.fill)
    return first


def _match_region(
    left: NDArray[np.uint8], right: NDArray[np.uint8], disparities: int, sigma: float, settings: StreamSettings
) -> DepthImages:
    """Match the rows and columns of the depth region only, to save time."""
    region = settings.depth_region
    if region is None:
        return match_pair(left, right, disparities, sigma)
    height, width = left.shape
    rows, columns = region.slices(settings.quality.divisor)
    whole = DepthImages(np.zeros_like(left, np.uint16), np.zeros_like(left), np.zeros_like(left))
    if rows.start >= height or columns.start >= width:
        return whole
    # Points at the region's left edge lie up to `disparities` columns farther left in the right image.
    begin = max(columns.start - disparities, 0)
    cut = np.s_[rows, begin : columns.stop]
    part = match_pair(np.ascontiguousarray(left[cut]), np.ascontiguousarray(right[cut]), disparities, sigma)
    found = np.s_[:, columns.start - begin :]
    whole.disparity[rows, columns] = part.disparity[found]
    whole.error[rows, columns] = part.error[found]
    whole.confidence[rows, columns] = part.confidence[found]
    return whole


def _match_half_resolution(
    left: NDArray[np.uint8], right: NDArray[np.uint8], disparities: int, sigma: float
) -> DepthImages:
    """Match at half the resolution, where windows cover four times the area, and enlarge the result."""
    height, width = left.shape
    size = (-(-width // 2), -(-height // 2))
    small = [np.asarray(cv2.resize(i, size, interpolation=cv2.INTER_AREA), np.uint8) for i in (left, right)]
    found = match_pair(small[0], small[1], -(-disparities // 2), sigma / 2)

    def enlarged(values: NDArray[np.uint8] | NDArray[np.uint16], factor: int) -> NDArray[np.uint16]:
        large = np.repeat(np.repeat(values, 2, axis=0), 2, axis=1)[:height, :width]
        return np.ascontiguousarray(large.astype(np.uint16) * factor)

    error = np.minimum(enlarged(found.error, 2), 255).astype(np.uint8)
    return DepthImages(enlarged(found.disparity, 2), error, enlarged(found.confidence, 1).astype(np.uint8))


def _clear_outside_region(disparity: NDArray[np.float32] | NDArray[np.uint16], settings: StreamSettings) -> None:
    """Set disparities outside the depth region to 0."""
    if settings.depth_region is not None:
        outside = np.ones(disparity.shape, np.bool_)
        outside[settings.depth_region.slices(settings.quality.divisor)] = False
        disparity[outside] = 0
