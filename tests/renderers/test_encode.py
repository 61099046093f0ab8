"""Encoders: three independent readers decode every file bit for bit."""

import io
import struct
import zlib
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from renderers.encode import jpeg_rgb, png_gray8, png_gray16, png_label, png_rgb, png_rgba, tiff_float32, tiff_gray16

sizes = st.tuples(st.integers(1, 70), st.integers(1, 70))
seeds = st.integers(0, 2**32 - 1)


def noise(seed: int, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Return an image, half of it flat, half noise."""
    rng = np.random.default_rng(seed)
    image = rng.integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
    image[: shape[0] // 2] = image[0, 0]
    return image


def pillow(data: bytes) -> NDArray[Any]:
    with Image.open(io.BytesIO(data)) as image:
        image.load()
        return np.array(image)


def opencv(data: bytes) -> NDArray[Any]:
    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert decoded is not None
    return decoded


@settings(deadline=None, max_examples=50)
@given(seeds, sizes)
@example(94, (66, 66))
def test_png_round_trips(seed: int, size: tuple[int, int]) -> None:
    formats: tuple[tuple[Any, tuple[int, ...], Any, Any], ...] = (
        (png_rgb, (*size, 3), np.uint8, [2, 1, 0]),
        (png_rgba, (*size, 4), np.uint8, [2, 1, 0, 3]),
        (png_gray8, size, np.uint8, slice(None)),
        (png_gray16, size, np.uint16, slice(None)),
    )
    for encode, shape, dtype, order in formats:
        image = noise(seed, shape, dtype)
        np.testing.assert_array_equal(pillow(encode(image)), image)
        np.testing.assert_array_equal(opencv(encode(image))[..., order], image)


@pytest.mark.parametrize("shape", [(1, 1), (700, 800), (2, 300_000), (1, 90_000)])
def test_png_of_noise_has_little_overhead(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(4).integers(0, 256, (*shape, 3), np.uint8)
    encoded = png_rgb(image)
    np.testing.assert_array_equal(opencv(encoded)[..., ::-1], image)
    assert len(encoded) < 1.01 * image.nbytes + 200


def test_equal_images_give_equal_files() -> None:
    image = noise(5, (300, 500), np.uint16)
    first = png_gray16(image)
    png_gray16(noise(6, (300, 500), np.uint16))
    assert png_gray16(image) == first


def test_png_is_written_by_several_threads_at_once() -> None:
    images = [noise(seed, (200, 300, 3), np.uint8) for seed in range(8)]
    with ThreadPoolExecutor(4) as pool:
        for image, encoded in zip(images, pool.map(png_rgb, images), strict=True):
            np.testing.assert_array_equal(pillow(encoded), image)


@settings(deadline=None, max_examples=50)
@given(seeds, sizes)
def test_label_colours_are_the_bytes_of_the_label(seed: int, size: tuple[int, int]) -> None:
    labels = noise(seed, size, np.uint32)
    expected = np.stack((labels & 255, labels >> 8 & 255, labels >> 16 & 255), axis=-1)
    np.testing.assert_array_equal(pillow(png_label(labels)), expected)


@settings(deadline=None, max_examples=50)
@given(seeds, sizes)
def test_tiff_round_trips(seed: int, size: tuple[int, int]) -> None:
    depth = noise(seed, size, np.uint32).view(np.float32)  # every bit pattern: subnormals, NaN, inf
    encoded = tiff_float32(depth)
    np.testing.assert_array_equal(
        tifffile.imread(io.BytesIO(encoded)).reshape(size).view(np.uint32), depth.view(np.uint32)
    )
    np.testing.assert_array_equal(pillow(encoded).view(np.uint32), depth.view(np.uint32))
    np.testing.assert_array_equal(opencv(encoded).view(np.uint32), depth.view(np.uint32))

    gray = noise(seed, size, np.uint16)
    encoded = tiff_gray16(gray)
    np.testing.assert_array_equal(tifffile.imread(io.BytesIO(encoded)).reshape(size), gray)
    np.testing.assert_array_equal(pillow(encoded), gray)
    np.testing.assert_array_equal(opencv(encoded), gray)


def test_strided_views_are_encoded() -> None:
    image = noise(3, (40, 60, 3), np.uint8)
    np.testing.assert_array_equal(pillow(png_rgb(image[::2, ::-3])), image[::2, ::-3])
    depth = np.arange(48, dtype=np.float32).reshape(6, 8)
    np.testing.assert_array_equal(pillow(tiff_float32(depth.T)), depth.T)


def test_png_structure_is_minimal_and_checksums_hold() -> None:
    data = png_rgb(np.zeros((2, 3, 3), np.uint8))
    kinds, offset = [], 8
    while offset < len(data):
        (length,) = struct.unpack_from(">I", data, offset)
        kind, body = data[offset + 4 : offset + 8], data[offset + 8 : offset + 8 + length]
        assert struct.unpack_from(">I", data, offset + 8 + length) == (zlib.crc32(kind + body),)
        kinds.append(kind)
        offset += 12 + length
    assert kinds == [b"IHDR", b"IDAT", b"IEND"]


def test_rejects_wrong_shapes_and_dtypes() -> None:
    wrong: tuple[tuple[Any, tuple[int, ...], Any, str], ...] = (
        (png_rgb, (4, 4), np.uint8, r"\(H, W, 3\) uint8, got \(4, 4\) uint8"),
        (png_gray8, (0, 4), np.uint8, "at least one pixel"),
        (tiff_float32, (4, 4), np.float64, "float64"),
        (tiff_gray16, (4, 0), np.uint16, "at least one pixel"),
        (jpeg_rgb, (4, 4, 3), np.uint16, "uint16"),
        (jpeg_rgb, (4, 4, 3, 1), np.uint8, r"\(4, 4, 3, 1\)"),
    )
    for encode, shape, dtype, message in wrong:
        with pytest.raises(ValueError, match=message):
            encode(np.zeros(shape, dtype))


def test_jpeg_resembles_the_image() -> None:
    y, x = np.mgrid[0:64, 0:64]
    rgb = np.stack((4 * x, 4 * y, 128 + 0 * x), axis=-1).astype(np.uint8)
    assert np.abs(pillow(jpeg_rgb(rgb, quality=95)).astype(int) - rgb).mean() < 2
