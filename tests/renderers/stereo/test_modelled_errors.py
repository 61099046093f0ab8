"""Modelled depth of analytic scenes: magnitude, correlation, holes, fattening and confidence of the errors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.profile import read_profile
from renderers.stereo.depth.depth_images import DepthImages, DepthRange, true_disparity
from renderers.stereo.depth.modelled_errors import ErrorModel, choose_error_scale, measured_images
from renderers.stereo.depth.pixel_classes import RADIUS, ImageKind
from renderers.stereo.model import Quality
from tests.adapters.stereo.analytic import plane, sphere

MODEL = read_profile("rc_visard_160c").model
RANGE = DepthRange(0.4, 100.0)
NOISE = 0.3
ACCURACY_MM = {
    "rc_visard_65c": (0.9, 3.6, 14.2, 32.1),
    "rc_visard_160c": (0.4, 1.5, 5.8, 13.0),
    "rc_visard_160m_6mm": (0.3, 1.0, 3.9, 8.8),
}
"""The manual's depth accuracy at 0.5, 1, 2 and 3 m."""


def images_of(
    disparity: NDArray[np.float32], contrast: float = 25.0, seed: int = 0
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return left and right images of a surface with a random texture, (H, W) uint16, with noise.

    Args:
        disparity: (H, W) float32, pixels.
        contrast: standard deviation of the texture, grey levels.
        seed: seed of texture and noise.
    """
    random = np.random.default_rng(seed)
    height, width = disparity.shape
    padded = int(disparity.max()) + 4
    texture = random.normal(128.0, contrast, (height, width + padded + 1))
    texture = (texture[:, 1:] + texture[:, :-1]) / 2**0.5 - 128.0 * (2**0.5 - 1.0)
    column = np.arange(width + padded, dtype=np.float64) - padded
    seen = np.stack([np.interp(column[padded:] - disparity[y], column, texture[y]) for y in range(height)])
    left, right = (
        np.clip(image + random.normal(0.0, NOISE, image.shape) + 0.5, 0, 255).astype(np.uint8) * np.uint16(16)
        for image in (seen, texture[:, padded:])
    )
    return left, right


def visible(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the disparity of the pixels that the right camera sees, 0 elsewhere."""
    return np.where(np.arange(disparity.shape[1]) >= disparity, disparity, np.float32(0.0))


def measured(
    disparity: NDArray[np.float32], sigma: float = 0.125, contrast: float = 25.0, seed: int = 0
) -> DepthImages:
    pair = images_of(disparity, contrast, seed)
    return measured_images(visible(disparity), *pair, ErrorModel(sigma, NOISE, ImageKind.PLAIN))


def deviations(disparity: NDArray[np.float32], images: DepthImages) -> NDArray[np.float32]:
    """Return measured minus exact disparity, (H, W), pixels; NaN where invalid."""
    return np.where(images.disparity > 0, images.disparity / np.float32(16) - disparity, np.float32(np.nan))


@pytest.mark.parametrize("profile", list(ACCURACY_MM))
def test_depth_error_matches_the_accuracy_table(profile: str) -> None:
    model = read_profile(profile).model
    factor = model.focal_times_baseline()
    for depth, published in zip((0.5, 1.0, 2.0, 3.0), ACCURACY_MM[profile], strict=True):
        disparity = np.full((240, 1280), factor / depth, np.float32)
        frames = [measured(disparity, 0.25, seed=seed) for seed in range(6)]
        deviation = np.stack([deviations(disparity, images) for images in frames])
        right = deviation[np.abs(deviation) < 1.0]
        assert len(right) > 0.55 * deviation.size
        errors = factor / (factor / depth + right) - depth
        millimetres = float(np.sqrt(np.mean(errors**2))) * 1000
        assert millimetres == pytest.approx(0.25 * depth**2 / factor * 1000, rel=0.06)
        assert millimetres == pytest.approx(published, rel=0.1, abs=0.1)


def test_errors_of_neighbours_are_alike() -> None:
    """Smooth along columns. Along rows as a matcher's, whose errors come from the left and right borders of windows."""
    disparity = np.full((480, 640), 30.03, np.float32)
    deviation = deviations(disparity, measured(disparity))
    deviation[np.abs(deviation) > 0.6] = np.nan

    def correlation(rows: int, columns: int) -> float:
        pairs = np.stack((deviation[rows:, columns:], deviation[: 480 - rows, : 640 - columns])).reshape(2, -1)
        one, other = pairs[:, np.isfinite(pairs).all(axis=0)]
        return float((one * other).mean() / (one.std() * other.std()))

    assert 0.6 < correlation(0, 1) < 0.85
    assert correlation(1, 0) > 0.9
    assert 0.1 < correlation(0, 8) < 0.7
    assert abs(correlation(0, 120)) < 0.1
    assert correlation(8, 0) < 0.5  # otherwise there are streaks
    assert 0.01 < np.nanstd(np.diff(deviation, axis=0)) / 2**0.5 < 0.05


def noisy_again(
    pair: tuple[NDArray[np.uint16], NDArray[np.uint16]], seed: int
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return the images with the noise of another frame added."""
    random = np.random.default_rng(seed)
    left, right = (
        np.clip(image + 16.0 * random.normal(0.0, 0.1, image.shape), 0, 4080).astype(np.uint16) for image in pair
    )
    return left, right


def slanted() -> NDArray[np.float32]:
    """Return the disparity of a slanted wall, (480, 640) float32, pixels."""
    return np.tile(np.linspace(24.0, 36.0, 640, dtype=np.float32), (480, 1))


def test_errors_of_a_static_scene_stay_but_for_a_small_part() -> None:
    disparity, model = slanted(), ErrorModel(0.125, NOISE, ImageKind.PLAIN)
    pair = images_of(disparity)
    frames = [measured_images(visible(disparity), *noisy_again(pair, seed), model) for seed in range(4)]
    errors = np.stack([deviations(disparity, images) for images in frames])
    both = (np.abs(errors) < 0.6).all(axis=0)
    assert 0.9 < np.corrcoef(errors[0][both], errors[1][both])[0, 1] < 0.9999
    holes = np.stack([images.disparity == 0 for images in frames])
    assert (holes.any(axis=0) & ~holes.all(axis=0)).mean() < 0.03


def test_errors_follow_the_texture_across_the_image() -> None:
    """Moved by whole pixels, a surface keeps its errors: they are not fixed to the image."""
    disparity, model = np.full((200, 600), 30.43, np.float32), ErrorModel(0.125, NOISE, ImageKind.PLAIN)
    pair = images_of(disparity)
    before = deviations(disparity, measured_images(visible(disparity), *pair, model))
    left, right = (np.ascontiguousarray(np.roll(image, 40, axis=1)) for image in pair)
    after = np.roll(deviations(disparity, measured_images(visible(disparity), left, right, model)), -40, axis=1)

    def correlation(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
        pairs = np.stack((one[:, 60:500], other[:, 60:500]))
        pairs = pairs[:, (np.abs(pairs) < 0.6).all(axis=0)]
        return float(np.corrcoef(*pairs)[0, 1])

    assert correlation(before, after) > 0.95
    assert abs(correlation(before, np.roll(before, 40, axis=1))) < 0.3


def test_errors_prefer_whole_disparities() -> None:
    disparity = slanted()
    error = deviations(disparity, measured(disparity))
    phase, right = np.floor(disparity % 1.0 * 8.0), np.abs(error) < 0.5
    means = [float(error[right & (phase == number)].mean()) for number in range(8)]
    assert -0.07 < min(means[:4]) < -0.03
    assert 0.03 < max(means[4:]) < 0.07


def test_equal_images_give_equal_bytes() -> None:
    disparity = np.full((120, 160), 20.0, np.float32)
    pair, model = images_of(disparity), ErrorModel(0.125, NOISE, ImageKind.PLAIN)
    one, other = (measured_images(disparity, *pair, model) for _ in range(2))
    for name in ("disparity", "error", "confidence"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_surfaces_without_texture_have_no_confident_depth() -> None:
    disparity = np.full((240, 320), 30.0, np.float32)
    for contrast, least, most in ((0.0, 0.0, 0.02), (25.0, 0.95, 1.0)):
        confident = measured(disparity, contrast=contrast).confidence[:, 40:] >= 128
        assert least <= confident.mean() <= most


def test_errors_grow_where_contrast_falls() -> None:
    disparity = np.full((240, 320), 30.03, np.float32)
    errors, spreads = [], []
    for contrast in (1.0, 3.0, 30.0):
        images = measured(disparity, contrast=contrast)
        deviation = deviations(disparity, images)
        valid = images.disparity > 0
        errors.append(float(images.error[valid].mean()))
        spreads.append(float(deviation[np.abs(deviation) < 1.0].std()))
    assert errors[0] > errors[1] >= errors[2]
    assert spreads[0] > 1.5 * spreads[2]


def test_foreground_is_wider_than_it_is() -> None:
    k = MODEL.intrinsics(2)
    depths = [np.minimum(plane(k, x, 2.0), sphere(k, x, (0.1, 0.0, 1.0), 0.2)) for x in (0.0, MODEL.baseline)]
    factor = k.focal_length * MODEL.baseline
    exact = true_disparity(depths[0], depths[1], factor, RANGE)
    pair = images_of(np.asarray(factor / depths[0], np.float32))
    images = measured_images(exact, *pair, ErrorModel(0.125, NOISE, ImageKind.PLAIN))
    in_front = depths[0] < 1.5
    near = images.disparity / 16.0 > factor / 1.5
    border = np.zeros_like(in_front)
    for dy in range(-RADIUS, RADIUS + 1):
        for dx in range(-RADIUS, RADIUS + 1):
            border |= np.roll(in_front, (dy, dx), (0, 1))
    added = near & border & ~in_front
    assert 0.002 < added.sum() / in_front.sum() < 0.1
    far = images.disparity[~border & (images.disparity > 0)] / 16.0
    assert (far > factor / 1.5).mean() < 0.01, "no farther than a window reaches, but for wrong matches"


def test_confidence_is_the_probability_defined_by_the_manual() -> None:
    counts, within = np.zeros(256), np.zeros(256)
    for frame in range(12):
        contrast = (0.4, 0.6, 0.8, 1.0, 2.0, 20.0)[frame % 6]
        disparity = np.full((480, 640), 30.03, np.float32)
        images = measured(disparity, contrast=contrast, seed=frame)
        valid = images.disparity > 0
        inside = np.abs(deviations(disparity, images)[valid]) <= 3 * images.error[valid] / 16
        counts += np.bincount(images.confidence[valid], minlength=256)
        within += np.bincount(images.confidence[valid], weights=inside, minlength=256)
    bins = 0
    for low in range(0, 256, 32):
        n = counts[low : low + 32].sum()
        if n > 5_000:
            bins += 1
            promised = (counts[low : low + 32] * np.arange(low, low + 32)).sum() / n / 255
            assert within[low : low + 32].sum() / n == pytest.approx(promised, abs=0.05)
    assert bins >= 3


def test_plain_surfaces_have_matches_only_near_texture() -> None:
    """Disparities are carried from texture into plain surfaces, as by semi-global matching."""
    disparity = np.full((240, 640), 30.03, np.float32)
    plain, textured = images_of(disparity, 0.0), images_of(disparity)
    for image, texture in zip(plain, textured, strict=True):
        image[:, :200] = texture[:, :200]
    model = ErrorModel(0.125, NOISE, ImageKind.PLAIN)
    found = measured_images(visible(disparity), *plain, model).disparity > 0
    assert found[:, 40:160].mean() > 0.9
    assert found[:, 205:245].mean() > 3.0 * found[:, 500:].mean()
    assert found[:, 500:].mean() < 0.2
    blank = measured_images(visible(disparity), *images_of(disparity, 0.0), model).disparity > 0
    assert blank.mean() < 0.02


def test_error_unit_is_a_sixteenth_where_sufficient() -> None:
    disparity = np.full((100, 100), 50.0, np.float32)
    for sigma, unit in ((0.25, 4), (0.125, 2), (0.0625, 1), (0.26, 4)):
        assert choose_error_scale(sigma, 100) == 1 / 16
        images = measured(disparity, sigma)
        assert np.median(images.error[images.disparity > 0]) == unit


@pytest.mark.parametrize("disparity_error", [0.25, 0.7])
@pytest.mark.parametrize(("quality", "averaged"), [*((q, 1) for q in Quality), (Quality.FULL, 8), (Quality.HIGH, 8)])
def test_error_image_is_the_standard_deviation_on_good_texture(
    quality: Quality, averaged: int, disparity_error: float
) -> None:
    disparity = np.full((400, 500), 40.03, np.float32)
    sigma = disparity_error / quality.divisor / averaged**0.5
    scale = choose_error_scale(sigma, MODEL.disparity_count(quality.divisor, 0.1))
    images = measured_images(
        visible(disparity), *images_of(disparity), ErrorModel(sigma, NOISE, ImageKind.PLAIN, scale)
    )
    unit = np.median(images.error[images.disparity > 0])
    assert unit * scale == pytest.approx(sigma, rel=0.05)
    if sigma > 1 / 32:  # below, rounding to 1/16 pixel is most of the error
        deviation = deviations(disparity, images)
        right = deviation[(images.error == unit) & (np.abs(deviation) <= 3 * sigma)]
        assert np.std(right) == pytest.approx(sigma, rel=0.1)


@pytest.mark.parametrize("disparities", [1, 72, 433, 2032])
@pytest.mark.parametrize("sigma", [0.0, 1e-9, 1e-4, 0.02, 0.3, 20.0])
def test_disparities_fit_into_16_bits_at_every_scale(sigma: float, disparities: int) -> None:
    scale = choose_error_scale(sigma, disparities)
    assert (disparities + 4 * sigma) / scale < 65536
    factor = 1 / 16 / scale
    assert factor >= 1
    assert factor.is_integer()


def test_disparities_are_never_beyond_the_right_image() -> None:
    disparity = np.full((60, 80), 12.0, np.float32)
    disparity[:, :12] = 0.0
    units = measured(disparity, 0.5).disparity
    column = np.arange(80) * 16
    assert (units <= column + 8).all()
