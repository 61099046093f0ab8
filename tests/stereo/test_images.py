"""Sensor, projector and matching on arrays."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.stereo.profile import read_profile
from renderers.stereo.downscale import fine_means
from renderers.stereo.exposure import AutoExposure, Exposure, auto_exposure, brightness_of
from renderers.stereo.matching import match_pair
from renderers.stereo.model import Quality
from renderers.stereo.noise import NoiseStream, frame_key
from renderers.stereo.pixel_classes import ImageKind
from renderers.stereo.projector import projected_dots
from renderers.stereo.sensor import sensor_image
from renderers.stereo.truth import DepthRange, true_disparity
from tests.stereo.analytic import plane, sphere

MODEL = read_profile("rc_visard_160c").model
KEY = frame_key(0, 0, NoiseStream.LEFT)


def grey(level: int, shape: tuple[int, int] = (240, 320)) -> NDArray[np.uint8]:
    return np.full((*shape, 3), level, np.uint8)


def test_reference_exposure_keeps_the_rendered_image() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)
    color = sensor_image(picture, Exposure(), KEY, color=True, noise_factor=0.0).image
    assert np.abs(color.astype(int) - picture).max() <= 1
    luma = picture @ np.array((0.299, 0.587, 0.114))
    assert np.abs(sensor_image(picture, Exposure(), KEY, color=False, noise_factor=0.0).image - luma).max() <= 1


def test_exposure_and_gain_multiply_light() -> None:
    twice = sensor_image(grey(100), Exposure(0.010), KEY, color=False, noise_factor=0.0).image.mean()
    assert twice == pytest.approx(100 * 2 ** (1 / 2.2), abs=1)
    six = sensor_image(grey(100), Exposure(0.005, 6.0206), KEY, color=False, noise_factor=0.0).image.mean()
    assert six == pytest.approx(twice, abs=1)
    assert sensor_image(grey(250), Exposure(0.018), KEY, color=False, noise_factor=0.0).image.min() == 255
    bright = sensor_image(grey(100), Exposure(gamma=2.0), KEY, color=False, noise_factor=0.0).image.mean()
    assert bright == pytest.approx(255 * (100 / 255) ** 0.5, abs=1)


@pytest.mark.parametrize("gain", [9.0, 12.0, 18.0])
def test_noise_matches_the_message(gain: float) -> None:
    exposure = Exposure(0.005 / 10 ** (gain / 20), gain)  # the same brightness
    image = sensor_image(grey(128, (960, 1280)), exposure, KEY, color=False).image.astype(float)
    # Rounding to whole levels adds 1/12.
    assert image.std() == pytest.approx(np.sqrt(exposure.noise_sigma(128) ** 2 + 1 / 12), rel=0.15)
    assert image.mean() == pytest.approx(128, abs=0.6)


def test_left_and_right_noise_is_independent() -> None:
    a, b = (
        sensor_image(grey(128), Exposure(0.0006, 18.0), frame_key(0, 0, s), color=False).image.astype(float).ravel()
        for s in (NoiseStream.LEFT, NoiseStream.RIGHT)
    )
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.02


def test_automatic_exposure_meets_its_target() -> None:
    for level in (20, 60, 120):
        exposure = auto_exposure(brightness_of(grey(level)), AutoExposure())
        assert sensor_image(grey(level), exposure, KEY, color=False, noise_factor=0.0).brightness == pytest.approx(
            min(0.75, level / 255 * Exposure(0.018, 18.0).display_factor), abs=0.02
        )
    # With something white in the picture it stays as bright as it can without saturating.
    picture = grey(60)
    picture[:, :100] = 250
    exposure = auto_exposure(brightness_of(picture), AutoExposure())
    assert int(sensor_image(picture, exposure, KEY, color=False, noise_factor=0.0).image.max()) >= 252
    # Longest time first, gain only after it.
    assert auto_exposure(brightness_of(grey(130)), AutoExposure()).gain == 0
    assert auto_exposure(brightness_of(grey(20)), AutoExposure(0.001)).time == 0.001


def test_dots_are_fixed_to_the_surface() -> None:
    k = MODEL.intrinsics(2)
    t = MODEL.baseline
    views = [plane(k, x, 1.5) for x in (0.0, t)]
    left, right = (
        projected_dots(z, k.focal_length, k.cx, k.cy, x - t / 2, np.full_like(z, np.inf)).astype(float)
        for x, z in zip((0.0, t), views, strict=True)
    )
    shift = k.focal_length * t / 1.5
    whole = int(shift)
    share = shift - whole
    x = np.arange(whole + 2, k.width)
    seen = right[:, x - whole - 1] * share + right[:, x - whole] * (1 - share)
    assert np.corrcoef(seen.ravel(), left[:, x].ravel())[0, 1] > 0.9
    assert np.corrcoef(right[:, x].ravel(), left[:, x].ravel())[0, 1] < 0.3
    background = np.full((8, 8), np.inf, np.float32)
    assert not projected_dots(background, 100.0, 4.0, 4.0, 0.0, background).any()


def test_objects_cast_shadows_in_the_projectors_light() -> None:
    k, t = MODEL.intrinsics(2), MODEL.baseline
    center, radius = (0.0, 0.0, 1.0), 0.2

    def depth(x: float) -> NDArray[np.float32]:
        return np.minimum(plane(k, x, 2.0), sphere(k, x, center, radius))

    left = depth(-t / 2)
    lit = projected_dots(left, k.focal_length, k.cx, k.cy, -t / 2, np.full_like(left, np.inf))
    shaded = projected_dots(left, k.focal_length, k.cx, k.cy, -t / 2, depth(0.0))
    dark = (lit > 0) & (shaded == 0)
    assert (shaded[~dark] == lit[~dark]).all()
    assert np.allclose(left[dark], 2.0), "only the wall is in shadow"
    # The sphere's shadow from the middle, in the frame of the left camera, on the row of its centre: two crescents, of
    # which the left camera sees the one that is on its own side.
    edge = 2.0 * np.tan(np.arcsin(radius / center[2]))
    x = (np.arange(k.width) + 0.5 - k.cx) / k.focal_length * 2.0 - t / 2
    row = k.height // 2
    inside = (np.abs(x) < edge - 0.02) & (left[row] > 1.5) & (lit[row] > 0)
    beside = (np.abs(x) > edge + 0.02) & (lit[row] > 0)
    assert inside.sum() > 10
    assert dark[row][inside].all()
    assert not dark[row][beside].any()


@pytest.mark.parametrize("quality", [Quality.HIGH, Quality.MEDIUM, Quality.LOW])
def test_matching_with_the_projector(quality: Quality) -> None:
    k = MODEL.intrinsics(quality.divisor)
    depths, images = [], []
    for number, x in enumerate((0.0, MODEL.baseline)):
        z = np.minimum(plane(k, x, 2.0, 0.3, 0.1), sphere(k, x, (0.1, 0.1, 1.2), 0.25))
        dots = projected_dots(z, k.focal_length, k.cx, k.cy, x - MODEL.baseline / 2, np.full_like(z, np.inf))
        key = frame_key(1, 1, NoiseStream(number + 1))
        depths.append(z)
        images.append(sensor_image(grey(90, z.shape), Exposure(), key, color=False, dots=dots, dot_light=2.0).image)
    true = true_disparity(depths[0], depths[1], k.focal_length * MODEL.baseline, DepthRange(0.4, 100))
    left, right = (fine_means(image, 1, *image.shape) for image in images)
    measured = match_pair(left, right, MODEL.disparity_count(quality.divisor, 0.1), 0.3, ImageKind.DOTS)
    sure = (true > 0) & (measured.confidence >= 128)
    assert sure.sum() / (true > 0).sum() > 0.95
    error = np.abs(measured.disparity / 16 - true)
    assert (error[sure] > 1).mean() < 0.01
    # The confidence is a promise: that share lies within three standard deviations.
    within = error <= 3 * measured.error / 16
    assert within[sure].mean() == pytest.approx(measured.confidence[sure].mean() / 255, abs=0.03)


def test_matching_a_blank_wall_is_invalid() -> None:
    image = sensor_image(grey(120), Exposure(), KEY, color=False).image
    other = sensor_image(grey(120), Exposure(), frame_key(0, 0, NoiseStream.RIGHT), color=False).image
    left, right = (fine_means(i, 1, *i.shape) for i in (image, other))
    measured = match_pair(left, right, 64, 0.3, ImageKind.PLAIN)
    assert (measured.confidence >= 128).mean() < 0.2
