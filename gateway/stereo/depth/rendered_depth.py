"""Depth images of a frame from rendered depth, with the device's parameters.

One function per depth mode: ``ground_truth_depth`` and ``modelled_depth``. ``matched_depth`` has a module of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.device.camera_config import StereoConfig
from gateway.stereo.device.stream_settings import StreamSettings
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.downscale import fine_means
from renderers.stereo.depth.filters import apply_filters
from renderers.stereo.depth.modelled_errors import ErrorModel, choose_error_scale, exact_images, measured_images
from renderers.stereo.depth.pixel_classes import ImageKind
from renderers.stereo.depth.true_disparity import DepthRange, true_disparity
from renderers.stereo.model import StereoModel
from renderers.stereo.sensor.exposure import Exposure, SensorImage


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


def depth_pair(pair: ImagePair, model: StereoModel, divisor: int) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return the left and the right image at the resolution of the depth images, (H, W) uint16 each, 1/16 grey level.

    Pixels are means of blocks of ``divisor`` x ``divisor`` pixels.
    """
    k = model.intrinsics(divisor)
    left, right = (fine_means(image.image, divisor, k.height, k.width) for image in (pair.left, pair.right))
    return left, right


def depth_noise_sigma(pair: ImagePair, config: StereoConfig, settings: StreamSettings) -> float:
    """Return the standard deviation of the noise at mid grey in the images of ``depth_pair``, grey levels."""
    images = settings.averaged_images * settings.quality.divisor**2
    return pair.exposure.mid_grey_noise * config.noise_factor / math.sqrt(images)


def ground_truth_depth(
    config: StereoConfig,
    left_depth: NDArray[np.float32],
    right_depth: NDArray[np.float32],
    settings: StreamSettings,
) -> DepthImages:
    """Return depth images from rendered depth, without errors.

    All holes and segments are true, so ``minconf``, ``seg`` and ``fill`` have no effect. Nor does ``double_shot``: it
    fills holes where matching fails.

    Args:
        config: model of the camera.
        left_depth: (H, W) float32 depth from the left camera at the depth images' resolution, metres.
        right_depth: (H, W) float32 depth from the right camera, metres.
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
) -> DepthImages:
    """Return depth images from rendered depth, with a window matcher's errors (``modelled_errors``).

    ``double_shot`` has no effect.

    Args:
        config: model of the camera, disparity error, and factor of the noise.
        left_depth: (H, W) float32 depth from the left camera at the depth images' resolution, metres.
        right_depth: (H, W) float32 depth from the right camera, metres.
        pair: images of the same exposure, from which the errors follow.
        settings: parameters of the frame.
    """
    model, divisor, filters = config.model, settings.quality.divisor, settings.filters
    disparity = _true_disparity(config, left_depth, right_depth, settings)
    sigma = config.disparity_error / divisor / settings.averaged_images**0.5
    errors = ErrorModel(
        sigma,
        depth_noise_sigma(pair, config, settings),
        pair.kind,
        choose_error_scale(sigma, model.disparity_count(divisor, filters.mindepth, filters.maxdepth)),
    )
    images = measured_images(disparity, *depth_pair(pair, model, divisor), errors)
    clear_outside_region(images.disparity, settings)
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
    clear_outside_region(disparity, settings)
    return disparity


def clear_outside_region(disparity: NDArray[np.float32] | NDArray[np.uint16], settings: StreamSettings) -> None:
    """Set disparities outside the depth region to 0."""
    if settings.depth_region is not None:
        outside = np.ones(disparity.shape, np.bool_)
        outside[settings.depth_region.slices(settings.quality.divisor)] = False
        disparity[outside] = 0
