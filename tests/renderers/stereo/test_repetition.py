"""Repeated texture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.depth.pixel_classes import second_match

DISPARITY = 60.3


def seen(texture: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32]]:
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
    second = second_match(*seen(chequer))[inner]
    is_repeated = second > 0.0
    assert is_repeated.mean() > 0.8
    periods = (second[is_repeated] - DISPARITY) / 28.0
    assert np.abs(periods - np.rint(periods)).max() < 2.0 / 28.0
    assert np.abs(periods).min() > 0.9
    assert (second_match(*seen(np.clip(noise, 0, 255)))[inner] > 0.0).mean() < 0.01
    assert not second_match(*seen(stripes))[inner].any()
    assert not second_match(*seen(np.full((120, 400), 99.0))).any()


def test_small_images_and_unknown_disparities_have_no_repetition() -> None:
    tiny = np.zeros((3, 5), np.uint8)
    assert not second_match(tiny, tiny, np.zeros((3, 5), np.float32)).any()
    assert not second_match(tiny, tiny, np.full((3, 5), 400.0, np.float32)).any()
