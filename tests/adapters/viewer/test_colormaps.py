"""The pixels of colored and shrunk images."""

import io

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from gateway.adapters.viewer.image_routes import encode_preview
from gateway.adapters.viewer.sensor_images import confidence_to_rgb, depth_to_rgb, disparity_to_rgb, shrink_to_width
from gateway.runtime.logs.render_record import RenderRecord
from renderers.encode import png_gray16, png_label, png_rgb, tiff_float32


def color_of(level: int, colormap: int = cv2.COLORMAP_TURBO) -> tuple[int, ...]:
    bgr = cv2.applyColorMap(np.array([[level]], np.uint8), colormap)[0, 0]
    return tuple(bgr[::-1].tolist())


NEAR, FAR, BLACK = color_of(255), color_of(0), (0, 0, 0)


def pixels(rgb: NDArray[np.uint8]) -> list[tuple[int, ...]]:
    return [tuple(pixel) for pixel in rgb.reshape(-1, 3).tolist()]


def test_depth_in_metres_is_colored_from_near_to_far() -> None:
    depth = np.array([[1.0, 3.0, np.inf, 0.0, np.nan, -1.0]], np.float32)
    far = np.percentile([1.0, 3.0], 95)
    assert pixels(depth_to_rgb(depth)) == [NEAR, FAR, BLACK, BLACK, BLACK, BLACK]
    middle = np.array([[1.0, (1.0 + far) / 2, 3.0]], np.float32)
    far = np.percentile(middle, 95)
    assert pixels(depth_to_rgb(middle))[1] == color_of(int(255 * (far - middle[0, 1]) / (far - 1.0)))


def test_depth_in_millimetres_has_its_own_invalid_value() -> None:
    depth = np.array([[1000, 65534, 65535, 0]], np.uint16)
    assert pixels(depth_to_rgb(depth)) == [NEAR, FAR, BLACK, BLACK]
    assert pixels(depth_to_rgb(depth.astype(np.float32)))[2] == FAR, "65535 m is a depth"


def test_a_single_depth_and_no_depth_are_colored() -> None:
    assert pixels(depth_to_rgb(np.full((1, 2), 2.0, np.float32))) == [FAR, FAR]
    assert pixels(depth_to_rgb(np.full((1, 2), np.inf, np.float32))) == [BLACK, BLACK]


def test_disparity_is_colored_between_its_percentiles() -> None:
    disparity = np.concatenate((np.zeros(9), np.arange(1, 1001))).astype(np.uint16)[None, :]
    rgb = pixels(disparity_to_rgb(disparity))
    assert rgb[:9] == [BLACK] * 9
    assert rgb[9] == rgb[9 + 9] == FAR
    assert rgb[-1] == rgb[-10] == NEAR
    low, high = np.percentile(disparity[disparity > 0], (1, 99))
    assert rgb[9 + 499] == color_of(int(255 * (500 - low) / (high - low)))
    assert pixels(disparity_to_rgb(np.zeros((1, 2), np.uint16))) == [BLACK, BLACK]


def test_confidence_is_colored_from_1_to_255() -> None:
    rgb = pixels(confidence_to_rgb(np.array([[0, 1, 128, 255]], np.uint8)))
    assert rgb == [BLACK, *(color_of(level, cv2.COLORMAP_VIRIDIS) for level in (1, 128, 255))]


@pytest.mark.parametrize(("width", "shape"), [(None, (6, 8)), (9, (6, 8)), (8, (6, 8)), (4, (3, 4)), (1, (1, 1))])
def test_shrinking_keeps_the_aspect_ratio(width: int | None, shape: tuple[int, int]) -> None:
    rgb = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)
    small = shrink_to_width(rgb, width)
    assert small.shape == (*shape, 3)
    if width == 4:
        means = rgb.reshape(3, 2, 4, 2, 3).mean(axis=(1, 3))
        np.testing.assert_allclose(small, means, atol=0.5)


def summary(kind: str, body: bytes, media_type: str) -> RenderRecord:
    return RenderRecord(1, 0.0, 200, 0.0, 0.0, "", "", kind, body, media_type, "")


def preview(kind: str, body: bytes, media_type: str, width: int | None) -> NDArray[np.uint8]:
    data = encode_preview(summary(kind, body, media_type), width)
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def test_color_previews_keep_their_colors() -> None:
    rgb = np.tile(np.array([[[10, 100, 200], [10, 100, 200], [250, 0, 5], [250, 0, 5]]], np.uint8), (2, 1, 1))
    body = png_rgb(rgb)
    assert encode_preview(summary("color", body, "image/png"), None) is body
    np.testing.assert_array_equal(preview("color", body, "image/png", 4), rgb)
    np.testing.assert_array_equal(preview("color", body, "image/png", 2), rgb[:1, 1:3])


def test_label_previews_are_not_interpolated() -> None:
    labels = np.arange(1, 65, dtype=np.uint32).reshape(8, 8) * 40_000
    body = png_label(labels)
    full = pixels(preview("label", body, "image/png", None))
    small = preview("label", body, "image/png", 4)
    assert small.shape == (4, 4, 3)
    assert set(pixels(small)) <= set(full)
    assert len(set(pixels(small))) == 16


@pytest.mark.parametrize("width", [None, 4])
def test_depth_previews_are_colored(width: int | None) -> None:
    depth = np.full((2, 4), np.inf, np.float32)
    depth[:, 0] = 1.0
    depth[:, 3] = 1.5
    metres = preview("depth", tiff_float32(depth), "image/tiff", width)
    assert pixels(metres[:1]) == [NEAR, BLACK, BLACK, FAR]
    millimetres = np.where(np.isfinite(depth), depth * 1000, 65535).astype(np.uint16)
    np.testing.assert_array_equal(preview("depth", png_gray16(millimetres), "image/png", width), metres)
