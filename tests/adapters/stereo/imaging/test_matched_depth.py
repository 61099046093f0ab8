"""Matched depth images: which images are matched, and how their results are joined. The matcher is a fake."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.imaging.matched_depth import matched_depth
from renderers.interface import Parallel
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.matching import ImagePair
from renderers.stereo.model import StereoModel
from renderers.stereo.sensor.camera_image import SensorImage
from renderers.stereo.sensor.exposure import Exposure
from tests.adapters.stereo.conftest import settings as settings_of

MODEL = StereoModel("small", 128, 97, 0.8449, 0.160)
HEIGHT, WIDTH = 49, 64
"""Of depth images of quality High."""


class FakeMatcher:
    """Notes what it is called with; finds what ``results`` says for each size of image."""

    def __init__(self, **results: tuple[int, int, int]) -> None:
        self.results = results
        self.calls: list[tuple[tuple[int, ...], int, list[float], int]] = []

    def __call__(
        self,
        left: NDArray[np.uint16],
        right: NDArray[np.uint16],
        disparity_count: int,
        noise_sigma: NDArray[np.float64],
        divisor: int,
        parallel: Parallel,
    ) -> DepthImages:
        assert left.shape == right.shape
        self.calls.append((left.shape, disparity_count, noise_sigma.tolist(), divisor))
        name = f"call{len(self.calls)}"
        disparity, error, confidence = self.results.get(name, (0, 0, 0))
        return DepthImages(
            np.full(left.shape, disparity, np.uint16),
            np.full(left.shape, error, np.uint8),
            np.full(left.shape, confidence, np.uint8),
        )


settings = partial(settings_of, "rc_stereomatching", seg=0, fill=0)


def pair(gain: float = 0.0) -> ImagePair:
    image = SensorImage(np.zeros((MODEL.height, MODEL.width), np.uint8), 0.0)
    return ImagePair(image, image, Exposure(0.005, gain))


def match(monkeypatch: pytest.MonkeyPatch, matcher: FakeMatcher, *given: Any, **config: Any) -> DepthImages:
    monkeypatch.setattr("gateway.adapters.stereo.imaging.matched_depth.match_pair", matcher)
    return matched_depth(StereoConfig(model=MODEL, **config), *given)


def test_one_match_without_double_shot(monkeypatch: pytest.MonkeyPatch) -> None:
    matcher = FakeMatcher(call1=(80, 3, 200))
    images = match(monkeypatch, matcher, pair(), settings(), pair())
    assert [call[0] for call in matcher.calls] == [(HEIGHT, WIDTH)]
    assert (images.disparity == 80).all()


@pytest.mark.parametrize(("averaged", "noise", "image_noise"), [(1, True, 1.0), (8, True, 2.5), (1, False, 2.5)])
def test_the_matcher_gets_the_noise_of_the_images(
    averaged: int, noise: bool, image_noise: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    matcher = FakeMatcher()
    static, has_pattern = settings(static_scene=averaged > 1), frozenset({"fixed-pattern"})
    match(monkeypatch, matcher, pair(6.0), static, None, noise=noise, image_noise=image_noise, realism=has_pattern)
    expected = pair(6.0).noise_sigma(image_noise if noise else 0.0, averaged, 2, has_pattern=noise)
    assert matcher.calls[0][2:] == (expected.tolist(), 2)


def test_holes_are_filled_from_half_the_resolution(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its disparities and errors are of pixels that are twice as large; its confidence stays."""
    for error, doubled in ((3, 6), (127, 254), (128, 255), (255, 255)):
        matcher = FakeMatcher(call2=(40, error, 200))
        images = match(monkeypatch, matcher, pair(), settings(double_shot=True), None)
        (whole, count, sigma, divisor), (half, half_count, half_sigma, half_divisor) = matcher.calls
        assert (whole, half) == ((HEIGHT, WIDTH), (25, 32))
        assert (half_count, half_divisor) == (-(-count // 2), 2 * divisor)
        assert half_sigma == [each / 2 for each in sigma]
        assert images.disparity.shape == images.error.shape == images.confidence.shape == (HEIGHT, WIDTH)
        assert (images.disparity == 80).all()
        assert (images.error == doubled).all()
        assert (images.confidence == 200).all()


def test_holes_are_filled_from_the_dark_images(monkeypatch: pytest.MonkeyPatch) -> None:
    matcher = FakeMatcher(call2=(80, 3, 200))
    images = match(monkeypatch, matcher, pair(0.0), settings(double_shot=True), pair(12.0))
    assert [call[0] for call in matcher.calls] == [(HEIGHT, WIDTH)] * 2
    assert matcher.calls[1][2] == pair(12.0).noise_sigma(1.0, 1, 2, has_pattern=False).tolist()
    assert (images.disparity == 80).all()


def test_the_first_match_counts_where_there_are_two(monkeypatch: pytest.MonkeyPatch) -> None:
    matcher = FakeMatcher(call1=(80, 3, 200), call2=(96, 5, 250))
    images = match(monkeypatch, matcher, pair(), settings(double_shot=True), pair())
    for values, expected in ((images.disparity, 80), (images.error, 3), (images.confidence, 200)):
        assert (values == expected).all()


@pytest.mark.parametrize("double_shot", [False, True])
@pytest.mark.parametrize(
    ("x", "y", "width", "height"),
    [(20, 10, 60, 40), (0, 0, 128, 97), (100, 80, 400, 400), (126, 0, 9, 9), (128, 0, 64, 64), (0, 98, 64, 64)],
)
def test_only_the_depth_region_is_measured(
    x: int, y: int, width: int, height: int, double_shot: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    region = settings(roi_offset_x=x, roi_offset_y=y, roi_width=width, roi_height=height, double_shot=double_shot)
    everywhere = (80, 3, 200)
    images = match(monkeypatch, FakeMatcher(call1=everywhere, call2=(40, 2, 200)), pair(), region, None)
    inside = np.zeros((HEIGHT, WIDTH), np.bool_)
    inside[y // 2 : -(-(y + height) // 2), x // 2 : -(-(x + width) // 2)] = True
    np.testing.assert_array_equal(images.disparity > 0, inside)


def test_the_region_is_searched_to_the_left_as_far_as_disparities_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    matcher = FakeMatcher()
    match(monkeypatch, matcher, pair(), settings(roi_offset_x=20, roi_offset_y=10, roi_width=60, roi_height=40), None)
    ((shape, count, *_),) = matcher.calls
    assert shape == (20, 30 + min(10, count))
