"""Classes of pixels against a plain implementation with NumPy, and repeated texture."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.stereo.depth.pixel_classes import (
    CLASSES,
    DISAGREEMENT_STEPS,
    DISAGREEMENTS,
    EDGE_STEP,
    EDGES,
    RADIUS,
    TEXTURE_STEPS,
    classify,
    second_match,
    window_range,
)

DISPARITY = 60.3
"""Pixels, of a wall with repeated texture."""


def expected_class(
    left: NDArray[np.uint8], right: NDArray[np.uint8], disparity: NDArray[np.uint16], noise: float, y: int, x: int
) -> int:
    """Return the class of one pixel by its definition."""
    height, width = left.shape
    gradients, differences, known = [], [], []
    for row in range(max(y - RADIUS, 0), min(y + RADIUS, height - 1) + 1):
        for column in range(max(x - RADIUS, 0), min(x + RADIUS, width - 1) + 1):
            gradients.append(float(left[row, min(column + 1, width - 1)]) - float(left[row, max(column - 1, 0)]))
            units = int(disparity[row, column])
            if units > 0:
                known.append(units)
                if column * 16 >= units:
                    level = np.interp(column - units / 16, np.arange(width), right[row].astype(float))
                    differences.append(abs(float(left[row, column]) - level))
    texture = max(float(np.var(gradients)) / 4 - noise**2 / 2, 0.0) ** 0.5
    difference = float(np.mean(differences)) if differences else 0.0
    disagreement = max(difference - noise, 0.0) / (texture + 2 * noise)
    edge = 0
    units = int(disparity[y, x])
    if units and units - min(known) >= EDGE_STEP:
        edge = 1
    elif units and max(known) - units >= EDGE_STEP:
        edge = 2
    texture_class = int(np.searchsorted(np.array(TEXTURE_STEPS) * noise, texture, side="right"))
    disagreement_class = int(np.searchsorted(DISAGREEMENT_STEPS, disagreement, side="right"))
    return (texture_class * DISAGREEMENTS + disagreement_class) * EDGES + edge


@pytest.mark.parametrize("noise", [0.3, 1.7, 6.0])
def test_classes_are_those_of_the_definition(noise: float) -> None:
    random = np.random.default_rng(4)
    height, width = 37, 53
    left = (random.integers(0, 256, (height, width)) * random.choice([0.02, 0.2, 1.0], (height, 1))).astype(np.uint8)
    right = np.roll(left, -3, axis=1)
    disparity = np.full((height, width), 48, np.uint16)
    disparity[:, 20:30] += random.integers(0, 70, (height, 10), np.uint16)
    disparity[random.random((height, width)) < 0.1] = 0
    classes = classify(left, right, disparity, *window_range(disparity), noise)
    expected = np.array(
        [[expected_class(left, right, disparity, noise, y, x) for x in range(width)] for y in range(height)]
    )
    assert classes.dtype == np.uint8
    assert (classes != expected).mean() < 0.002, "but for rounding at a border"
    assert len(np.unique(expected)) >= 18
    assert {value % EDGES for value in np.unique(expected)} == {0, 1, 2}
    assert expected.max() < CLASSES


def test_smooth_shading_is_no_texture() -> None:
    ramp = np.tile((np.arange(60) * 3).astype(np.uint8), (40, 1))
    disparity = np.full_like(ramp, 32, np.uint16)
    classes = classify(ramp, np.roll(ramp, -2, axis=1), disparity, *window_range(disparity), 0.3)
    assert (classes[:, 6:-6] // (DISAGREEMENTS * EDGES) == 0).all()


def test_windows_hold_the_largest_and_smallest_known_disparity() -> None:
    disparity = np.zeros((7, 9), np.uint16)
    disparity[3, 4], disparity[3, 6] = 100, 300
    nearest, farthest = window_range(disparity)
    assert (nearest[3, 2], farthest[3, 2]) == (100, 100)
    assert (nearest[3, 5], farthest[3, 5]) == (300, 100)
    assert (nearest[0, 0], farthest[0, 0]) == (0, 65535)


def wall_of(texture: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32]]:
    """Return left and right image of a texture on a frontal wall, and its disparity."""
    height, width = texture.shape[0], texture.shape[1] - 100
    columns = np.arange(width, dtype=np.float64)
    right = np.stack([np.interp(columns + DISPARITY, np.arange(row.size), row) for row in texture])
    disparity = np.full((height, width), DISPARITY, np.float32)
    disparity[:, : int(DISPARITY) + 1] = 0.0
    return texture[:, :width].astype(np.uint8), right.astype(np.uint8), disparity


def test_a_chequerboard_is_repeated_and_a_random_texture_is_not() -> None:
    rows, columns = np.mgrid[0:120, 0:400]
    chequer = 60.0 + 120.0 * ((rows // 14 + columns // 14) % 2)
    random = np.random.default_rng(3)
    noise = np.kron(random.normal(size=(30, 100)), np.ones((4, 4))) * 25 + random.normal(128, 20, (120, 400))
    stripes = 60.0 + 120.0 * (rows // 14 % 2)  # along the rows: no matcher can measure them, at any disparity
    inner = np.s_[20:-20, 120:280]
    second = second_match(*wall_of(chequer))[inner]
    is_repeated = second > 0.0
    assert is_repeated.mean() > 0.8
    periods = (second[is_repeated] - DISPARITY) / 28.0
    assert np.abs(periods - np.rint(periods)).max() < 2.0 / 28.0
    assert np.abs(periods).min() > 0.9
    assert (second_match(*wall_of(np.clip(noise, 0, 255)))[inner] > 0.0).mean() < 0.01
    assert not second_match(*wall_of(stripes))[inner].any()
    assert not second_match(*wall_of(np.full((120, 400), 99.0))).any()


def test_small_images_and_unknown_disparities_have_no_repetition() -> None:
    tiny = np.zeros((3, 5), np.uint8)
    assert not second_match(tiny, tiny, np.zeros((3, 5), np.float32)).any()
    assert not second_match(tiny, tiny, np.full((3, 5), 400.0, np.float32)).any()
