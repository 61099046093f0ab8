"""Error model of the disparity: turns exact disparities into those that a window matcher would measure.

The device's manual defines the disparity error (d_eps) as the standard deviation of the measured disparity, and the
confidence as the probability that the measured disparity is within 3 disparity errors of the true one. Each pixel of
the left image has a class: its texture, the agreement of both images at the exact disparity, and edges in its window
(``pixel_classes``). For each class ``matcher_statistics`` has the share of pixels with a match, and the share of right
matches among these. A match is right if it is within 3 disparity errors. The outcome of each pixel follows from them:

* Hole: no match, as on surfaces without texture, in highlights and on translucent surfaces.
* Right: a Gaussian error that changes little from pixel to pixel. It is larger where there is little texture.
* Wrong, at an edge: the disparity of the other side, which makes outlines ragged. Pixels beside a nearer surface that
  the right camera does not see may get the disparity of that surface. Foreground objects are therefore too wide by a
  part of the matching window.
* Wrong, elsewhere: off by more than 3 disparity errors.

Holes and wrong pixels form blobs, because smooth noise selects them. The confidence is the share of right pixels among
those that the device cannot tell apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.pending import wait_until_compiled
from renderers.stereo import matcher_statistics as statistics
from renderers.stereo.depth_images import DepthImages
from renderers.stereo.matcher_statistics import WRONG_SPREAD
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.noise import NoiseStream, frame_key
from renderers.stereo.pixel_classes import CLASSES, EDGE_STEP, ImageKind, classify, window_range
from renderers.stereo.smooth_noise import smooth_noise

ERROR_TOLERANCE: Final = 0.05
"""Maximum relative difference between a pixel's error and the value in the error image."""
OUTCOME_BOX: Final = 8
"""Box of the noise that selects holes and wrong pixels (``smooth_noise``), pixels: our choice, a little more than a
matching window."""
_HIDDEN_CLASS: Final = CLASSES
"""Class of pixels without a measurable disparity. Next to a nearer surface they may get its disparity."""
_WRONG_FROM, _HOLE_FROM, _NEAR_SIGMA, _WIDE_SIGMA, _MIN_WRONG, _ERROR, _CONFIDENCE, _NEIGHBOUR_CONFIDENCE = range(8)
"""Columns of the class table (``_class_table``)."""


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """Parameters of the errors of one frame."""

    sigma: float
    """Standard deviation of the disparity on good texture, rounding included, pixels; above 0."""
    noise_sigma: float
    """Standard deviation of the image noise, grey levels, above 0."""
    seed: int
    """Seed of the random numbers."""
    kind: ImageKind
    """Kind of the images."""
    frame: int
    """Number of the frame; with ``seed`` it selects the random numbers."""
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


def exact_images(true_disparity: NDArray[np.float32]) -> DepthImages:
    """Return depth images with rounding to 1/16 pixel as the only error: the error is 1 unit, the confidence 1.

    Args:
        true_disparity: (H, W) float32, exact disparity in pixels, 0: not measurable.
    """
    disparity = _sixteenths(true_disparity)
    valid = disparity > 0
    return DepthImages(disparity, valid.astype(np.uint8), np.where(valid, np.uint8(255), np.uint8(0)))


def measured_images(
    true_disparity: NDArray[np.float32], left: NDArray[np.uint8], right: NDArray[np.uint8], model: ErrorModel
) -> DepthImages:
    """Return the depth images that a camera measures with the errors of this model.

    Args:
        true_disparity: (H, W) float32, exact disparity in pixels, 0: not measurable.
        left: (H, W) uint8, left image.
        right: (H, W) uint8, right image.
        model: parameters of the errors.
    """
    wait_until_compiled("stereo")
    height, width = true_disparity.shape
    exact = _sixteenths(true_disparity)
    nearest, farthest = window_range(exact)
    classes = classify(left, right, exact, nearest, farthest, model.noise_sigma)
    classes[exact == 0] = _HIDDEN_CLASS
    noise_images = [
        smooth_noise(height, width, box, frame_key(model.seed, model.frame, stream))
        for box, stream in (
            (statistics.NEAR_BOX, NoiseStream.DISPARITY),
            (statistics.WIDE_BOX, NoiseStream.DISPARITY_WIDE),
            (OUTCOME_BOX, NoiseStream.OUTCOME),
        )
    ]
    images = DepthImages(
        np.empty((height, width), np.uint16),
        np.empty((height, width), np.uint8),
        np.empty((height, width), np.uint8),
        model.error_scale,
    )
    _write_measured(
        true_disparity, nearest, farthest, classes, *noise_images, _class_table(model), images.disparity, images.error,
        images.confidence,
    )  # fmt: skip
    return images


def _sixteenths(disparity: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return disparities in units of 1/16 pixel, (H, W) uint16; 0 stays 0, and others are at least 1."""
    units = np.floor(np.clip(disparity * np.float32(16.0), 1.0, 65535.0) + np.float32(0.5))
    return np.where(disparity > 0.0, units, np.float32(0.0)).astype(np.uint16)


def _class_table(model: ErrorModel) -> NDArray[np.float32]:
    """Return (``CLASSES`` + 1, 8) float32, a row for each class, the last one for ``_HIDDEN_CLASS``.

    Columns:

    * ``_WRONG_FROM``, ``_HOLE_FROM``: outcome noise from which a pixel is wrong, and from which it is a hole.
    * ``_NEAR_SIGMA``, ``_WIDE_SIGMA``: standard deviations of the two parts of the Gaussian error, which are correlated
      over a small and a large distance, units of 1/16 pixel.
    * ``_MIN_WRONG``: minimum error of a wrong pixel away from edges, units of 1/16 pixel.
    * ``_ERROR``: disparity error, units of the error image.
    * ``_CONFIDENCE``, ``_NEIGHBOUR_CONFIDENCE``: confidence of a pixel with the disparity of its own surface, and with
      that of the other side of an edge, units of 1/255.
    """
    found = np.append(statistics.FOUND[model.kind], statistics.HIDDEN_FOUND[model.kind])
    right = np.append(statistics.RIGHT[model.kind], 0.0)
    sigma = model.sigma * np.append(statistics.RELATIVE_ERROR[model.kind], 1.0)
    units = np.clip(np.rint(sigma / model.error_scale), 1, 255)
    # Rounding to 1/16 pixel is uniform noise of variance 1/12 unit; the Gaussian part makes up the rest.
    gaussian = np.sqrt(np.maximum((sigma / DISPARITY_SCALE) ** 2 - 1.0 / 12.0, 1e-12))
    own = np.append(statistics.CONFIDENCE[model.kind], 0.0)
    neighbours = np.append(statistics.NEIGHBOUR_CONFIDENCE[model.kind], statistics.HIDDEN_CONFIDENCE[model.kind])
    normal = NormalDist()
    thresholds = [[normal.inv_cdf(min(max(p, 1e-6), 1 - 1e-6)) for p in shares] for shares in (found * right, found)]
    near, wide = (1.0 - statistics.WIDE_SHARE) ** 0.5, statistics.WIDE_SHARE**0.5
    wrong = 3.0 * units * model.error_scale / DISPARITY_SCALE + 1.1  # 1.1: rounding must not make it a right one
    confidences = np.floor(np.stack((own, neighbours)) * 255.0)
    columns = (*thresholds, near * gaussian, wide * gaussian, wrong, units, *confidences)
    return np.ascontiguousarray(np.stack(columns, axis=1), np.float32)


@kernel(
    "void(float32[:,::1], uint16[:,::1], uint16[:,::1], uint8[:,::1], float32[:,::1], float32[:,::1], "
    "float32[:,::1], float32[:,::1], uint16[:,::1], uint8[:,::1], uint8[:,::1])"
)
def _write_measured(
    true_disparity, nearest, farthest, classes, near_noise, wide_noise, outcome_noise, class_table, disparity, error,
    confidence,
):  # fmt: skip
    """Write the measured disparity with its error and confidence.

    Args:
        true_disparity: (H, W) float32, pixels, 0: not measurable.
        nearest: (H, W) uint16, ``window_range`` of the exact disparity, units of 1/16 pixel.
        farthest: (H, W) uint16, likewise.
        classes: (H, W) uint8, row of ``class_table``.
        near_noise: (H, W) float32, of variance 1.
        wide_noise: (H, W) float32, of variance 1.
        outcome_noise: (H, W) float32, of variance 1; small values make right pixels, large ones holes.
        class_table: (``CLASSES`` + 1, 8) float32, ``_class_table``.
        disparity: (H, W) uint16, output, units of 1/16 pixel.
        error: (H, W) uint8, output, units of the error image.
        confidence: (H, W) uint8, output, units of 1/255.
    """
    height, width = true_disparity.shape
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    for row in range(height):
        for column in range(width):
            entry = class_table[classes[row, column]]
            outcome, noise = outcome_noise[row, column], near_noise[row, column]
            units, error_units, confidence_units = 0, np.float32(0.0), np.float32(0.0)
            if outcome < entry[_HOLE_FROM]:
                measured = true_disparity[row, column] * np.float32(16.0)
                deviation = entry[_NEAR_SIGMA] * noise + entry[_WIDE_SIGMA] * wide_noise[row, column]
                error_units, confidence_units = entry[_ERROR], entry[_CONFIDENCE]
                if outcome >= entry[_WRONG_FROM]:
                    front, back = np.float32(nearest[row, column]), np.float32(farthest[row, column])
                    is_behind = front >= measured + np.float32(EDGE_STEP)
                    if is_behind or measured >= back + np.float32(EDGE_STEP):
                        measured = front if is_behind else back
                        confidence_units = entry[_NEIGHBOUR_CONFIDENCE]
                    else:
                        deviation = entry[_MIN_WRONG] + np.float32(WRONG_SPREAD) * abs(noise)
                        if noise < zero:
                            deviation = -deviation
                if measured > zero:
                    units = int(min(max(measured + deviation, one), np.float32(65535.0)) + half)
                if units > column * 16 + 8:
                    units = 0  # the match would lie beyond the left edge of the right image
            disparity[row, column] = units
            error[row, column] = int(error_units) if units > 0 else 0
            confidence[row, column] = int(confidence_units) if units > 0 else 0
