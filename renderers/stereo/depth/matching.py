"""Semi-global matching of a rectified pair, with an error and a confidence for each match.

OpenCV's matcher finds the disparities. Its interpolation prefers whole pixels by up to 0.2 pixels, so two steps of
``residual_shift`` refine them. A step corrects the mean disparity of a window, so the first starts from smoothed ones.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.interface import Parallel
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.match_confidence import error_and_confidence, match_features, with_even_noise, with_texture
from renderers.stereo.depth.residual_shift import residual_shift, without_local_mean
from renderers.stereo.model import DISPARITY_SCALE, StereoModel
from renderers.stereo.sensor.camera_image import SensorImage, fixed_pattern_variance
from renderers.stereo.sensor.exposure import Exposure

Level = TypeVar("Level", np.uint8, np.uint16)
FINE: Final = 16
"""Units per grey level of fine images: means of blocks have fractions of a level."""
ROUNDING_VARIANCE: Final = 1.0 / 12.0
"""Variance of rounding to whole grey levels."""
STEP_COSTS: Final = {1: (14, 40), 3: (72, 288)}
"""Costs of a step of one disparity, and of a larger one, by the side of the matching window, pixels. A window widens
what is near. Full images, whose edges are softest, are matched without one, with fewer errors near edges.
"""
TOLERANCES: Final = {1: 5, 3: 1}
"""Maximum difference of the matches from left to right and from right to left, pixels, by the side of the window."""
REFINEMENT_RADIUS: Final = 4
"""Radius of the windows of the refinement, pixels."""
REFINEMENTS: Final = 2
"""Steps of the refinement. More change disparities by less than 1/16 pixel."""
MAX_DIFFERENCE: Final = 4.0
"""Difference of the disparities in images of full and of half the size above which only one can be right, pixels."""
MIN_REGION: Final = 17
"""Side of the smallest region in which the half-size images decide, pixels: at edges, they are less exact."""
NEAREST_WINDOW_STEP: Final = 640
"""Image width per two pixels of the window in which half-size matches must agree to be the nearest thing; fewer may be
wrong. The window has 1 pixel at Low and Medium, 3 at High, 5 at Full."""
REACH_MARGIN: Final = 16
"""Disparities beyond the largest one in the half-size images that are searched, pixels."""
BAND_MARGIN: Final = 32
"""Rows beyond the border of a band that are matched with it: they support the matches, features and means inside."""
MIN_HEIGHT_OF_BANDS: Final = 8 * BAND_MARGIN
"""Height of the smallest image that is matched in two bands."""
MAX_REFINEMENT: Final = 0.5
"""Maximum change of a disparity by the refinement, pixels. A larger one follows another surface."""


@dataclass(frozen=True, slots=True, eq=False)
class ImagePair:
    """Grey images at full resolution, from which depth is measured."""

    left: SensorImage
    right: SensorImage
    exposure: Exposure
    """Exposure of both images, which determines their noise."""

    def reduced(self, model: StereoModel, divisor: int) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
        """Return both images at 1/``divisor`` of the resolution, (H, W) uint16 each, units of 1/``FINE`` level."""
        k = model.intrinsics(divisor)
        left, right = (fine_means(image.image, divisor, k.height, k.width) for image in (self.left, self.right))
        return left, right

    def noise_sigma(
        self, noise_factor: float, averaged_images: int, divisor: int, *, has_pattern: bool
    ) -> NDArray[np.float64]:
        """Return the standard deviation of the ``reduced`` images around those without noise, (256,) float64.

        Besides noise, pixels have rounding errors and, with ``has_pattern``, the fixed pattern of the sensors.
        """
        variance = (self.exposure.noise_by_level * noise_factor) ** 2 / averaged_images + ROUNDING_VARIANCE
        if has_pattern:
            variance += fixed_pattern_variance(self.exposure)
        sigma: NDArray[np.float64] = np.sqrt(variance) / divisor
        return sigma


def block_means(image: NDArray[Level], side: int, rows: int, columns: int) -> NDArray[Level]:
    """Return the mean of each block of ``side`` x ``side`` pixels, (rows, columns) or (rows, columns, 3).

    Blocks that reach beyond the image repeat its last row and column. Pixels beyond the last block are ignored.
    """
    height, width = rows * side, columns * side
    padding_below, padding_right = max(height - image.shape[0], 0), max(width - image.shape[1], 0)
    if padding_below or padding_right:
        padded = cv2.copyMakeBorder(image, 0, padding_below, 0, padding_right, cv2.BORDER_REPLICATE)
        image = np.asarray(padded, image.dtype)
    image = np.ascontiguousarray(image[:height, :width])
    if side == 1:
        return image
    return np.asarray(cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA), image.dtype)


def fine_means(image: NDArray[np.uint8], side: int, rows: int, columns: int) -> NDArray[np.uint16]:
    """Return ``block_means`` of a grey image in units of 1/``FINE`` level, (rows, columns) uint16."""
    return block_means(np.multiply(image, FINE, dtype=np.uint16), side, rows, columns)


def in_turn(units: int, work: Callable[[int], object]) -> None:
    """``Parallel`` in one thread."""
    for unit in range(units):
        work(unit)


def match_pair(
    left: NDArray[np.uint16],
    right: NDArray[np.uint16],
    disparity_count: int,
    noise_sigma: NDArray[np.float64],
    divisor: int,
    parallel: Parallel = in_turn,
) -> DepthImages:
    """Return depth images by matching a pair, the upper and the lower half of large images on their own, in parallel.

    Args:
        disparity_count: number of disparities to search, one per pixel from 0.
    """
    height = len(left)
    bands = 2 if height >= MIN_HEIGHT_OF_BANDS else 1
    images = DepthImages(np.empty_like(left), np.empty(left.shape, np.uint8), np.empty(left.shape, np.uint8))

    def match_band(band: int) -> None:
        begin, end = height * band // bands, height * (band + 1) // bands
        rows = slice(max(begin - BAND_MARGIN, 0), end + BAND_MARGIN)
        matched = _match_rows(left[rows], right[rows], disparity_count, noise_sigma, divisor)
        inside = slice(begin - rows.start, end - rows.start)
        images.disparity[begin:end] = matched.disparity[inside]
        images.error[begin:end] = matched.error[inside]
        images.confidence[begin:end] = matched.confidence[inside]

    parallel(bands, match_band)
    return images


def _match_rows(
    left: NDArray[np.uint16],
    right: NDArray[np.uint16],
    disparity_count: int,
    noise_sigma: NDArray[np.float64],
    divisor: int,
) -> DepthImages:
    """Return the depth images of the rows of a pair."""
    matches = find_matches(left, right, disparity_count, noise_sigma, divisor)
    even_left, even_right = (with_even_noise(image, noise_sigma) for image in (left, right))
    features = match_features(even_left, even_right, matches, divisor)
    disparity = with_texture(matches, features)
    return DepthImages(disparity, *error_and_confidence(features, disparity, divisor))


def find_matches(
    left: NDArray[np.uint16],
    right: NDArray[np.uint16],
    disparity_count: int,
    noise_sigma: NDArray[np.float64],
    divisor: int,
) -> NDArray[np.uint16]:
    """Return the disparities of a pair, (H, W) uint16, 0 where there is no match.

    A pixel has a match if the matches from left to right and from right to left agree.
    """
    window = 1 if divisor == 1 else 3
    grey_left, grey_right = ((image + np.uint16(FINE // 2) >> 4).astype(np.uint8) for image in (left, right))
    matches = _semi_global_matches(grey_left, grey_right, disparity_count, window)
    start = matches.astype(np.float32) * np.float32(DISPARITY_SCALE)
    box = (2 * REFINEMENT_RADIUS + 1,) * 2
    known_share = cv2.boxFilter((start > 0.0).astype(np.float32), -1, box)
    mean = cv2.boxFilter(start, -1, box) / np.maximum(known_share, np.float32(1e-3))
    # Beside an edge, the window has two surfaces, of which the refinement would find a mixture.
    is_smooth = (start > 0.0) & (np.abs(mean - start) <= MAX_REFINEMENT)
    refined = np.where(is_smooth, mean, start)
    left_detail, right_detail = without_local_mean(left), without_local_mean(right)
    mid_grey_noise = float(noise_sigma[128])
    for _ in range(REFINEMENTS):
        shift = residual_shift(left_detail, right_detail, refined, REFINEMENT_RADIUS, mid_grey_noise)
        # At least one unit: 0 is no match.
        refined = np.where(start > 0.0, np.maximum(refined + shift, np.float32(DISPARITY_SCALE)), np.float32(0.0))
    is_refined = is_smooth & (np.abs(refined - start) <= MAX_REFINEMENT)
    return np.asarray(np.rint(np.where(is_refined, refined, start) / np.float32(DISPARITY_SCALE)), np.uint16)


def _semi_global_matches(
    left: NDArray[np.uint8], right: NDArray[np.uint8], disparity_count: int, window: int
) -> NDArray[np.uint16]:
    """Return the disparities of OpenCV's matcher for images in grey levels; see ``find_matches``.

    Images of half the size are matched first, for two reasons:

    * The largest disparity in them limits the search. In a room whose nearest point is at a third of the measurable
      range, it takes a third of the time.
    * Where a texture repeats, the matcher prefers the repetition that is nearest to a whole pixel. Of a wall whose
      texture repeats every metre, 1 % of the pixels were right. In images of half the size, the details that decide
      this are gone. Their matches replace those of large regions that differ: then all pixels of the wall are right.
    """
    height, width = left.shape
    half_left, half_right = (np.asarray(cv2.pyrDown(image), np.uint8) for image in (left, right))
    half_matches = _opencv_matches(half_left, half_right, -(-disparity_count // 2), 3) * 2
    side = 2 * (width // NEAREST_WINDOW_STEP) + 1
    nearest = int(cv2.erode(half_matches, np.ones((side, side), np.uint8)).max())
    reach = math.ceil(nearest * DISPARITY_SCALE) + REACH_MARGIN if nearest else disparity_count
    matches = _opencv_matches(left, right, min(reach, disparity_count), window)
    coarse = cv2.resize(half_matches, (width, height), interpolation=cv2.INTER_NEAREST)
    difference = np.abs(coarse.astype(np.int32) - matches) * DISPARITY_SCALE
    differs = ((coarse > 0) & (difference > MAX_DIFFERENCE)).astype(np.uint8)
    region = np.ones((MIN_REGION, MIN_REGION), np.uint8)
    is_repetition = cv2.morphologyEx(differs, cv2.MORPH_OPEN, region) > 0
    return np.where(is_repetition, coarse, matches)


def _opencv_matches(
    left: NDArray[np.uint8], right: NDArray[np.uint8], disparity_count: int, window: int
) -> NDArray[np.uint16]:
    """Return matches that agree from left to right and from right to left, as ``find_matches``."""
    searched_count = -(-disparity_count // 16) * 16
    # OpenCV leaves the first `searched_count` columns invalid. Padding of that width keeps all columns of the image.
    padded = [cv2.copyMakeBorder(image, 0, 0, searched_count, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    small_step, large_step = STEP_COSTS[window]
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=searched_count,
        blockSize=window,
        P1=small_step,
        P2=large_step,
        disp12MaxDiff=TOLERANCES[window],
        preFilterCap=15,
        speckleWindowSize=0,
        speckleRange=0,
        mode=cv2.StereoSGBM_MODE_SGBM_3WAY,  # 155 instead of 257 ms at High, as many matches, fewer wrong
    )
    matches = np.asarray(matcher.compute(padded[0], padded[1]), np.int16)[:, searched_count:]
    # No match (0 or less), or a match with the padding beyond the left edge of the right image.
    is_match = (matches > 0) & (matches <= disparity_count * 16)
    is_match &= matches <= np.arange(left.shape[1], dtype=np.int32) * 16
    return np.where(is_match, matches, 0).astype(np.uint16)
