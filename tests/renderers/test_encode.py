"""What the writers write, three independent readers read back bit for bit."""

from __future__ import annotations

import io
import struct
import zlib
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
import tifffile
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numba import int64
from numpy.typing import NDArray
from PIL import Image

from renderers.encode import jpeg_rgb, png_gray8, png_gray16, png_label, png_rgb, png_rgba, tiff_float32, tiff_gray16
from renderers.encode.deflate import deflate_rows

sizes = st.tuples(st.integers(1, 70), st.integers(1, 70))
seeds = st.integers(0, 2**32 - 1)


def picture(seed: int, shape: tuple[int, ...], dtype: type[np.generic]) -> NDArray[np.generic]:
    """Half noise, half flat: both kinds of deflate blocks."""
    rng = np.random.default_rng(seed)
    image = rng.integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
    image[: shape[0] // 2] = image[0, 0]
    return image


def pillow(data: bytes) -> NDArray[np.generic]:
    with Image.open(io.BytesIO(data)) as image:
        image.load()
        return np.array(image)


def opencv(data: bytes) -> NDArray[np.generic]:
    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert decoded is not None
    return decoded


@settings(deadline=None, max_examples=50)
@given(seeds, sizes)
@example(94, (66, 66))
def test_png_round_trips(seed: int, size: tuple[int, int]) -> None:
    rgb = picture(seed, (*size, 3), np.uint8)
    encoded = png_rgb(rgb)
    np.testing.assert_array_equal(pillow(encoded), rgb)
    np.testing.assert_array_equal(opencv(encoded)[..., ::-1], rgb)

    rgba = picture(seed, (*size, 4), np.uint8)
    encoded = png_rgba(rgba)
    np.testing.assert_array_equal(pillow(encoded), rgba)
    np.testing.assert_array_equal(opencv(encoded)[..., [2, 1, 0, 3]], rgba)

    gray8 = picture(seed, size, np.uint8)
    encoded = png_gray8(gray8)
    np.testing.assert_array_equal(pillow(encoded), gray8)
    np.testing.assert_array_equal(opencv(encoded), gray8)

    gray16 = picture(seed, size, np.uint16)
    encoded = png_gray16(gray16)
    np.testing.assert_array_equal(pillow(encoded), gray16)
    np.testing.assert_array_equal(opencv(encoded), gray16)


@pytest.mark.parametrize("length", [1, 7, 8, 9, 16, 257, 258, 259, 260, 261, 515, 516, 517, 518, 3000])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_png_keeps_repetitions_of_every_length(length: int, channels: int) -> None:
    row = np.concatenate([np.full(length, 5), np.arange(20), np.full(length, 9), np.arange(3)]).astype(np.uint8)
    image = np.stack([row, row + 1, row[::-1]])
    image = image if channels == 1 else np.repeat(image[..., None], channels, axis=2)
    write = {1: png_gray8, 3: png_rgb, 4: png_rgba}[channels]
    np.testing.assert_array_equal(pillow(write(np.ascontiguousarray(image))), image)


def test_png_of_values_as_rare_as_their_code_would_be_long() -> None:
    """Fibonacci's numbers make the longest codes: longer than deflate allows, unless they are shortened."""
    numbers = [1, 1]
    while len(numbers) < 22:
        numbers.append(numbers[-1] + numbers[-2])
    values = np.repeat(np.arange(len(numbers), dtype=np.uint8) * 11, numbers)
    np.random.default_rng(3).shuffle(values)
    image = values[None]  # one row: nothing is filtered away
    np.testing.assert_array_equal(pillow(png_gray8(image)), image)


@pytest.mark.parametrize("shape", [(1, 1), (700, 800), (2, 300_000), (1, 90_000)])
def test_png_of_noise_and_of_many_bands(shape: tuple[int, int]) -> None:
    noise = np.random.default_rng(4).integers(0, 256, (*shape, 3), np.uint8)
    encoded = png_rgb(noise)
    np.testing.assert_array_equal(opencv(encoded)[..., ::-1], noise)
    assert len(encoded) < 1.01 * noise.nbytes + 200


@pytest.mark.parametrize("color", [255, (1, 254, 255), (255, 255, 255, 3)])
def test_png_of_one_repetition_of_megabytes(color: int | tuple[int, ...]) -> None:
    """Its checksum, which readers compare, is computed from its first bytes and how often they come."""
    image = np.full((1, 3_000_001, *np.shape(color)), color, np.uint8)
    write = {2: png_gray8, 3: png_rgb if image.shape[-1] == 3 else png_rgba}[image.ndim]
    np.testing.assert_array_equal(pillow(write(image)), image)


def test_pictures_of_all_kinds_are_written_by_one_compiled_kernel() -> None:
    png_gray8(np.zeros((2, 3), np.uint8))
    png_gray16(np.zeros((2, 3), np.uint16))
    png_rgb(np.zeros((700, 300, 3), np.uint8))  # of several bands
    assert [str(signature) for signature in deflate_rows.signatures] == [str((int64,) * 11)]


def test_equal_pictures_are_equal_files() -> None:
    image = picture(5, (300, 500), np.uint16)
    first = png_gray16(image)
    png_gray16(picture(6, (300, 500), np.uint16))
    assert png_gray16(image) == first


def test_png_is_written_by_several_threads_at_once() -> None:
    images = [picture(seed, (200, 300, 3), np.uint8) for seed in range(8)]
    with ThreadPoolExecutor(4) as pool:
        for image, encoded in zip(images, pool.map(png_rgb, images), strict=True):
            np.testing.assert_array_equal(pillow(encoded), image)


@settings(deadline=None, max_examples=50)
@given(seeds, sizes)
def test_label_colours_are_the_bytes_of_the_label(seed: int, size: tuple[int, int]) -> None:
    labels = picture(seed, size, np.uint32)
    expected = np.stack((labels & 255, labels >> 8 & 255, labels >> 16 & 255), axis=-1)
    np.testing.assert_array_equal(pillow(png_label(labels)), expected)


@settings(deadline=None, max_examples=50)
@given(seeds, sizes)
def test_tiff_round_trips(seed: int, size: tuple[int, int]) -> None:
    depth = picture(seed, size, np.uint32).view(np.float32)  # every bit pattern: subnormals, NaN, inf
    encoded = tiff_float32(depth)
    np.testing.assert_array_equal(
        tifffile.imread(io.BytesIO(encoded)).reshape(size).view(np.uint32), depth.view(np.uint32)
    )
    np.testing.assert_array_equal(pillow(encoded).view(np.uint32), depth.view(np.uint32))
    np.testing.assert_array_equal(opencv(encoded).view(np.uint32), depth.view(np.uint32))

    gray = picture(seed, size, np.uint16)
    encoded = tiff_gray16(gray)
    np.testing.assert_array_equal(tifffile.imread(io.BytesIO(encoded)).reshape(size), gray)
    np.testing.assert_array_equal(pillow(encoded), gray)
    np.testing.assert_array_equal(opencv(encoded), gray)


def test_pictures_of_many_bands_round_trip() -> None:
    """Larger than the band in which rows are filtered, with a last band that is not full."""
    rgb = picture(1, (701, 640, 3), np.uint8)
    np.testing.assert_array_equal(pillow(png_rgb(rgb)), rgb)
    wide = picture(2, (3, 200_000), np.uint16)  # one row is more than a band
    np.testing.assert_array_equal(opencv(png_gray16(wide)), wide)


def test_strided_views_are_encoded_as_they_look() -> None:
    image = picture(3, (40, 60, 3), np.uint8)
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


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("value", [0, 1, 255])
def test_checksums_of_long_repetitions_hold(channels: int, value: int) -> None:
    """Their sums are not made byte by byte."""
    image = np.full((1500, 700, channels), value, np.uint8)
    image[::7] += np.arange(channels, dtype=np.uint8) + 1  # rows that differ from the one above by a pixel's pattern
    image[3, 5:40] = np.random.default_rng(value).integers(0, 256, (35, channels), np.uint8)
    write = {1: lambda x: png_gray8(x[..., 0]), 3: png_rgb, 4: png_rgba}[channels]
    data = write(image)
    begin = data.index(b"IDAT")
    (length,) = struct.unpack_from(">I", data, begin - 4)
    filtered = zlib.decompress(data[begin + 4 : begin + 4 + length])  # raises unless the Adler-32 is right
    assert len(filtered) == 1500 * (1 + 700 * channels)
    np.testing.assert_array_equal(pillow(data), image if channels > 1 else image[..., 0])


@pytest.mark.parametrize("width", range(1, 40))
def test_files_do_not_depend_on_what_was_written_before(width: int) -> None:
    image = np.full((1, width, 3), 7, np.uint8)
    first = png_rgb(image)
    png_rgb(picture(width, (200, 300, 3), np.uint8))
    assert png_rgb(image) == first


def test_wrong_arrays_are_refused() -> None:
    with pytest.raises(ValueError, match=r"expected \(H, W, 3\) uint8, got \(4, 4\) uint8"):
        png_rgb(np.zeros((4, 4), np.uint8))
    with pytest.raises(ValueError, match="at least one pixel"):
        png_gray8(np.zeros((0, 4), np.uint8))
    with pytest.raises(ValueError, match="float64"):
        tiff_float32(np.zeros((4, 4)))
    with pytest.raises(ValueError, match="at least one pixel"):
        tiff_gray16(np.zeros((4, 0), np.uint16))
    with pytest.raises(ValueError, match="uint16"):
        jpeg_rgb(np.zeros((4, 4, 3), np.uint16))


def test_jpeg_looks_like_the_picture() -> None:
    y, x = np.mgrid[0:64, 0:64]
    rgb = np.stack((4 * x, 4 * y, 128 + 0 * x), axis=-1).astype(np.uint8)
    assert np.abs(pillow(jpeg_rgb(rgb, quality=95)).astype(int) - rgb).mean() < 2
