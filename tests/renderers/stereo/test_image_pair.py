"""Means of square blocks of pixels."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.stereo.depth.matching import block_means


def image(*shape: int) -> NDArray[np.uint8]:
    return np.random.default_rng(1).integers(0, 256, shape, np.uint8)


@pytest.mark.parametrize("shape", [(6, 9), (6, 9, 3)], ids=["grey", "color"])
def test_means_of_whole_blocks(shape: tuple[int, ...]) -> None:
    pixels = image(*shape)
    blocks = pixels.astype(float).reshape(2, 3, 3, 3, *shape[2:])
    means = block_means(pixels, 3, rows=2, columns=3)
    assert means.dtype == np.uint8
    np.testing.assert_allclose(means, blocks.mean(axis=(1, 3)), atol=0.5)


def test_blocks_beyond_the_image_repeat_its_last_row_and_column() -> None:
    pixels = image(5, 7)
    padded = np.pad(pixels, ((0, 1), (0, 2)), mode="edge")
    np.testing.assert_array_equal(block_means(pixels, 3, rows=2, columns=3), block_means(padded, 3, rows=2, columns=3))


def test_pixels_beyond_the_last_block_are_ignored() -> None:
    pixels = image(8, 11)
    np.testing.assert_array_equal(
        block_means(pixels, 3, rows=2, columns=3), block_means(pixels[:6, :9], 3, rows=2, columns=3)
    )


def test_blocks_of_one_pixel_are_the_image() -> None:
    pixels = image(4, 5, 3)
    np.testing.assert_array_equal(block_means(pixels, 1, rows=4, columns=5), pixels)
