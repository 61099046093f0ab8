"""Post-processing of depth images against OpenCV's segments and components."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.filters import FILL_SHARE, SEGMENT_STEP, Filters, apply_filters

STEP = round(SEGMENT_STEP * 16)
"""``SEGMENT_STEP`` in units of 1/16 pixel."""


def patches(seed: int) -> NDArray[np.uint16]:
    """Return a random disparity image of patches and noise with holes, (H, W) uint16, units of 1/16 pixel."""
    random = np.random.default_rng(seed)
    height, width = random.integers(1, 60, 2)
    side = int(random.integers(1, 6))
    levels = 100 + STEP * random.integers(0, 4, (height // side + 1, width // side + 1))
    disparity = np.kron(levels, np.ones((side, side), np.int64))[:height, :width]
    disparity += random.integers(0, random.integers(1, STEP), (height, width))
    disparity[random.random((height, width)) < 0.7 * random.random()] = 0
    return np.ascontiguousarray(disparity, np.uint16)


def filtered(disparity: NDArray[np.uint16], filters: Filters, divisor: int = 2) -> DepthImages:
    valid = (disparity > 0).astype(np.uint8)
    images = DepthImages(disparity.copy(), valid.copy(), valid * np.uint8(255))
    apply_filters(images, filters, 100.0, divisor)
    return images


@pytest.mark.parametrize("seed", range(40))
def test_segments_are_those_of_opencv(seed: int) -> None:
    disparity = patches(seed)
    min_size = 2 + seed
    expected = disparity.copy()
    cv2.filterSpeckles(expected.view(np.int16), 0, min_size - 1, STEP)
    images = filtered(disparity, Filters(seg=min_size, fill=0))
    np.testing.assert_array_equal(images.disparity, expected)
    np.testing.assert_array_equal(images.error > 0, expected > 0)
    np.testing.assert_array_equal(images.confidence, (expected > 0) * np.uint8(255))


@pytest.mark.parametrize("seed", range(40))
def test_filled_holes_are_components_inside_the_image_with_even_borders(seed: int) -> None:
    disparity, max_step = patches(seed), 3
    count, labels = cv2.connectedComponents((disparity == 0).astype(np.uint8), connectivity=4)
    fillable = []
    for label in range(1, count):
        hole = np.pad((labels == label).astype(np.uint8), 1)
        border = cv2.dilate(hole, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))) - hole
        padded = np.pad(disparity.astype(np.int64), 1)
        if (padded[border > 0] > 0).all() and np.ptp(padded[border > 0]) <= max_step * 16:
            fillable.append((int(hole.sum()), label))
    expected, pixels = np.zeros(disparity.shape, np.bool_), 0
    for size, label in sorted(fillable):
        pixels += size
        if pixels > FILL_SHARE * disparity.size:
            break
        expected |= labels == label
    images = filtered(disparity, Filters(seg=0, fill=max_step))
    np.testing.assert_array_equal(images.disparity > 0, (disparity > 0) | expected)
    np.testing.assert_array_equal(images.confidence == 128, expected)
    unfilled = ~expected
    np.testing.assert_array_equal(images.disparity[unfilled], disparity[unfilled])


@pytest.mark.parametrize(("pixels", "filled"), [(20, True), (21, False)])
def test_exactly_five_percent_are_filled(pixels: int, filled: bool) -> None:
    d = np.full((20, 20), 800, np.uint16)
    d.reshape(-1)[[20 * (1 + k // 7) + 1 + k % 7 for k in range(pixels)]] = 0
    assert filtered(d, Filters(seg=0)).disparity.all() == filled


@pytest.mark.parametrize(
    ("step", "divisor", "kept"), [(32, 2, True), (33, 2, False), (96, 1, True), (97, 1, False), (32, 4, True)]
)
def test_segments_are_connected_up_to_two_pixels_at_full_size_six(step: int, divisor: int, kept: bool) -> None:
    """The same things are one segment at Full and at High."""
    d = np.full((20, 20), 800, np.uint16)
    d[:4] += step
    result = filtered(d, Filters(seg=21 * divisor**2, fill=0), divisor).disparity
    assert result[:4].all() == kept
    assert result[4:].all()
