"""Camera images at the resolution of depth images: means of square blocks of pixels, and their noise."""

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.stereo.depth.matching import FINE, ImagePair, block_means
from renderers.stereo.model import StereoModel
from renderers.stereo.sensor.camera_image import NoiseStream, fixed_pattern, frame_key, image_from_light
from renderers.stereo.sensor.exposure import LIGHT_WHITE, Exposure


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


@pytest.mark.parametrize("divisor", [1, 2, 4])
@pytest.mark.parametrize("gain", [0.0, 12.0])
@pytest.mark.parametrize("has_pattern", [False, True])
@pytest.mark.parametrize("level", [30, 128, 220])
def test_noise_is_what_images_of_even_light_have(level: int, *, has_pattern: bool, gain: float, divisor: int) -> None:
    """Read and shot noise, rounding, and the fixed pattern, averaged over blocks."""
    model, exposure = StereoModel("small", 256, 192, 0.8449, 0.160), Exposure(0.005, gain)
    grey = np.linspace(level - 4.0, level + 4.0, model.width) / 255.0  # so that not all pixels are rounded alike
    row = (LIGHT_WHITE * (grey / exposure.light) ** 0.5).astype(np.uint16)
    light = np.ascontiguousarray(np.broadcast_to(row[:, None], (model.height, model.width, 1)))
    patterns = [fixed_pattern(3, right=right, height=model.height, width=model.width) for right in (False, True)]
    left, right = (
        image_from_light(light, exposure, frame_key(3, 0, stream), patterns[number] if has_pattern else None)
        for number, stream in enumerate((NoiseStream.LEFT, NoiseStream.RIGHT))
    )
    pair = ImagePair(left, right, exposure)
    expected = pair.noise_sigma(1.0, 1, divisor, has_pattern=has_pattern)[level]
    for levels in pair.reduced(model, divisor):
        assert (levels - levels.mean(axis=0)).std() / FINE == pytest.approx(expected, rel=0.1)
