"""Error model of the disparity: turns exact disparities into those that a window matcher would measure.

The device's manual defines the disparity error (d_eps) as the standard deviation of the measured disparity, and the
confidence as the probability that the measured disparity is within 3 disparity errors of the true one. Each pixel of
the left image has a class: its texture, the agreement of both images at the exact disparity, and edges in its window
(``pixel_classes``). For each class ``statistics`` has the share of pixels with a match, and the share of right matches
among these. A match is right if it is within 3 disparity errors. The outcome of each pixel follows from them:

* Hole: no match, as on surfaces without texture, in highlights, on translucent surfaces and in repeated patterns.
* Right: with the error that the steps of ``matching`` would leave in these images (``residual_shift``), scaled so
  that its standard deviation is the disparity error times the relative error of the class.
* Wrong, at an edge: the disparity of the other side, which makes outlines ragged. Pixels beside a nearer surface that
  the right camera does not see may get the disparity of that surface. Foreground objects are therefore too wide by a
  part of the matching window.
* Wrong, in repeated texture: off by a period.
* Wrong, elsewhere: off by more than 3 disparity errors.

Semi-global matching carries disparities from textured surfaces into plain ones, so plain pixels far from texture have
fewer matches.

There are no random numbers. Errors follow from the texture, the dots and the sub-pixel phase, so they stay while the
scene is static; the image noise adds a small part that differs from frame to frame. The holes and wrong pixels of a
class are its pixels that are brightest relative to their surroundings and have the largest errors. They form blobs that
move with the surface. The confidence is the share of right pixels among those that look alike to the device.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.stereo.depth.depth_images import DepthImages, sixteenths
from renderers.stereo.depth.image_pair import grey_levels
from renderers.stereo.depth.pixel_classes import (
    DISAGREEMENTS,
    EDGE_STEP,
    EDGES,
    HIDDEN_CLASS,
    MIN_NOISE_SIGMA,
    ImageKind,
    classify,
    second_match,
    statistics,
    window_range,
    wrong_spread,
)
from renderers.stereo.depth.residual_shift import residual_shift, without_local_mean
from renderers.stereo.model import DISPARITY_SCALE

ERROR_TOLERANCE: Final = 0.05
"""Maximum relative difference between a pixel's error and the value in the error image."""
ERROR_RADIUS: Final = 5
"""Radius of the windows of ``residual_shift``, pixels. With smaller ones, errors of normals grow."""
SECOND_STEP: Final = 0.8
"""Share of the second step of ``matching`` in the errors. With more, neighbours in a row differ more, and normals are
worse. With less, errors stay when dots move over a surface."""
ERROR_COLUMN: Final = 11
"""Height of the columns over which errors are averaged, pixels. Lower ones make errors of normals worse: the configured
errors are three times those of ``matching``."""
_COLUMN_MEAN: Final = np.full(ERROR_COLUMN, 1.0 / ERROR_COLUMN)
WEAK_SHIFT: Final = 0.035
"""Standard deviation of the shift that ``residual_shift`` expects in windows without texture, pixels. It belongs to the
surroundings, which guide semi-global matching. With more, errors in weak texture are less noisy, but stay in motion."""
BANDS: Final = (3, 7)
"""Sides of two boxes, pixels at 1/``COARSE``: our choice. The difference of their mean brightness is that of a pixel's
surroundings."""
COARSE: Final = 4
"""Surroundings and distances from texture are measured at 1/4 of the resolution."""
LOCKING: Final = 0.3
"""Preference for whole disparities: amplitude of the mean error by sub-pixel phase, relative to the disparity error.
Real devices have 0.03 to 0.06 pixels. Without it, the mean error of each phase is 0."""
_LOCKING_BY_PHASE: Final = (LOCKING * np.sin(np.arange(17) / 8.0 * np.pi)).astype(np.float32)
"""(17,) float32, disparity errors by sixteenths of the disparity; the last one for pixels without disparity."""
REPEATED: Final = 0.5
"""Added to the rank of pixels in repeated texture: about this share of them has no match."""
PLAIN_CLASSES: Final = 3 * DISAGREEMENTS * EDGES
"""Classes below this one are those of plain surfaces: the three lowest ones of texture."""
TEXTURED: Final = 4
"""Lowest class of texture whose disparities are carried into plain surfaces."""
CARRIED: Final = 50.0
"""Distance from such texture up to which plain surfaces have the share of matches of their class, pixels. Farther away,
the share falls with the inverse of the distance."""
RANK_BINS: Final = 256
"""Bins of the histogram by which the pixels of a class are ordered."""
MAX_NOISE: Final = 3.0
"""Maximum error of a right pixel, standard deviations."""
SUMS: Final = 4
"""Number of partial sums of each group, which the CPU adds independently."""
SAMPLED: Final = 2
"""Statistics of groups are those of every second row: neighbours in a column have nearly the same error."""
_WRONG_FROM, _HOLE_FROM, _SIGMA, _MIN_WRONG, _WRONG_SPREAD, _ERROR, _CONFIDENCE, _NEIGHBOUR_CONFIDENCE = range(8)
"""Columns of the class table (``_class_table``)."""


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """Parameters of the errors of one frame."""

    sigma: float
    """Standard deviation of the disparity on good texture, rounding included, pixels; above 0."""
    noise_sigma: float
    """Standard deviation of the image noise, grey levels."""
    kind: ImageKind
    """Kind of the images."""
    error_scale: float = DISPARITY_SCALE
    """Pixels per unit of the error image (``choose_error_scale``)."""


def choose_error_scale(sigma: float, disparity_count: int) -> float:
    """Return the pixels per unit of an error image.

    The device's unit is 1/16 pixel. The unit is halved until rounding to it changes ``sigma`` by at most
    ``ERROR_TOLERANCE``. The disparity message has the same unit and 16 bits, which limits the halving.

    Args:
        sigma: standard deviation of the disparity, pixels; 0: no noise.
        disparity_count: number of disparities that the camera measures, and therefore the largest one, pixels.
    """
    scale = DISPARITY_SCALE
    largest = disparity_count + 4.0 * sigma + 1.0  # noise and outliers included
    while abs(round(sigma / scale) * scale - sigma) > ERROR_TOLERANCE * sigma and largest / scale * 2 <= 65535:
        scale /= 2
    return scale


def measured_images(
    true_disparity: NDArray[np.float32], left: NDArray[np.uint16], right: NDArray[np.uint16], model: ErrorModel
) -> DepthImages:
    """Return the depth images that a camera measures with the errors of this model.

    Args:
        true_disparity: (H, W) float32, exact disparity in pixels, 0: not measurable.
        left: (H, W) uint16, left image, units of 1/16 grey level.
        right: (H, W) uint16, right image, likewise.
        model: parameters of the errors.
    """
    exact = sixteenths(true_disparity)
    nearest, farthest = window_range(exact)
    levels, right_levels = grey_levels(left), grey_levels(right)
    noise_sigma = max(model.noise_sigma, MIN_NOISE_SIGMA)
    classes = classify(levels, right_levels, exact, nearest, farthest, noise_sigma)
    # No class is above HIDDEN_CLASS, and no phase above 15.
    is_hidden = exact == 0
    classes = np.maximum(classes, is_hidden * np.uint8(HIDDEN_CLASS))
    phases = np.maximum((exact & np.uint16(15)).astype(np.uint8), is_hidden * np.uint8(16))
    surroundings = _surroundings(levels)
    _standardise(surroundings, classes)
    expected = surroundings * np.float32(WEAK_SHIFT)
    pair = without_local_mean(left), without_local_mean(right)
    shift = residual_shift(*pair, true_disparity, ERROR_RADIUS, model.noise_sigma, expected)
    # A second step from the result of the first one adds the shift again, less its mean in the window.
    mean_shift = cv2.blur(shift, (2 * ERROR_RADIUS + 1,) * 2)
    both_steps = cv2.addWeighted(shift, 1.0 + SECOND_STEP, mean_shift, -SECOND_STEP, 0.0)
    noise = np.asarray(cv2.sepFilter2D(both_steps, -1, np.ones(1), _COLUMN_MEAN), np.float32)
    _standardise(noise, classes)
    _standardise(noise, phases)
    outcome = surroundings + np.float32(0.5) * noise
    _rank(outcome, classes)
    carried = _carried_factors(classes)
    second = second_match(levels, right_levels, true_disparity)
    images = DepthImages(exact, np.empty_like(levels), np.empty_like(levels), model.error_scale)
    _write_measured(
        true_disparity, nearest, farthest, second, classes, phases, noise, outcome, carried, _LOCKING_BY_PHASE,
        _class_table(model.kind, model.sigma, model.error_scale), images.disparity, images.error, images.confidence,
    )  # fmt: skip
    return images


@lru_cache(8)
def _class_table(kind: ImageKind, sigma: float, error_scale: float) -> NDArray[np.float32]:
    """Return (``CLASSES`` + 1, 8) float32, a row for each class, the last one for ``HIDDEN_CLASS``.

    Columns:

    * ``_WRONG_FROM``, ``_HOLE_FROM``: rank in the class from which a pixel is wrong, and from which it is a hole.
    * ``_SIGMA``: standard deviation of the error before rounding, units of 1/16 pixel.
    * ``_MIN_WRONG``, ``_WRONG_SPREAD``: minimum error of a wrong pixel away from edges, and the spread beyond it, units
      of 1/16 pixel.
    * ``_ERROR``: disparity error, units of the error image.
    * ``_CONFIDENCE``, ``_NEIGHBOUR_CONFIDENCE``: confidence of a pixel with the disparity of its own surface, and with
      that of the other side of an edge, units of 1/255.
    """
    table = statistics(kind)
    found, right = table["found"], table["right"]
    sigmas = sigma * table["relative_error"]
    units = np.clip(np.rint(sigmas / error_scale), 1, 255)
    # Rounding to 1/16 pixel is uniform noise of variance 1/12 unit.
    before_rounding = np.sqrt(np.maximum((sigmas / DISPARITY_SCALE) ** 2 - 1.0 / 12.0, 1e-12))
    wrong = 3.0 * units * error_scale / DISPARITY_SCALE + 1.1  # 1.1: rounding must not make it a right one
    confidences = np.floor(np.stack((table["confidence"], table["neighbour_confidence"])) * 255.0)
    spread = np.full_like(found, wrong_spread())
    columns = (found * right, found, before_rounding, wrong, spread, units, *confidences)
    return np.ascontiguousarray(np.stack(columns, axis=1), np.float32)


def _carried_factors(classes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the factors by which distance from texture raises the ranks of plain pixels, (H, W) float32 (``CARRIED``).

    Args:
        classes: (H, W) uint8.
    """
    height, width = classes.shape
    if classes.min() >= PLAIN_CLASSES:
        return np.ones((height, width), np.float32)
    is_textured = (classes >= TEXTURED * DISAGREEMENTS * EDGES) & (classes != HIDDEN_CLASS)
    # Single windows reach that class by noise alone. All windows of a block do so on a textured surface.
    share = is_textured.view(np.uint8) * np.uint8(255)
    textured = cv2.resize(share, _coarse_size(classes.shape), interpolation=cv2.INTER_AREA)
    distance = cv2.distanceTransform(np.not_equal(textured, 255).view(np.uint8), cv2.DIST_L2, 3)
    factors = np.maximum(distance * np.float32(COARSE / CARRIED), np.float32(1.0))
    return np.asarray(cv2.resize(factors, (width, height)), np.float32)


def _surroundings(levels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the difference between the means over the two boxes of ``BANDS``, (H, W) float32, grey levels."""
    height, width = levels.shape
    coarse = cv2.resize(levels, _coarse_size(levels.shape), interpolation=cv2.INTER_AREA)
    small, large = (cv2.boxFilter(coarse, cv2.CV_32F, (side, side)) for side in BANDS)
    return np.asarray(cv2.resize(small - large, (width, height)), np.float32)


def _coarse_size(shape: tuple[int, int]) -> tuple[int, int]:
    """Return width and height of an image of this shape at 1/``COARSE`` of its resolution."""
    return max(shape[1] // COARSE, 1), max(shape[0] // COARSE, 1)


@kernel("void(float32[:,::1], uint8[:,::1])")
def _standardise(values, groups):
    """Change values in place so that in each group their mean is 0 and their variance 1, within ``MAX_NOISE``.

    Args:
        values: (H, W) float32.
        groups: (H, W) uint8, group of each value.
    """
    height, width = values.shape
    # Neighbouring pixels are often in one group. With partial sums, their additions do not wait for each other.
    sums, squares, counts = np.zeros((SUMS, 256)), np.zeros((SUMS, 256)), np.zeros((SUMS, 256))
    for row in range(0, height, SAMPLED):
        for column in range(width):
            part, group = np.uint64(column % SUMS), np.uint64(groups[row, column])
            value = np.float64(values[row, column])
            sums[part, group] += value
            squares[part, group] += value * value
            counts[part, group] += 1.0
    means, factors = np.empty(256, np.float32), np.empty(256, np.float32)
    for index in range(256):
        count = max(counts[:, index].sum(), 1.0)
        mean = sums[:, index].sum() / count
        means[index] = mean
        # No error in groups of fewer than two sampled pixels.
        variance = max(squares[:, index].sum() / count - mean * mean, 1e-12)
        factors[index] = 1.0 / np.sqrt(variance) if count > 1.0 else 0.0
    limit = np.float32(MAX_NOISE)
    for row in range(height):
        for column in range(width):
            group = np.uint64(groups[row, column])
            value = (values[row, column] - means[group]) * factors[group]
            values[row, column] = min(max(value, -limit), limit)


@kernel("void(float32[:,::1], uint8[:,::1])")
def _rank(values, groups):
    """Replace values in place by the share of smaller ones in their group, 0 to 1.

    Args:
        values: (H, W) float32.
        groups: (H, W) uint8, group of each value.
    """
    height, width = values.shape
    sums, counts = np.zeros((SUMS, 256)), np.zeros((SUMS, 256))
    for row in range(0, height, SAMPLED):
        for column in range(width):
            part, group = np.uint64(column % SUMS), np.uint64(groups[row, column])
            sums[part, group] += np.float64(abs(values[row, column]))
            counts[part, group] += 1.0
    # Map values from -1 to 1 by x / (spread + |x|), then to bins: many small and few large values fill all bins.
    spreads, totals = np.empty(256, np.float32), np.empty(256, np.float32)
    for index in range(256):
        totals[index] = max(counts[:, index].sum(), 1.0)
        spreads[index] = 0.5 * sums[:, index].sum() / totals[index] + 1e-6
    half, last = np.float32(RANK_BINS / 2), np.float32(RANK_BINS - 0.01)
    histogram = np.zeros((256, RANK_BINS + 1), np.float32)
    for row in range(height):
        for column in range(width):
            group, value = np.uint64(groups[row, column]), values[row, column]
            values[row, column] = min((np.float32(1.0) + value / (abs(value) + spreads[group])) * half, last)
    for row in range(0, height, SAMPLED):
        for column in range(width):
            group, position = np.uint64(groups[row, column]), values[row, column]
            histogram[group, np.uint64(position) + np.uint64(1)] += np.float32(1.0)
    for index in range(256):
        for position_bin in range(RANK_BINS):
            histogram[index, position_bin + 1] += histogram[index, position_bin]
        for position_bin in range(RANK_BINS + 1):
            histogram[index, position_bin] /= totals[index]
    for row in range(height):
        for column in range(width):
            group, position = np.uint64(groups[row, column]), values[row, column]
            whole = np.uint64(position)
            below, up_to = histogram[group, whole], histogram[group, whole + np.uint64(1)]
            values[row, column] = below + (up_to - below) * (position - np.float32(whole))


@kernel(
    "void(float32[:,::1], uint16[:,::1], uint16[:,::1], float32[:,::1], uint8[:,::1], uint8[:,::1], float32[:,::1], "
    "float32[:,::1], float32[:,::1], float32[::1], float32[:,::1], uint16[:,::1], uint8[:,::1], "
    "uint8[:,::1])"
)
def _write_measured(
    true_disparity, nearest, farthest, second, classes, phases, noise, outcome, carried, locking, class_table,
    disparity, error, confidence,
):  # fmt: skip
    """Write the measured disparity with its error and confidence.

    Args:
        true_disparity: (H, W) float32, pixels, 0: not measurable.
        nearest: (H, W) uint16, ``window_range`` of the exact disparity, units of 1/16 pixel.
        farthest: (H, W) uint16, likewise.
        second: (H, W) float32, ``second_match``, pixels, 0: none.
        classes: (H, W) uint8, row of ``class_table``.
        phases: (H, W) uint8, index of ``locking``.
        noise: (H, W) float32, error, of variance 1 in each class.
        outcome: (H, W) float32, rank in the class, 0 to 1: small ones are right, large ones holes.
        carried: (H, W) float32, ``_carried_factors``.
        locking: (17,) float32, ``_LOCKING_BY_PHASE``.
        class_table: (``CLASSES`` + 1, 8) float32, ``_class_table``.
        disparity: (H, W) uint16, output, units of 1/16 pixel.
        error: (H, W) uint8, output, units of the error image.
        confidence: (H, W) uint8, output, units of 1/255.
    """
    height, width = true_disparity.shape
    zero, one, half, largest = np.float32(0.0), np.float32(1.0), np.float32(0.5), np.float32(65535.0)
    noise_share = np.float32((1.0 - LOCKING**2 / 2.0) ** 0.5)
    for row in range(height):
        for column in range(width):
            entry, pixel_outcome = class_table[np.uint64(classes[row, column])], outcome[row, column]
            if classes[row, column] < PLAIN_CLASSES:
                pixel_outcome *= carried[row, column]
            if second[row, column] > zero:
                pixel_outcome += np.float32(REPEATED)
            pixel_noise = noise_share * noise[row, column] - locking[np.uint64(phases[row, column])]
            measured = true_disparity[row, column] * np.float32(16.0)
            deviation, pixel_confidence = entry[_SIGMA] * pixel_noise, entry[_CONFIDENCE]
            is_found = pixel_outcome < entry[_HOLE_FROM]
            if is_found & (pixel_outcome >= entry[_WRONG_FROM]):
                front, back = np.float32(nearest[row, column]), np.float32(farthest[row, column])
                is_behind = front >= measured + np.float32(EDGE_STEP)
                if is_behind or measured >= back + np.float32(EDGE_STEP):
                    measured, pixel_confidence = front if is_behind else back, entry[_NEIGHBOUR_CONFIDENCE]
                elif second[row, column] > zero:
                    measured = second[row, column] * np.float32(16.0)
                else:
                    deviation = entry[_MIN_WRONG] + entry[_WRONG_SPREAD] * abs(pixel_noise)
                    if pixel_noise < zero:
                        deviation = -deviation
            units = int(min(max(measured + deviation, one), largest) + half)
            # A match beyond `column` would lie left of the right image. No branches: a quarter of the time.
            is_valid = is_found & (measured > zero) & (units <= column * 16 + 8)
            disparity[row, column] = units if is_valid else 0
            error[row, column] = int(entry[_ERROR]) if is_valid else 0
            confidence[row, column] = int(pixel_confidence) if is_valid else 0
