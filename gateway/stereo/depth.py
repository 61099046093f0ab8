"""Depth images of a frame, from rendered depth or by matching, with the device's parameters.

One function per depth mode: ``ground_truth_depth``, ``modelled_depth`` and ``matched_depth``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.config import StereoConfig
from gateway.stereo.settings import StreamSettings
from renderers.stereo.depth_images import DepthImages
from renderers.stereo.downscale import block_means
from renderers.stereo.errors import ErrorModel, choose_error_scale, exact_images, measured_images
from renderers.stereo.exposure import Exposure
from renderers.stereo.filters import apply_filters, fill_holes
from renderers.stereo.matching import MIN_NOISE_SIGMA, match_pair
from renderers.stereo.model import StereoModel
from renderers.stereo.pixel_classes import ImageKind
from renderers.stereo.sensor import SensorImage
from renderers.stereo.truth import DepthRange, true_disparity


@dataclass(frozen=True, slots=True, eq=False)
class ImagePair:
    """Grey images at full resolution, from which depth is measured."""

    left: SensorImage
    right: SensorImage
    exposure: Exposure
    """Exposure of both images, which determines their noise."""
    kind: ImageKind


def measurable_depths(model: StereoModel, settings: StreamSettings) -> DepthRange:
    """Return the range of depths that the camera can measure with these parameters."""
    filters = settings.filters
    nearest = model.nearest_depth(filters.mindepth, filters.maxdepth, settings.quality.divisor)
    return DepthRange(nearest, filters.maxdepth)


def depth_pair(pair: ImagePair, model: StereoModel, divisor: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the left and the right image at the depth images' resolution, (H, W) uint8: means of blocks of pixels."""
    k = model.intrinsics(divisor)
    left, right = (block_means(image.image, divisor, k.height, k.width) for image in (pair.left, pair.right))
    return left, right


def noise_of(pair: ImagePair, config: StereoConfig, settings: StreamSettings) -> float:
    """Return the standard deviation of the noise in the images of ``depth_pair`` at mid grey, grey levels."""
    images = settings.averaged_images * settings.quality.divisor**2
    return pair.exposure.noise_sigma(128.0) * config.noise_factor / math.sqrt(images)


def ground_truth_depth(
    config: StereoConfig,
    left_depth: NDArray[np.float32],
    right_depth: NDArray[np.float32],
    settings: StreamSettings,
) -> DepthImages:
    """Return depth images from rendered depth, without errors: all holes and segments are true, so they are kept.

    ``double_shot`` has no effect: it fills holes where matching fails, which rendered depth does not have.

    Args:
        config: model.
        left_depth: (H, W) float32 depth from the left camera at the depth images' resolution, metres.
        right_depth: (H, W) float32 depth from the right camera.
        settings: parameters of the frame.
    """
    images = exact_images(_true_disparity(config, left_depth, right_depth, settings))
    filters = replace(settings.filters, minconf=0.0, seg=0, fill=0)
    apply_filters(
        images, filters, config.model.focal_times_baseline(settings.quality.divisor), settings.quality.divisor
    )
    return images


def modelled_depth(
    config: StereoConfig,
    left_depth: NDArray[np.float32],
    right_depth: NDArray[np.float32],
    pair: ImagePair,
    settings: StreamSettings,
    frame_number: int,
) -> DepthImages:
    """Return depth images from rendered depth, with the errors of a window matcher (``renderers.stereo.errors``).

    ``double_shot`` has no effect.

    Args:
        config: model, noise and seed.
        left_depth: (H, W) float32 depth from the left camera at the depth images' resolution, metres.
        right_depth: (H, W) float32 depth from the right camera.
        pair: images of the same exposure, which say where a matcher can measure.
        settings: parameters of the frame.
        frame_number: selects the random numbers.
    """
    model, divisor, filters = config.model, settings.quality.divisor, settings.filters
    disparity = _true_disparity(config, left_depth, right_depth, settings)
    sigma = config.disparity_error / divisor / settings.averaged_images**0.5
    errors = ErrorModel(
        sigma,
        max(noise_of(pair, config, settings), MIN_NOISE_SIGMA),
        config.seed,
        pair.kind,
        frame_number,
        choose_error_scale(sigma, model.disparity_count(divisor, filters.mindepth, filters.maxdepth)),
    )
    images = measured_images(disparity, *depth_pair(pair, model, divisor), errors)
    _clear_outside_region(images.disparity, settings)
    apply_filters(images, filters, model.focal_times_baseline(divisor), divisor)
    return images


def _true_disparity(
    config: StereoConfig,
    left_depth: NDArray[np.float32],
    right_depth: NDArray[np.float32],
    settings: StreamSettings,
) -> NDArray[np.float32]:
    """Return the exact disparity within the depth region, (H, W) float32, pixels; 0: not measurable."""
    factor = config.model.focal_times_baseline(settings.quality.divisor)
    disparity = true_disparity(left_depth, right_depth, factor, measurable_depths(config.model, settings))
    _clear_outside_region(disparity, settings)
    return disparity


def matched_depth(
    config: StereoConfig, pair: ImagePair, settings: StreamSettings, dark_pair: ImagePair | None
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

    noise_sigma = noise_of(pair, config, settings)
    scaled = depth_pair(pair, model, divisor)
    images = _match_region(*scaled, disparity_count, noise_sigma, pair.kind, settings)
    if not settings.double_shot:
        apply_filters(images, filters, focal_times_baseline, divisor)
        return images
    if dark_pair is not None:
        dark = depth_pair(dark_pair, model, divisor)
        dark_noise = noise_of(dark_pair, config, settings)
        second_images = _match_region(*dark, disparity_count, dark_noise, dark_pair.kind, settings)
    else:
        second_images = _match_half_resolution(*scaled, disparity_count, noise_sigma, pair.kind)
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


def _match_region(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    disparity_count: int,
    noise_sigma: float,
    kind: ImageKind,
    settings: StreamSettings,
) -> DepthImages:
    """Match a pair within the depth region only, to save time; return images of the full size."""
    region = settings.depth_region
    if region is None:
        return match_pair(left, right, disparity_count, noise_sigma, kind)
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
        kind,
    )
    region_columns = np.s_[:, columns.start - first_column :]
    full_size.disparity[rows, columns] = region_images.disparity[region_columns]
    full_size.error[rows, columns] = region_images.error[region_columns]
    full_size.confidence[rows, columns] = region_images.confidence[region_columns]
    return full_size


def _match_half_resolution(
    left: NDArray[np.uint8], right: NDArray[np.uint8], disparity_count: int, noise_sigma: float, kind: ImageKind
) -> DepthImages:
    """Match at half the resolution, where matching windows cover four times the area, and enlarge the result."""
    height, width = left.shape
    half_left, half_right = (block_means(image, 2, -(-height // 2), -(-width // 2)) for image in (left, right))
    half_images = match_pair(half_left, half_right, -(-disparity_count // 2), noise_sigma / 2, kind)

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
