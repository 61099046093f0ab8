"""Error and confidence of matches, from the images around them.

Each match has the ``FEATURES``. Three of them give its disparity error. Small decision trees give its confidence, the
probability that it is right (within 3 disparity errors): a tree compares five features with borders, the results are
the bits of the index of a weight, and the sum of all trees' weights gives the confidence by the logistic function.
``match_confidence.json`` has errors and trees. ``python -m tools.calibration.confidence`` writes it.
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F32, F64, I64, Array1, Array2, Array3, Number, f32, i32, i64, u8
from renderers.stereo.depth.residual_shift import without_local_mean

FILE: Final = Path(__file__).with_suffix(".json")
FEATURES: Final = {
    "min_texture": "least texture of the small windows nearby: an edge alone may be that of another surface",
    "texture": "texture of the window",
    "wide_texture": "texture of the wide window: it guides semi-global matching where the window has none",
    "residual": "difference of both images in the window at the match, relative to the gradients, without local means",
    "distinctness": "how much more both images differ 2 pixels beside the match, relative to the difference at it",
    "matched_share": "share of pixels with a match in the medium window",
    "disparity_range": "range of the disparities in the window, pixels",
    "step": "share of the gradients in the window that add up: 1 for one edge, as of a silhouette, 0 for texture",
    "small_residual": "residual in 3 x 3 pixels; beside an edge, these are of one surface",
    "nearer_right": "largest disparity up to 8 pixels to the right minus that of the match, pixels: what is left of a "
    "nearer surface may be hidden from the right camera",
    "nearer_left": "the same to the left",
    "even_texture": "wide_texture without the excess of strong gradients: high where texture covers the window",
}
"""Names of the features and their meanings, in the order of their planes. Texture is the root mean square of the
horizontal gradient beyond the image noise, relative to it."""
ERROR_BORDERS: Final = {
    "residual": (0.2, 0.3, 0.4, 0.6, 0.9),
    "distinctness": (0.7, 1.7, 3.0, 4.5, 7.0),
    "disparity_range": (0.3, 0.6, 1.0, 1.2, 1.6),
}
"""Borders between the bins of the features that give the error: about the quantiles of right matches."""
TREE_DEPTH: Final = 5
"""Number of comparisons of a tree."""
WEIGHT_UNIT: Final = 1.0 / 32.0
"""Unit of the weights. Sums of integers do not depend on the order, nor on the machine's rounding."""
MIN_TEXTURE: Final = {"texture": 1.0, "wide_texture": 2.0}
"""Minimum texture of matches. With less, noise, or a surface beside it, may have made the match:
dots return too little light from there, or a mirror none.
"""
EVEN_NOISE: Final = 0.3
"""Standard deviation of the noise in the images of ``with_even_noise``, grey levels. Of textures that are fainter than
twice this, most matches are wrong also where the noise is less."""
_FULL_BLUR: Final = 3
"""Side of the box over which images of the cameras' size are averaged before their texture is measured, pixels. Their
pixels have twice the noise of those at ``High``, and half the gradients."""
_FULL_BLUR_NOISE: Final = (2.0 / _FULL_BLUR**3) ** 0.5
"""Noise of the gradient of such means, relative to that of the image's."""
_TINY_WINDOW, _SMALL_WINDOW, _WINDOW, _MEDIUM_WINDOW, _WIDE_WINDOW = 3, 5, 9, 21, 41
"""Sides of the windows, pixels."""
_NEARBY: Final = 7
"""Side of the window around a match in which the centres of the small windows of ``min_texture`` lie, pixels."""
_MAX_SQUARE: Final = (2**31 - 1) // _WIDE_WINDOW**2
"""Limit of squared gradients, squared units of 1/32 level: their sum over the wide window fits into 32 bits."""
_EVEN_LIMIT: Final = 4.0
"""Limit of squared gradients in ``even_texture``, relative to the variance of the image noise."""
_WHITE: Final = 255 * 16
"""White, units of 1/16 grey level."""
_STEP: Final = 2
"""Distance from the match to the disparities with which it is compared, pixels."""
_FIRST, _SECOND, _THIRD = (list(FEATURES).index(name) for name in ERROR_BORDERS)
_ERROR_BORDERS: Final = np.array(list(ERROR_BORDERS.values()), np.float32)
"""(3, 5) float32."""
_MAX_SUM: Final = 255
"""Maximum absolute value of a sum of weights: confidences are between 0.002 and 0.998."""
_SUMS: Final = np.arange(-_MAX_SUM, _MAX_SUM + 1)
_CAUTION: Final = 0.8
"""Factor of the sums of weights. Confidences of scenes beyond those of the fit are too high above 0.7 without it."""
_PRIOR: Final = np.array(((0.1,), (0.47,)))
"""Logarithm of odds to add at reduced and at full size: with the same features, matches of photographs are right more
often than those of the fit's scenes."""
_CONFIDENCES: Final = np.floor(255.0 / (1.0 + np.exp(-_SUMS * WEIGHT_UNIT * _CAUTION - _PRIOR))).astype(np.uint8)
"""(2, 2 ``_MAX_SUM`` + 1) uint8, confidence of each sum of weights at reduced and at full size, units of 1/255."""


@dataclass(frozen=True, slots=True, eq=False)
class Tables:
    """Content of ``match_confidence.json``."""

    error: NDArray[np.uint8]
    """(6, 6, 6) uint8, disparity error by the bins of ``ERROR_BORDERS``, units of 1/16 pixel."""
    features: NDArray[np.int64]
    """(T, ``TREE_DEPTH``) int64, numbers of the features that a tree compares, first the one of the highest bit."""
    borders: NDArray[np.float32]
    """(T, ``TREE_DEPTH``) float32, borders with which they are compared. The bit of a feature from its border is 1."""
    weights: NDArray[np.int32]
    """(T, 2 ** ``TREE_DEPTH``) int32, units of ``WEIGHT_UNIT``."""


@cache
def tables() -> Tables:
    """Return the content of ``match_confidence.json``."""
    content: dict[str, Any] = json.loads(FILE.read_text("utf-8"))
    names, comparisons = list(FEATURES), [tree["compare"] for tree in content["trees"]]
    return Tables(
        np.array(content["error"], np.uint8),
        np.array([[names.index(name) for name, _ in tree] for tree in comparisons], np.int64),
        np.array([[border for _, border in tree] for tree in comparisons], np.float32),
        np.array([tree["weights"] for tree in content["trees"]], np.int32),
    )


def with_even_noise(image: NDArray[np.uint16], noise_sigma: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Return an image with contrast reduced at grey levels of more noise than ``EVEN_NOISE``, so that it has as much.

    Noise depends on the grey level. With that of mid grey everywhere, dark floors lost right matches.
    """
    contrast = EVEN_NOISE / np.maximum(noise_sigma, EVEN_NOISE)
    levels = np.interp(np.arange(_WHITE + 1) / 16.0, np.arange(256), contrast).cumsum().astype(np.uint16)
    return levels[image]


def match_features(
    left: NDArray[np.uint16], right: NDArray[np.uint16], disparity: NDArray[np.uint16], divisor: int
) -> NDArray[np.float32]:
    """Return the ``FEATURES`` of each pixel, (12, H, W) float32; undefined where there is no match.

    Args:
        left, right: ``with_even_noise``.
    """
    texture, texture_sigma = left, EVEN_NOISE
    if divisor == 1:
        texture = np.asarray(cv2.blur(left, (_FULL_BLUR, _FULL_BLUR)), np.uint16)
        texture_sigma *= _FULL_BLUR_NOISE
    gradient, size = np.empty((2, *left.shape), np.int16)
    squared, even = np.empty((2, *left.shape), np.int32)
    even_limit = int(min(_EVEN_LIMIT * (32.0 * texture_sigma) ** 2, _MAX_SQUARE))
    _gradients(texture, even_limit, gradient, size, squared, even)
    differences = np.empty((3, *left.shape), np.int32)
    _compare(without_local_mean(left), without_local_mean(right), disparity, differences)
    box, row = np.ones((_WINDOW, _WINDOW), np.uint8), np.ones((_SMALL_WINDOW, _WINDOW), np.uint8)
    nearest_right, nearest_left = (cv2.dilate(disparity, row, anchor=(x, _SMALL_WINDOW // 2)) for x in (0, _WINDOW - 1))
    farthest = cv2.erode(np.where(disparity > 0, disparity, np.uint16(65535)), box)
    small_squares = _box_sum(squared, _SMALL_WINDOW).astype(np.float32)
    features = np.empty((len(FEATURES), *left.shape), np.float32)
    _write_features(
        np.asarray(cv2.erode(small_squares, np.ones((_NEARBY, _NEARBY), np.uint8)), np.float32),
        _box_sum(squared, _WINDOW), _box_sum(squared, _WIDE_WINDOW), _box_sum(even, _WIDE_WINDOW),
        _box_sum((disparity > 0).astype(np.uint8), _MEDIUM_WINDOW),
        _box_sum(differences[0], _WINDOW), _box_sum(differences[1], _WINDOW), _box_sum(differences[2], _WINDOW),
        _box_sum(gradient, _WINDOW), _box_sum(size, _WINDOW),
        _box_sum(differences[0], _TINY_WINDOW), _box_sum(size, _TINY_WINDOW), disparity,
        np.asarray(cv2.dilate(disparity, box), np.uint16), np.asarray(nearest_right, np.uint16),
        np.asarray(nearest_left, np.uint16), np.asarray(farthest, np.uint16), texture_sigma, features,
    )  # fmt: skip
    return features


def with_texture(disparity: NDArray[np.uint16], features: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return the matches that have texture around them, (H, W) uint16, 0 elsewhere.

    Without texture, matches are those of the surfaces beside them, right on a whole wall or on none of it.
    """
    names = list(FEATURES)
    has_texture = np.logical_and(*(features[names.index(name)] >= least for name, least in MIN_TEXTURE.items()))
    return np.where(has_texture, disparity, np.uint16(0))


def error_and_confidence(
    features: NDArray[np.float32], disparity: NDArray[np.uint16], divisor: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return error, 1/16 pixel, and confidence, 1/255, (H, W) uint8 each; 0 where there is no match."""
    content, table = tables(), _CONFIDENCES[int(divisor == 1)]
    error, confidence = np.empty(disparity.shape, np.uint8), np.empty(disparity.shape, np.uint8)
    _write_error(features, disparity, _ERROR_BORDERS, content.error, error)
    _write_confidence(features, disparity, content.features, content.borders, content.weights, table, confidence)
    return error, confidence


def _box_sum(values: NDArray[Any], side: int) -> NDArray[np.int32]:
    """Return the sums over the box around each pixel, (H, W) int32. The image is mirrored at its borders."""
    return np.asarray(cv2.boxFilter(values, cv2.CV_32S, (side, side), normalize=False), np.int32)


@inlined
def _difference(left: Array1[np.uint16], right: Array1[np.uint16], column: I64, units: I64, width: I64) -> I64:
    """Return the difference of the left image at a column from the right image at a disparity, 1/16 level.

    It is at most white, so that sums of its squares over a window fit into 32 bits.
    """
    position = min(max(column * 16 - units, 0), (width - 1) * 16)
    whole, fraction = position >> 4, position & 15
    level = i32(right[whole]) * (16 - fraction) + i32(right[min(whole + 1, width - 1)]) * fraction
    difference = i32(left[column]) - i32((level + 8) >> 4)
    return min(max(difference, i32(-_WHITE)), i32(_WHITE))


@kernel
def _gradients(
    left: Array2[np.uint16],
    even_limit: I64,
    gradient: Array2[np.int16],
    size: Array2[np.int16],
    squared: Array2[np.int32],
    even: Array2[np.int32],
) -> None:
    """Write the differences of each pixel's right and left neighbours, 0 in the first and the last column, 1/16 level.

    ``size`` is their absolute value, ``squared`` their square, at most ``_MAX_SQUARE``, ``even`` the same, at most
    ``even_limit``.
    """
    height, width = left.shape
    for row in range(height):
        levels = left[row]
        for column in range(width):
            inside = 0 < column < width - 1
            value = i32(levels[column + 1]) - i32(levels[column - 1]) if inside else i32(0)
            gradient[row, column], size[row, column] = value, abs(value)
            square = min(value * value, i32(_MAX_SQUARE))
            squared[row, column], even[row, column] = square, min(square, i32(even_limit))


@kernel
def _compare(
    left: Array2[np.uint16], right: Array2[np.uint16], disparity: Array2[np.uint16], differences: Array3[np.int32]
) -> None:
    """Write the squared differences of both images, ``without_local_mean``, at each match and beside it; 0: no match.

    ``differences`` is (3, H, W): at the match, and at ``_STEP`` pixels less and more.
    """
    height, width = left.shape
    for row in range(height):
        left_row, right_row = left[row], right[row]
        for column in range(width):
            units = i32(disparity[row, column])
            here, nearer, farther = i32(0), i32(0), i32(0)
            if units > 0:
                here = _difference(left_row, right_row, column, units, width)
                farther = _difference(left_row, right_row, column, units - 16 * _STEP, width)
                nearer = _difference(left_row, right_row, column, units + 16 * _STEP, width)
            differences[0, row, column] = here * here
            differences[1, row, column] = farther * farther
            differences[2, row, column] = nearer * nearer


@inlined
def _texture(square_sum: Number, scale: F32) -> F32:
    """Return the root mean square of the gradient beyond the noise, relative to the noise, from a sum of squares."""
    # The gradient is half the difference of two pixels: noise adds half its variance.
    return np.sqrt(max(f32(square_sum) * scale - f32(0.5), f32(0.0)))


@kernel
def _write_features(
    least_squares: Array2[np.float32],
    squares: Array2[np.int32],
    wide_squares: Array2[np.int32],
    even_squares: Array2[np.int32],
    medium_counts: Array2[np.int32],
    here: Array2[np.int32],
    farther: Array2[np.int32],
    nearer: Array2[np.int32],
    gradients: Array2[np.int32],
    sizes: Array2[np.int32],
    tiny_here: Array2[np.int32],
    tiny_sizes: Array2[np.int32],
    disparity: Array2[np.uint16],
    nearest: Array2[np.uint16],
    nearest_right: Array2[np.uint16],
    nearest_left: Array2[np.uint16],
    farthest: Array2[np.uint16],
    texture_sigma: F64,
    features: Array3[np.float32],
) -> None:
    """Write the ``FEATURES`` from sums over windows, (H, W) each, and the range of their disparities.

    Gradients have the noise of an image with ``texture_sigma``, grey levels.
    """
    height, width = medium_counts.shape
    # Roots of the sums of squares over a window, 1/16 level.
    noise, texture_noise = f32(16 * _WINDOW) * f32(EVEN_NOISE), f32(16 * _WINDOW) * f32(texture_sigma)
    tiny_noise = f32(16 * _TINY_WINDOW) * f32(EVEN_NOISE)
    window, tiny_window, medium_pixels = f32(2 * _WINDOW), f32(2 * _TINY_WINDOW), f32(_MEDIUM_WINDOW**2)
    # Squared gradients, in squared units of 1/32 level, relative to the variance of the noise.
    scale = f32(1.0 / (32.0 * texture_sigma) ** 2)
    small_scale, window_scale = scale / f32(_SMALL_WINDOW**2), scale / f32(_WINDOW**2)
    wide_scale = scale / f32(_WIDE_WINDOW**2)
    for row in range(height):
        for column in range(width):
            features[0, row, column] = _texture(least_squares[row, column], small_scale)
            features[1, row, column] = _texture(squares[row, column], window_scale)
            features[2, row, column] = _texture(wide_squares[row, column], wide_scale)
            difference, size = np.sqrt(f32(here[row, column])), f32(sizes[row, column])
            beside = np.sqrt(f32(min(nearer[row, column], farther[row, column])))
            # The mean gradient is size / (2 pixels), the root mean square difference is 2 difference / window.
            features[3, row, column] = difference * window / (size + window * noise)
            features[4, row, column] = (beside - difference) / (difference + noise)
            features[5, row, column] = f32(medium_counts[row, column]) / medium_pixels
            features[6, row, column] = f32(nearest[row, column] - farthest[row, column]) / f32(16.0)
            features[7, row, column] = f32(abs(gradients[row, column])) / (size + f32(0.3) * window * texture_noise)
            difference, size = np.sqrt(f32(tiny_here[row, column])), f32(tiny_sizes[row, column])
            features[8, row, column] = difference * tiny_window / (size + tiny_window * tiny_noise)
            units = i32(disparity[row, column])
            features[9, row, column] = f32(i32(nearest_right[row, column]) - units) / f32(16.0)
            features[10, row, column] = f32(i32(nearest_left[row, column]) - units) / f32(16.0)
            features[11, row, column] = _texture(even_squares[row, column], wide_scale)


@kernel
def _write_error(
    features: Array3[np.float32],
    disparity: Array2[np.uint16],
    borders: Array2[np.float32],
    errors: Array3[np.uint8],
    error: Array2[np.uint8],
) -> None:
    """Write the error of each match, 0 elsewhere.

    Args:
        borders: (3, 5), borders between the bins.
        errors: (6, 6, 6), error by the three bins.
    """
    height, width = disparity.shape
    for row in range(height):
        for column in range(width):
            first, second, third = i64(0), i64(0), i64(0)
            for border in range(borders.shape[1]):
                first += i64(features[_FIRST, row, column] >= borders[0, border])
                second += i64(features[_SECOND, row, column] >= borders[1, border])
                third += i64(features[_THIRD, row, column] >= borders[2, border])
            error[row, column] = errors[first, second, third] if disparity[row, column] > 0 else u8(0)


@kernel
def _write_confidence(
    features: Array3[np.float32],
    disparity: Array2[np.uint16],
    tree_features: Array2[np.int64],
    tree_borders: Array2[np.float32],
    weights: Array2[np.int32],
    confidences: Array1[np.uint8],
    confidence: Array2[np.uint8],
) -> None:
    """Write the confidence of each match, 0 elsewhere, by the trees of ``Tables``.

    ``confidences`` is that of each sum of weights, (2 ``_MAX_SUM`` + 1,).
    """
    height, width = disparity.shape
    total, leaf = np.empty(width, np.int32), np.empty(width, np.int32)
    for row in range(height):
        total[:] = 0
        for tree in range(len(weights)):
            leaf[:] = 0
            for level in range(TREE_DEPTH):
                values, border = features[tree_features[tree, level], row], tree_borders[tree, level]
                for column in range(width):
                    leaf[column] = (leaf[column] << 1) | i32(values[column] >= border)
            for column in range(width):
                total[column] += weights[tree, leaf[column]]
        for column in range(width):
            value = confidences[min(max(total[column], -_MAX_SUM), _MAX_SUM) + _MAX_SUM]
            confidence[row, column] = value if disparity[row, column] > 0 else u8(0)
