"""Depth images of a frame by matching its camera images, with the device's parameters."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.stream_settings import StreamSettings
from renderers.interface import Parallel
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.filters import apply_filters, fill_holes
from renderers.stereo.depth.matching import ImagePair, block_means, in_turn, match_pair


def matched_depth(
    config: StereoConfig,
    pair: ImagePair,
    settings: StreamSettings,
    dark_pair: ImagePair | None,
    parallel: Parallel = in_turn,
) -> DepthImages:
    """Return depth images by matching a pair; ``parallel`` as for ``match_pair``.

    The images of ``dark_pair`` are without the projector's light: with them, ``double_shot`` fills holes. None: it
    fills them by matching ``pair`` at half the resolution.
    """
    model, divisor = config.model, settings.quality.divisor
    nearest = settings.filters.measurable_depths(model, divisor).min_depth
    filters = replace(settings.filters, mindepth=nearest)
    disparity_count = model.disparity_count(divisor, nearest, filters.maxdepth)
    focal_times_baseline = model.focal_times_baseline(divisor)

    noise_sigma, scaled = _noise_sigma(pair, config, settings), pair.reduced(model, divisor)
    images = _match_region(*scaled, disparity_count, noise_sigma, settings, parallel)
    if not settings.double_shot:
        apply_filters(images, filters, focal_times_baseline, divisor)
        return images
    if dark_pair is not None:
        dark = dark_pair.reduced(model, divisor)
        second_images = _match_region(
            *dark, disparity_count, _noise_sigma(dark_pair, config, settings), settings, parallel
        )
    else:
        second_images = _match_half_resolution(*scaled, disparity_count, noise_sigma, 2 * divisor, parallel)
        if settings.depth_region is not None:
            settings.depth_region.clear_outside(second_images.disparity, divisor)
    for measured in (images, second_images):
        apply_filters(measured, replace(filters, fill=0), focal_times_baseline, divisor)
    holes = images.disparity == 0
    np.copyto(images.disparity, second_images.disparity, where=holes)
    np.copyto(images.error, second_images.error, where=holes)
    np.copyto(images.confidence, second_images.confidence, where=holes)
    if filters.fills:
        fill_holes(images, filters.fill)
    return images


def _noise_sigma(pair: ImagePair, config: StereoConfig, settings: StreamSettings) -> NDArray[np.float64]:
    """Return the standard deviation of the noise in the images that are matched, (256,) float64."""
    noise = config.noise_factor, settings.averaged_images, settings.quality.divisor
    return pair.noise_sigma(*noise, has_pattern=config.has_fixed_pattern)


def _match_region(
    left: NDArray[np.uint16],
    right: NDArray[np.uint16],
    disparity_count: int,
    noise_sigma: NDArray[np.float64],
    settings: StreamSettings,
    parallel: Parallel,
) -> DepthImages:
    """Return depth images of the full size as ``match_pair`` does, but match only the depth region, to save time."""
    region = settings.depth_region
    if region is None:
        return match_pair(left, right, disparity_count, noise_sigma, settings.quality.divisor, parallel)
    height, width = left.shape
    rows, columns = region.slices(settings.quality.divisor)
    full_size = DepthImages(np.zeros_like(left), np.zeros_like(left, np.uint8), np.zeros_like(left, np.uint8))
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
        settings.quality.divisor,
        parallel,
    )
    region_columns = np.s_[:, columns.start - first_column :]
    full_size.disparity[rows, columns] = region_images.disparity[region_columns]
    full_size.error[rows, columns] = region_images.error[region_columns]
    full_size.confidence[rows, columns] = region_images.confidence[region_columns]
    return full_size


def _match_half_resolution(
    left: NDArray[np.uint16],
    right: NDArray[np.uint16],
    disparity_count: int,
    noise_sigma: NDArray[np.float64],
    divisor: int,
    parallel: Parallel,
) -> DepthImages:
    """Return depth images by matching at half the resolution, where a window covers four times the area of the scene.

    Arguments and result have the full resolution, but ``divisor`` is that of the matched images.
    """
    height, width = left.shape
    half_left, half_right = (block_means(image, 2, -(-height // 2), -(-width // 2)) for image in (left, right))
    half_images = match_pair(half_left, half_right, -(-disparity_count // 2), noise_sigma / 2, divisor, parallel)

    def enlarge(values: NDArray[np.uint8] | NDArray[np.uint16], factor: int) -> NDArray[np.uint16]:
        """Return the values times ``factor``, each repeated in 2 x 2 pixels."""
        enlarged = np.repeat(np.repeat(values, 2, axis=0), 2, axis=1)[:height, :width]
        return np.ascontiguousarray(enlarged.astype(np.uint16) * factor)

    error = np.minimum(enlarge(half_images.error, 2), 255).astype(np.uint8)
    return DepthImages(enlarge(half_images.disparity, 2), error, enlarge(half_images.confidence, 1).astype(np.uint8))
