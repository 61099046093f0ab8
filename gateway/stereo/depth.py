"""Depth images of a frame, from rendered depth or by matching, with the device's parameters.

One function per depth mode: ``ground_truth_depth`` and ``matched_depth``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.stereo.config import StereoConfig
from gateway.stereo.settings import StreamSettings
from renderers.stereo.depth_images import DepthImages
from renderers.stereo.errors import add_errors, choose_error_scale
from renderers.stereo.exposure import Exposure
from renderers.stereo.filters import apply_filters, fill_holes
from renderers.stereo.matching import match_pair
from renderers.stereo.model import StereoModel
from renderers.stereo.noise import NoiseStream, frame_key
from renderers.stereo.sensor import SensorImage
from renderers.stereo.truth import DepthRange, true_disparity


@dataclass(frozen=True, slots=True, eq=False)
class MatcherPair:
    """Grey images to match, at the depth images' resolution."""

    left: SensorImage
    right: SensorImage
    exposure: Exposure
    """Exposure of both images, which determines their noise."""


def measurable_depths(model: StereoModel, settings: StreamSettings) -> DepthRange:
    """Return the range of depths that the camera can measure with these parameters."""
    filters = settings.filters
    nearest = model.nearest_depth(filters.mindepth, filters.maxdepth, settings.quality.divisor)
    return DepthRange(nearest, filters.maxdepth)


def ground_truth_depth(
    config: StereoConfig,
    left_depth: NDArray[np.float32],
    right_depth: NDArray[np.float32],
    settings: StreamSettings,
    frame_number: int,
) -> DepthImages:
    """Return depth images from rendered depth, with modelled errors.

    ``double_shot`` has no effect: it fills holes where matching fails, which rendered depth does not have.

    Args:
        config: model, noise and seed.
        left_depth: (H, W) float32 depth from the left camera at the depth images' resolution, metres.
        right_depth: (H, W) float32 depth from the right camera.
        settings: parameters of the frame.
        frame_number: selects the random numbers.
    """
    model, divisor, filters = config.model, settings.quality.divisor, settings.filters
    focal_times_baseline = model.focal_times_baseline(divisor)
    disparity = true_disparity(left_depth, right_depth, focal_times_baseline, measurable_depths(model, settings))
    _clear_outside_region(disparity, settings)
    sigma = config.disparity_error / divisor / settings.averaged_images**0.5 if config.noise else 0.0
    error_scale = choose_error_scale(sigma, model.disparity_count(divisor, filters.mindepth, filters.maxdepth))
    key = frame_key(config.seed, frame_number, NoiseStream.DISPARITY)
    images = add_errors(disparity, sigma, key, error_scale)
    if not config.noise:
        # Without noise all holes and segments are true, so they are kept.
        filters = replace(filters, minconf=0.0, seg=0, fill=0)
    apply_filters(images, filters, focal_times_baseline, divisor)
    return images


def matched_depth(
    config: StereoConfig, pair: MatcherPair, settings: StreamSettings, dark_pair: MatcherPair | None
) -> DepthImages:
    """Return depth images by matching two images.

    Args:
        config: model and noise.
        pair: images to match.
        settings: parameters of the frame.
        dark_pair: images without the projector's light for ``double_shot``; None: ``double_shot`` matches ``pair`` a
            second time, at half the resolution.
    """
    model, divisor = config.model, settings.quality.divisor
    nearest = measurable_depths(model, settings).min_depth
    filters = replace(settings.filters, mindepth=nearest)
    disparity_count = model.disparity_count(divisor, nearest, filters.maxdepth)
    focal_times_baseline = model.focal_times_baseline(divisor)

    images = _match_region(pair, disparity_count, _noise_sigma(pair, config, settings), settings)
    if not settings.double_shot:
        apply_filters(images, filters, focal_times_baseline, divisor)
        return images
    if dark_pair is not None:
        second_images = _match_region(dark_pair, disparity_count, _noise_sigma(dark_pair, config, settings), settings)
    else:
        second_images = _match_half_resolution(pair, disparity_count, _noise_sigma(pair, config, settings))
        _clear_outside_region(second_images.disparity, settings)
    for measured in (images, second_images):
        apply_filters(measured, replace(filters, fill=0), focal_times_baseline, divisor)
    holes = images.disparity == 0
    np.copyto(images.disparity, second_images.disparity, where=holes)
    np.copyto(images.error, second_images.error, where=holes)
    np.copyto(images.confidence, second_images.confidence, where=holes)
    if filters.fills:
        fill_holes(images, filters.fill)
    return images


def _noise_sigma(pair: MatcherPair, config: StereoConfig, settings: StreamSettings) -> float:
    """Return the standard deviation of the images' noise at mid grey, grey levels."""
    return pair.exposure.noise_sigma(128.0) * config.noise_factor / math.sqrt(settings.averaged_images)


def _match_region(pair: MatcherPair, disparity_count: int, noise_sigma: float, settings: StreamSettings) -> DepthImages:
    """Match a pair within the depth region only, to save time; return images of the full size."""
    left, right, region = pair.left.image, pair.right.image, settings.depth_region
    if region is None:
        return match_pair(left, right, disparity_count, noise_sigma)
    height, width = left.shape
    rows, columns = region.slices(settings.quality.divisor)
    full_size = DepthImages(np.zeros_like(left, np.uint16), np.zeros_like(left), np.zeros_like(left))
    if rows.start >= height or columns.start >= width:
        return full_size
    # Points at the region's left edge lie up to `disparity_count` columns farther left in the right image.
    first_column = max(columns.start - disparity_count, 0)
    search_window = np.s_[rows, first_column : columns.stop]
    region_images = match_pair(
        np.ascontiguousarray(left[search_window]),
        np.ascontiguousarray(right[search_window]),
        disparity_count,
        noise_sigma,
    )
    region_columns = np.s_[:, columns.start - first_column :]
    full_size.disparity[rows, columns] = region_images.disparity[region_columns]
    full_size.error[rows, columns] = region_images.error[region_columns]
    full_size.confidence[rows, columns] = region_images.confidence[region_columns]
    return full_size


def _match_half_resolution(pair: MatcherPair, disparity_count: int, noise_sigma: float) -> DepthImages:
    """Match at half the resolution, where matching windows cover four times the area, and enlarge the result."""
    height, width = pair.left.image.shape
    half_size = (-(-width // 2), -(-height // 2))
    left, right = (
        np.asarray(cv2.resize(sensor_image.image, half_size, interpolation=cv2.INTER_AREA), np.uint8)
        for sensor_image in (pair.left, pair.right)
    )
    half_images = match_pair(left, right, -(-disparity_count // 2), noise_sigma / 2)

    def enlarge(values: NDArray[np.uint8] | NDArray[np.uint16], factor: int) -> NDArray[np.uint16]:
        """Return the values times ``factor``, each repeated in 2 x 2 pixels."""
        enlarged = np.repeat(np.repeat(values, 2, axis=0), 2, axis=1)[:height, :width]
        return np.ascontiguousarray(enlarged.astype(np.uint16) * factor)

    error = np.minimum(enlarge(half_images.error, 2), 255).astype(np.uint8)
    return DepthImages(enlarge(half_images.disparity, 2), error, enlarge(half_images.confidence, 1).astype(np.uint8))


def _clear_outside_region(disparity: NDArray[np.float32] | NDArray[np.uint16], settings: StreamSettings) -> None:
    """Set disparities outside the depth region to 0."""
    if settings.depth_region is not None:
        outside = np.ones(disparity.shape, np.bool_)
        outside[settings.depth_region.slices(settings.quality.divisor)] = False
        disparity[outside] = 0
