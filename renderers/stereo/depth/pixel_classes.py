"""Classes of pixels by how well a window matcher can measure them.

``classify`` finds the class of each pixel: texture, agreement of the images, nearby edges. ``second_match`` finds
repeated texture. ``matcher_statistics.json`` has the results of our matcher in each class. ``python -m
bench.sensor_fit`` writes it.
"""

from __future__ import annotations

import json
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel


class ImageKind(IntEnum):
    """Kinds of images that have statistics of their own; the value is the index of their tables."""

    PLAIN = 0
    DOTS = 1
    """With the projector's dots."""
    REALISTIC = 2
    """With lens, sensor and light of ``realism``, or recorded."""
    REALISTIC_DOTS = 3

    @staticmethod
    def of(*, dots: bool, realistic: bool) -> ImageKind:
        """Return the kind of images with or without dots and realism."""
        return ImageKind(int(dots) + 2 * int(realistic))


MIN_NOISE_SIGMA: Final = 0.3
"""Minimum standard deviation of the image noise, grey levels: images without noise still have rounding errors."""
RADIUS: Final = 2
"""Pixels on each side of a window's centre: a window has 5 x 5 pixels."""
_WINDOW: Final = 2 * RADIUS + 1
"""Side of a window, pixels."""
TEXTURE_STEPS: Final = (0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0)
"""Borders between classes of texture: standard deviation of the horizontal gradient in the window, divided by that of
the image noise. Smooth shading has a constant gradient, so it does not count as texture."""
DISAGREEMENT_STEPS: Final = (0.1, 0.3, 0.5, 0.8, 1.5)
"""Borders between classes of disagreement: difference of the two windows beyond the noise, divided by the texture."""
EDGES: Final = 3
"""Number of classes of edges: 0 none, 1 the pixel is in front of another one in its window, 2 it is behind one."""
EDGE_STEP: Final = 32
"""Minimum step of the disparity within a window that counts as an edge, units of 1/16 pixel."""
TEXTURES: Final = len(TEXTURE_STEPS) + 1
"""Number of classes of texture."""
DISAGREEMENTS: Final = len(DISAGREEMENT_STEPS) + 1
"""Number of classes of disagreement."""
CLASSES: Final = TEXTURES * DISAGREEMENTS * EDGES
"""Number of classes. ``class = (texture * DISAGREEMENTS + disagreement) * EDGES + edge``."""
STATISTICS_FILE: Final = Path(__file__).with_name("matcher_statistics.json")
STATISTICS: Final = {
    "found": "share of pixels that have a match, by class at the exact disparity",
    "right": "share of these matches within 3 disparity errors of the exact disparity",
    "confidence": "share of right pixels among all that look like a right one of the class",
    "neighbour_confidence": "the same for pixels with the disparity of the other side of an edge",
    "relative_error": "standard deviation of right matches, relative to that on good texture",
}
"""Names and meanings of the statistics of a class."""
HIDDEN_CLASS: Final = CLASSES
"""Class of pixels without a measurable disparity, the last one of the statistics. Next to a nearer surface they may get
its disparity: ``found`` is the share of those that do, ``neighbour_confidence`` the share of right ones among all with
the disparity of the front side of an edge."""
SECOND_SCALE: Final = 4
"""Images are compared at 1/4 of their resolution for second matches: finer patterns than 8 pixels do not count."""
SECOND_STEPS: Final = 2
"""Steps of the disparity of a second match per pixel at that resolution."""
SECOND_MIN_DISTANCE: Final = 3.0
"""Minimum difference of a second match from the exact disparity, pixels at that resolution."""
SECOND_MAX_COST: Final = 0.4
"""Maximum difference of the windows of a second match, relative to the contrast of the window. Random textures reach
0.7, a chequerboard 0.1 to 0.3."""
SECOND_MIN_CONTRAST: Final = 4.0
"""Minimum contrast of a window along its rows, grey levels: without contrast, nothing is repeated."""
_CANDIDATE_BITS: Final = 12
"""Bits of a candidate's number. A match is stored as the sum of its differences above these bits."""
_TEXTURE_STEPS: Final = np.array(TEXTURE_STEPS, np.float32)
_DISAGREEMENT_STEPS: Final = np.array(DISAGREEMENT_STEPS, np.float32)


@cache
def _content() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(STATISTICS_FILE.read_text("utf-8"))
    return content


def wrong_spread() -> float:
    """Return the spread of wrong matches beyond 3 disparity errors, units of 1/16 pixel."""
    return float(_content()["wrong_spread"])


@cache
def statistics(kind: ImageKind) -> dict[str, NDArray[np.float64]]:
    """Return the ``STATISTICS`` of a kind of images, (``CLASSES`` + 1,) float64 each."""
    return {name: np.array(_content()[kind.name][name]) for name in STATISTICS}


def window_range(disparity: NDArray[np.uint16]) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return the largest and the smallest known disparity in each pixel's window, (H, W) uint16 each.

    Args:
        disparity: (H, W) uint16, 0: unknown. In a window without a known disparity, the largest is 0 and the smallest
            65535.
    """
    window = np.ones((_WINDOW, _WINDOW), np.uint8)
    known = disparity - (disparity == 0)  # 65535 where unknown
    return np.asarray(cv2.dilate(disparity, window), np.uint16), np.asarray(cv2.erode(known, window), np.uint16)


def classify(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    disparity: NDArray[np.uint16],
    nearest: NDArray[np.uint16],
    farthest: NDArray[np.uint16],
    noise_sigma: float,
) -> NDArray[np.uint8]:
    """Return the class of each pixel, (H, W) uint8 below ``CLASSES``.

    Args:
        left: (H, W) uint8, rectified.
        right: (H, W) uint8, rectified.
        disparity: (H, W) uint16, units of 1/16 pixel, 0: unknown; a pixel is compared with the right image at
            this disparity.
        nearest: (H, W) uint16, ``window_range`` of ``disparity``.
        farthest: (H, W) uint16, likewise.
        noise_sigma: standard deviation of the image noise, grey levels, above 0.
    """
    classes = np.empty(left.shape, np.uint8)
    _classify(
        left, right, disparity, nearest, farthest, float(noise_sigma), _TEXTURE_STEPS, _DISAGREEMENT_STEPS, classes
    )
    return classes


@inlined
def _add_row(sums, gradient, difference, count, sign):
    """Add or subtract a row of the rings to the sums down the columns.

    Args:
        sums: (4, W + 2 ``RADIUS``) int32: of gradients, of their squares, of differences, of counts.
        sign: 1 or -1.
    """
    gradient_sums, square_sums, difference_sums, count_sums = sums[0], sums[1], sums[2], sums[3]
    for x in range(len(gradient)):
        gradient_sums[x] += sign * gradient[x]
        square_sums[x] += sign * (np.int32(gradient[x]) * np.int32(gradient[x]))
        difference_sums[x] += sign * difference[x]
        count_sums[x] += sign * count[x]


@inlined
def _measure_windows(sums, window_rows, window_columns, sigma, textures, disagreements):
    """Write texture and disagreement of a row's windows, (W,) float32 each.

    Args:
        sums: as for ``_add_row``, of the rows of the windows.
        window_rows: number of rows of the windows within the image; ``window_columns``: (W,) int32, of columns.
        sigma: standard deviation of the image noise, grey levels.
    """
    gradient_sums, square_sums, difference_sums, count_sums = sums[0], sums[1], sums[2], sums[3]
    zero, one, variance = np.float32(0.0), np.float32(1.0), sigma * sigma
    for column in range(len(textures)):
        gradient_sum, gradient_square_sum = np.int32(0), np.int32(0)
        difference_sum, count_sum = np.int32(0), np.int32(0)
        for x in range(_WINDOW):
            gradient_sum += gradient_sums[column + x]
            gradient_square_sum += square_sums[column + x]
            difference_sum += difference_sums[column + x]
            count_sum += count_sums[column + x]
        # The gradient is half the difference of two pixels: noise adds half its variance.
        pixels = np.int32(window_rows) * window_columns[column]
        scaled_variance = np.int32(gradient_square_sum) * pixels - np.int32(gradient_sum) * np.int32(gradient_sum)
        gradient_variance = np.float32(scaled_variance) / np.float32(4 * pixels * pixels)
        texture = np.sqrt(max(gradient_variance - np.float32(0.5) * variance, zero))
        mean_difference = np.float32(difference_sum) / (np.float32(16.0) * max(np.float32(count_sum), one))
        textures[column] = texture
        disagreements[column] = max(mean_difference - sigma, zero) / (texture + np.float32(2.0) * sigma)


@inlined
def _write_classes(
    textures, disagreements, texture_steps, disagreement_steps, sigma, disparity, nearest, farthest, classes
):  # fmt: skip
    """Write the classes of a row; arguments as for ``_classify``, of one row, and of ``_measure_windows``."""
    for column in range(len(classes)):
        texture_class, disagreement_class = np.int32(0), np.int32(0)
        for step in range(TEXTURES - 1):
            texture_class += np.int32(textures[column] >= texture_steps[step] * sigma)
        for step in range(DISAGREEMENTS - 1):
            disagreement_class += np.int32(disagreements[column] >= disagreement_steps[step])
        units = np.int32(disparity[column])
        is_known = np.int32(units > 0)
        in_front = is_known & np.int32(units - np.int32(farthest[column]) >= EDGE_STEP)
        is_behind = is_known & np.int32(np.int32(nearest[column]) - units >= EDGE_STEP)
        edge = in_front + (is_behind & (1 - in_front)) * 2
        classes[column] = (texture_class * DISAGREEMENTS + disagreement_class) * EDGES + edge


@device_function
def _compare_rows(left, right, disparity, gradient, difference, count):
    """Write a row's gradient and its difference from the right image, with ``RADIUS`` columns of padding.

    Args:
        left: (W,) uint8.
        right: (W,) uint8.
        disparity: (W,) uint16, units of 1/16 pixel.
        gradient: (W + 2 ``RADIUS``,) int16, output, grey levels per two pixels.
        difference: (W + 2 ``RADIUS``,) int16, output, units of 1/16 level; 0 where the disparity is unknown.
        count: (W + 2 ``RADIUS``,) int16, output, 1 where the disparity is known.
    """
    width = len(left)
    for column in range(width):
        previous, following = max(column - 1, 0), min(column + 1, width - 1)
        gradient[column + RADIUS] = np.int32(left[following]) - np.int32(left[previous])
        units = np.int32(disparity[column])
        right_column = column * 16 - units  # 1/16 pixel
        if units > 0 and right_column >= 0:
            whole, fraction = right_column >> 4, right_column & 15
            right_level = right[whole] * (16 - fraction) + right[min(whole + 1, width - 1)] * fraction
            difference[column + RADIUS] = abs(np.int32(left[column]) * 16 - right_level)
            count[column + RADIUS] = 1


@device_function
def _replace_row(left, right, disparity, row, gradients, differences, counts, sums):
    """Replace the oldest row of the rings by a row of the images, or by 0 below them; arguments as in ``_classify``."""
    gradient, difference, count = gradients[row % _WINDOW], differences[row % _WINDOW], counts[row % _WINDOW]
    _add_row(sums, gradient, difference, count, np.int32(-1))
    gradient[:], difference[:], count[:] = 0, 0, 0
    if row < len(left):
        _compare_rows(left[row], right[row], disparity[row], gradient, difference, count)
        _add_row(sums, gradient, difference, count, np.int32(1))


@kernel(
    "void(uint8[:,::1], uint8[:,::1], uint16[:,::1], uint16[:,::1], uint16[:,::1], float64, float32[::1], "
    "float32[::1], uint8[:,::1])"
)
def _classify(
    left, right, disparity, nearest, farthest, noise_sigma, texture_steps, disagreement_steps, classes
):  # fmt: skip
    """Write the result of ``classify``, whose arguments these are. Windows end at the edges of the image.

    All sums are of integers: their results do not depend on the order.

    Args:
        texture_steps: (``TEXTURES`` - 1,) float32.
        disagreement_steps: (``DISAGREEMENTS`` - 1,) float32.
        classes: (H, W) uint8, output.
    """
    height, width = left.shape
    padded = width + 2 * RADIUS
    sigma = np.float32(noise_sigma)
    # Rings of the last five rows, and their sums down each column. Padding beyond the image is 0.
    gradients = np.zeros((_WINDOW, padded), np.int16)
    differences = np.zeros((_WINDOW, padded), np.int16)
    counts = np.zeros((_WINDOW, padded), np.int16)
    sums = np.zeros((4, padded), np.int32)
    window_columns = np.empty(width, np.int32)
    textures, disagreements = np.empty(width, np.float32), np.empty(width, np.float32)
    for column in range(width):
        window_columns[column] = min(column + RADIUS, width - 1) - max(column - RADIUS, 0) + 1
    for row in range(RADIUS):
        _replace_row(left, right, disparity, row, gradients, differences, counts, sums)
    # With rows from -RADIUS in place of the first loop, LLVM takes arrays for overlapping: half the speed.
    for center in range(height):
        _replace_row(left, right, disparity, center + RADIUS, gradients, differences, counts, sums)
        window_rows = min(center + RADIUS, height - 1) - max(center - RADIUS, 0) + 1
        _measure_windows(sums, window_rows, window_columns, sigma, textures, disagreements)
        _write_classes(
            *(textures, disagreements, texture_steps, disagreement_steps, sigma),
            *(disparity[center], nearest[center], farthest[center], classes[center]),
        )


def second_match(
    left: NDArray[np.uint8], right: NDArray[np.uint8], disparity: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the second disparity at which a window matches, up to the largest one of the image.

    Args:
        left: (H, W) uint8, rectified.
        right: (H, W) uint8, rectified.
        disparity: (H, W) float32, exact disparity, pixels, 0: unknown.

    Returns:
        (H, W) float32, pixels, 0: the texture is not repeated.
    """
    height, width = left.shape
    rows, columns = max(height // SECOND_SCALE, 1), max(width // SECOND_SCALE, 1)
    small_left = cv2.resize(left, (columns, rows), interpolation=cv2.INTER_AREA)
    contrast = cv2.blur(cv2.absdiff(small_left, cv2.blur(small_left, (_WINDOW, 1))), (_WINDOW, _WINDOW))
    if not (contrast >= SECOND_MIN_CONTRAST).any():
        return np.zeros((height, width), np.float32)
    small_right = cv2.resize(right, (columns, rows), interpolation=cv2.INTER_AREA)
    half_pixels = cv2.addWeighted(small_right, 0.5, np.roll(small_right, 1, axis=1), 0.5, 0.0)
    border = _WINDOW // 2
    images = np.pad((small_left, small_right, half_pixels), ((0, 0), (border, border), (border, border)), "edge")
    exact = cv2.resize(disparity, (columns, rows), interpolation=cv2.INTER_NEAREST) * np.float32(
        SECOND_STEPS / SECOND_SCALE
    )
    candidates = min(min(int(exact.max() / SECOND_STEPS) + 2, columns) * SECOND_STEPS, 1 << _CANDIDATE_BITS)
    best = np.full((rows, columns), np.iinfo(np.int32).max, np.int32)
    _find_second(images, np.rint(exact).astype(np.int32), candidates, best)
    sums, steps = best >> _CANDIDATE_BITS, best & ((1 << _CANDIDATE_BITS) - 1)
    is_repeated = (
        (sums <= contrast * np.float32(SECOND_MAX_COST * _WINDOW**2))
        & (contrast >= SECOND_MIN_CONTRAST)
        & (exact > 0.0)
    )
    second = (is_repeated * steps).astype(np.float32) * np.float32(SECOND_SCALE / SECOND_STEPS)
    return np.asarray(cv2.resize(second, (width, height), interpolation=cv2.INTER_NEAREST), np.float32)


@kernel("void(uint8[:,:,::1], int32[:,::1], int64, int32[:,::1])")
def _find_second(images, exact, candidates, best):
    """Write the candidate whose windows differ least, of those that are not near the exact disparity.

    Args:
        images: (3, h + ``_WINDOW`` - 1, w + ``_WINDOW`` - 1) uint8: left, right, and right moved by half a pixel, with
            a border of half a window.
        exact: (h, w) int32, exact disparity, candidate steps.
        candidates: number of candidates.
        best: (h, w) int32, output, sum of differences and candidate (``_CANDIDATE_BITS``), initially the largest
            number.
    """
    for candidate in range(candidates):
        whole = candidate // SECOND_STEPS
        left, right = images[0, :, whole:], images[1 + candidate % SECOND_STEPS]
        column_sums = np.zeros(left.shape[1], np.int32)  # differences of a window's rows
        for row in range(_WINDOW - 1):
            _add_differences(column_sums, left[row], right[row], np.int32(1))
        for row in range(len(exact)):
            _add_differences(column_sums, left[row + _WINDOW - 1], right[row + _WINDOW - 1], np.int32(1))
            _keep_smallest(column_sums, exact[row, whole:], np.int32(candidate), best[row, whole:])
            _add_differences(column_sums, left[row], right[row], np.int32(-1))


@inlined
def _keep_smallest(column_sums, exact, candidate, best):
    """Write the matches of a candidate that are better than those before; arguments are those of one row."""
    for column in range(len(exact)):
        total = np.int32(0)
        for x in range(_WINDOW):
            total += column_sums[column + x]
        match = (total << np.int32(_CANDIDATE_BITS)) + candidate
        is_far = abs(exact[column] - candidate) > np.int32(SECOND_MIN_DISTANCE * SECOND_STEPS)
        best[column] = min(best[column], match) if is_far else best[column]


@inlined
def _add_differences(column_sums, left, right, sign):
    """Add or subtract the differences of two rows; ``sign``: 1 or -1."""
    for x in range(len(column_sums)):
        column_sums[x] += sign * abs(np.int32(left[x]) - np.int32(right[x]))
