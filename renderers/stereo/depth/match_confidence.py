"""Error and confidence of matches, from the images around them.

Each match has six ``FEATURES``. Two of them give its disparity error. Each has a weight for each of its bins; the
logistic function of the sum of the weights is the share of matches that are right (within 3 disparity errors).
Without ``MIN_TEXTURE``, it is at most ``MAX_CONFIDENCE_WITHOUT_TEXTURE``.
``match_confidence.json`` has errors and weights. ``python -m bench.sensor_confidence`` writes it.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.stereo.depth.downscale import grey_levels

FILE: Final = Path(__file__).with_suffix(".json")
BORDERS: Final = {
    "texture": (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0),
    "wide_texture": (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0),
    "residual": (0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5),
    "distinctness": (0.05, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0),
    "matched_share": (0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0),
    "disparity_range": (0.3, 0.6, 1.0, 1.5, 3.0, 6.0, 16.0),
}
"""Borders between the bins of each of the ``FEATURES``."""
FEATURES: Final = {
    "texture": "standard deviation of the horizontal gradient in the window, relative to the image noise",
    "wide_texture": "the same in the wide window: it guides semi-global matching where the window has no texture",
    "residual": "difference of both images in the window at the match, relative to the texture",
    "distinctness": "how much larger the difference is 3 pixels beside the match",
    "matched_share": "share of pixels with a match in the medium window",
    "disparity_range": "range of the disparities in the window, pixels",
}
"""Names of the features and their meanings, in the order of their planes."""
BINS: Final = len(BORDERS["texture"]) + 1
"""Number of bins of each feature."""
_BORDERS: Final = np.array([BORDERS[name] for name in FEATURES], np.float32)
"""(6, ``BINS`` - 1) float32."""
ERROR_FEATURES: Final = ("texture", "disparity_range")
"""Features that give the error."""
_FIRST, _SECOND = (list(FEATURES).index(name) for name in ERROR_FEATURES)
WEIGHT_UNIT: Final = 1.0 / 32.0
"""Unit of the weights. Sums of integers do not depend on the order, nor on the machine's rounding."""
_WINDOW, _MEDIUM_WINDOW, _WIDE_WINDOW = 9, 21, 41
"""Sides of the windows, pixels."""
_STEP: Final = 3
"""Distance from the match to the disparities with which it is compared, pixels."""
MIN_TEXTURE: Final = {"texture": 1.0, "wide_texture": 2.0}
"""Minimum texture of matches that can be right. With less, noise, or a surface beside it, may have made the match: dots
return too little light from there, or a mirror none.
"""
MAX_CONFIDENCE_WITHOUT_TEXTURE: Final = 0.45
"""Maximum confidence of matches with less. A third of them is right on average, often a whole wall or none of it."""
_TEXTURE, _WIDE_TEXTURE = (list(FEATURES).index(name) for name in MIN_TEXTURE)
_MIN_TEXTURE, _MIN_WIDE_TEXTURE = MIN_TEXTURE.values()
_MAX_SUM: Final = 255
"""Maximum absolute value of a sum of weights: confidences are between 0.0003 and 0.9997."""
_MAX_SUM_WITHOUT_TEXTURE: Final = int(
    np.log(MAX_CONFIDENCE_WITHOUT_TEXTURE / (1.0 - MAX_CONFIDENCE_WITHOUT_TEXTURE)) / WEIGHT_UNIT
)
_SUMS: Final = np.arange(-_MAX_SUM, _MAX_SUM + 1)
_CONFIDENCES: Final = np.floor(255.0 / (1.0 + np.exp(-_SUMS * WEIGHT_UNIT))).astype(np.uint8)
"""(2 ``_MAX_SUM`` + 1,) uint8, confidence of each sum of weights, units of 1/255."""


def match_features(
    left: NDArray[np.uint16], right: NDArray[np.uint16], disparity: NDArray[np.uint16], noise_sigma: float
) -> NDArray[np.float32]:
    """Return the ``FEATURES`` of each pixel, (6, H, W) float32; undefined where there is no match.

    Args:
        left: (H, W) uint16, rectified, units of 1/16 grey level.
        right: (H, W) uint16, likewise.
        disparity: (H, W) uint16, units of 1/16 pixel, 0: no match.
        noise_sigma: standard deviation of the image noise, grey levels, above 0.
    """
    gradient = np.asarray(cv2.Sobel(grey_levels(left), cv2.CV_16S, 1, 0, ksize=1))  # right minus left neighbour
    squared_gradient = np.square(gradient, dtype=np.int32)
    found = (disparity > 0).astype(np.uint8)
    differences = np.empty((4, *left.shape), np.int32)
    _compare(left, right, disparity, differences)
    box = np.ones((_WINDOW, _WINDOW), np.uint8)
    nearest = cv2.dilate(disparity, box)
    farthest = cv2.erode(np.where(disparity > 0, disparity, np.uint16(65535)), box)
    features = np.empty((len(FEATURES), *left.shape), np.float32)
    _write_features(
        _box_sum(gradient, _WINDOW), _box_sum(squared_gradient, _WINDOW), _box_sum(gradient, _WIDE_WINDOW),
        _box_sum(squared_gradient, _WIDE_WINDOW), _box_sum(found, _WINDOW), _box_sum(found, _MEDIUM_WINDOW),
        *(_box_sum(difference, _WINDOW) for difference in differences),
        np.asarray(nearest, np.uint16), np.asarray(farthest, np.uint16), float(noise_sigma), features,
    )  # fmt: skip
    return features


def error_and_confidence(
    features: NDArray[np.float32], disparity: NDArray[np.uint16]
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return error, units of 1/16 pixel, and confidence, units of 1/255, (H, W) uint8 each; 0 where there is no match.

    Args:
        features: (6, H, W) float32, ``match_features``.
        disparity: (H, W) uint16, 0: no match.
    """
    weights, errors = tables()
    error, confidence = np.empty(disparity.shape, np.uint8), np.empty(disparity.shape, np.uint8)
    _judge(features, disparity, _BORDERS, weights, errors, _CONFIDENCES, error, confidence)
    return error, confidence


@cache
def tables() -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """Return the tables of ``match_confidence.json``.

    Returns:
        (6, ``BINS``) int32, weights, units of ``WEIGHT_UNIT``; (``BINS``, ``BINS``) uint8, error by the bins of
        ``ERROR_FEATURES``, units of 1/16 pixel.
    """
    content: dict[str, Any] = json.loads(FILE.read_text("utf-8"))
    return np.array([content[name] for name in FEATURES], np.int32), np.array(content["error"], np.uint8)


def _box_sum(values: NDArray[Any], side: int) -> NDArray[np.int32]:
    """Return the sums over the box around each pixel, (H, W) int32. The image is mirrored at its borders."""
    return np.asarray(cv2.boxFilter(values, cv2.CV_32S, (side, side), normalize=False), np.int32)


@inlined
def _difference(left, right, column, units, width):
    """Return the difference of the left image at a column from the right image at a disparity, 1/16 level."""
    position = min(max(column * 16 - units, 0), (width - 1) * 16)
    whole, fraction = position >> 4, position & 15
    level = np.int32(right[whole]) * (16 - fraction) + np.int32(right[min(whole + 1, width - 1)]) * fraction
    return np.int32(left[column]) - np.int32((level + 8) >> 4)


@kernel("void(uint16[:,::1], uint16[:,::1], uint16[:,::1], int32[:,:,::1])")
def _compare(left, right, disparity, differences):
    """Write how both images differ at each match and beside it.

    Args:
        left: (H, W) uint16, units of 1/16 level.
        right: (H, W) uint16, likewise.
        disparity: (H, W) uint16, units of 1/16 pixel, 0: no match.
        differences: (4, H, W) int32, output: difference at the match, its square, and the squares at ``_STEP`` pixels
            less and more; 0 where there is no match.
    """
    height, width = left.shape
    for row in range(height):
        left_row, right_row = left[row], right[row]
        for column in range(width):
            units = np.int32(disparity[row, column])
            here, nearer, farther = np.int32(0), np.int32(0), np.int32(0)
            if units > 0:
                here = _difference(left_row, right_row, column, units, width)
                farther = _difference(left_row, right_row, column, units - 16 * _STEP, width)
                nearer = _difference(left_row, right_row, column, units + 16 * _STEP, width)
            differences[0, row, column] = here
            differences[1, row, column] = here * here
            differences[2, row, column] = farther * farther
            differences[3, row, column] = nearer * nearer


@inlined
def _texture(gradient_sum, square_sum, pixels, variance):
    """Return the standard deviation of the gradient beyond the noise, relative to the noise, from sums of a window."""
    mean = np.float32(gradient_sum) / pixels
    # The gradient is half the difference of two pixels: noise adds half its variance.
    excess = np.float32(0.25) * (np.float32(square_sum) / pixels - mean * mean) - np.float32(0.5) * variance
    return np.sqrt(max(excess, np.float32(0.0)) / variance)


@kernel(
    "void(int32[:,::1], int32[:,::1], int32[:,::1], int32[:,::1], int32[:,::1], int32[:,::1], int32[:,::1], "
    "int32[:,::1], int32[:,::1], int32[:,::1], uint16[:,::1], uint16[:,::1], float64, float32[:,:,::1])"
)
def _write_features(
    gradients, squares, wide_gradients, wide_squares, counts, medium_counts, differences, here, farther, nearer,
    nearest, farthest, noise_sigma, features,
):  # fmt: skip
    """Write the ``FEATURES`` from sums over windows, (H, W) int32 each, and the range of their disparities."""
    height, width = counts.shape
    sigma = np.float32(noise_sigma)
    variance, level = sigma * sigma, np.float32(1.0 / 16.0) / sigma  # 1/16 level relative to the noise
    for row in range(height):
        for column in range(width):
            texture = _texture(gradients[row, column], squares[row, column], np.float32(_WINDOW**2), variance)
            count = np.float32(max(counts[row, column], 1))
            mean, square = np.float32(differences[row, column]) / count, np.float32(here[row, column]) / count
            residual = level * np.sqrt(max(square - mean * mean, np.float32(0.0)))
            beside = np.float32(min(nearer[row, column], farther[row, column])) / count
            rise = level * (np.sqrt(beside) - np.sqrt(square))
            features[0, row, column] = texture
            features[1, row, column] = _texture(
                wide_gradients[row, column], wide_squares[row, column], np.float32(_WIDE_WINDOW**2), variance
            )
            features[2, row, column] = (residual + np.float32(0.25)) / (texture + np.float32(1.0))
            features[3, row, column] = rise / (residual + np.float32(1.0))
            features[4, row, column] = np.float32(medium_counts[row, column]) / np.float32(_MEDIUM_WINDOW**2)
            features[5, row, column] = np.float32(nearest[row, column] - farthest[row, column]) / np.float32(16.0)


@kernel(
    "void(float32[:,:,::1], uint16[:,::1], float32[:,::1], int32[:,::1], uint8[:,::1], uint8[::1], uint8[:,::1], "
    "uint8[:,::1])"
)
def _judge(features, disparity, borders, weights, errors, confidences, error, confidence):
    """Write error and confidence of each match; arguments as of ``error_and_confidence``, and ``tables``."""
    height, width = disparity.shape
    bins = np.zeros(len(weights), np.int64)
    for row in range(height):
        for column in range(width):
            if disparity[row, column] == 0:
                error[row, column], confidence[row, column] = 0, 0
                continue
            total = np.int32(0)
            for index in range(len(weights)):
                value, bin_index = features[index, row, column], np.int64(0)
                for border in range(BINS - 1):
                    bin_index += np.int64(value >= borders[index, border])
                bins[index] = bin_index
                total += weights[index, bin_index]
            error[row, column] = errors[bins[_FIRST], bins[_SECOND]]
            texture, wide_texture = features[_TEXTURE, row, column], features[_WIDE_TEXTURE, row, column]
            if texture < np.float32(_MIN_TEXTURE) or wide_texture < np.float32(_MIN_WIDE_TEXTURE):
                total = min(total, np.int32(_MAX_SUM_WITHOUT_TEXTURE))
            confidence[row, column] = confidences[min(max(total + np.int32(_MAX_SUM), 0), 2 * _MAX_SUM)]
