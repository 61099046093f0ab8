"""Ground-truth depth of analytic scenes: geometry, holes, error model, confidence."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.stereo.depth_images import DepthImages
from renderers.stereo.errors import add_errors, choose_error_scale
from renderers.stereo.filters import Filters, apply_filters
from renderers.stereo.model import MODELS, Quality, StereoModel
from renderers.stereo.noise import NoiseStream, frame_key
from renderers.stereo.truth import DepthRange, true_disparity
from tests.stereo.analytic import plane, sphere

MODEL = MODELS["rc_visard 160-4"]
RANGE = DepthRange(0.4, 100.0)

ACCURACY_MM = {
    "rc_visard 65-4": (0.9, 3.6, 14.2, 32.1),
    "rc_visard 160-4": (0.4, 1.5, 5.8, 13.0),
    "rc_visard 160-6": (0.3, 1.0, 3.9, 8.8),
}
"""The manual's depth accuracy at 0.5, 1, 2 and 3 m."""


def scene(model: StereoModel, quality: Quality) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return depth from left, depth from right, and exact disparity of a sphere before a slanted plane."""
    k = model.intrinsics(quality.divisor)
    left, right = (
        np.minimum(plane(k, x, 2.0, 0.3, 0.1), sphere(k, x, (0.1, 0.1, 1.2), 0.25)) for x in (0.0, model.baseline)
    )
    return left, right, true_disparity(left, right, k.focal_length * model.baseline, RANGE)


@pytest.mark.parametrize("quality", list(Quality))
def test_depth_by_the_manuals_formula_equals_rendered_depth(quality: Quality) -> None:
    k = MODEL.intrinsics(quality.divisor)
    left, _, exact_disparity = scene(MODEL, quality)
    images = add_errors(exact_disparity, 0.0, frame_key(0, 0, NoiseStream.DISPARITY))
    valid = images.disparity > 0
    assert valid.mean() > 0.7
    # d = f t / z: the difference is the rounding to 1/16 pixel and nothing else.
    exact = k.focal_length * MODEL.baseline / left[valid].astype(np.float64)
    assert np.abs(images.disparity[valid] / 16 - exact).max() <= 1 / 32 + 1e-4


@pytest.mark.parametrize("quality", [Quality.HIGH, Quality.LOW])
def test_measures_only_points_seen_by_both_cameras(quality: Quality) -> None:
    k = MODEL.intrinsics(quality.divisor)
    left, _, exact_disparity = scene(MODEL, quality)
    focal_times_baseline = k.focal_length * MODEL.baseline
    column = np.arange(k.width) + 0.5
    seen = 0
    for row in range(0, k.height, 7):
        d = focal_times_baseline / left[row].astype(np.float64)
        x = column - d
        # A point is hidden when nearer ones of its row land on both sides of it in the right image.
        gap, nearer = x - x[:, None], d > d[:, None] + 3.0
        hidden = ((gap > -2.1) & (gap < -0.9) & nearer).any(1) & ((gap > 0.9) & (gap < 2.1) & nearer).any(1)
        clear = ~((np.abs(gap) < 2.5) & (d > d[:, None] + 0.2)).any(1)
        assert not (exact_disparity[row][hidden] > 0).any(), "hidden points must be holes"
        seen += int(hidden.sum())
        assert not (exact_disparity[row][x < -0.5] > 0).any(), "points beside the right image must be holes"
        assert (exact_disparity[row][clear & (x > 0.5)] > 0).all(), "visible points must be images"
    assert seen > 100


def test_depth_range_cuts_both_ends() -> None:
    k = MODEL.intrinsics(2)
    left = plane(k, 0.0, 2.0, 0.8)
    right = plane(k, MODEL.baseline, 2.0, 0.8)
    exact_disparity = true_disparity(left, right, k.focal_length * MODEL.baseline, DepthRange(1.8, 2.2))
    assert (exact_disparity > 0).any()
    assert left[exact_disparity > 0].min() >= 1.8
    assert left[exact_disparity > 0].max() <= 2.2


@pytest.mark.parametrize("model", list(MODELS.values()), ids=lambda images: images.name)
def test_depth_error_matches_the_accuracy_table(model: StereoModel) -> None:
    k = model.intrinsics(1)
    focal_times_baseline = k.focal_length * model.baseline
    for depth, published in zip((0.5, 1.0, 2.0, 3.0), ACCURACY_MM[model.name], strict=True):
        exact_disparity = np.full((k.height, k.width), focal_times_baseline / depth, np.float32)
        d = add_errors(exact_disparity, 0.25, frame_key(3, 1, NoiseStream.DISPARITY)).disparity / 16
        millimetres = float(np.std(focal_times_baseline / d)) * 1000
        assert millimetres == pytest.approx(0.25 * depth**2 / focal_times_baseline * 1000, rel=0.05)
        assert millimetres == pytest.approx(published, abs=0.1)


def test_error_unit_is_a_sixteenth_where_sufficient() -> None:
    exact_disparity = np.full((100, 100), 50.0, np.float32)
    for sigma, unit in ((0.25, 4), (0.125, 2), (0.0625, 1), (0.26, 4)):
        assert choose_error_scale(sigma, 100) == 1 / 16
        assert set(np.unique(add_errors(exact_disparity, sigma, np.uint64(9)).error)) == {unit}


@pytest.mark.parametrize("disparity_error", [0.25, 0.7])
@pytest.mark.parametrize(("quality", "averaged"), [*((q, 1) for q in Quality), (Quality.FULL, 8), (Quality.HIGH, 8)])
def test_error_image_is_the_standard_deviation_within_five_percent(
    quality: Quality, averaged: int, disparity_error: float
) -> None:
    # Not a multiple of 1/16 anywhere: disparities on a slope too small for outliers.
    exact_disparity = np.linspace(40.0, 41.0, 200_000, dtype=np.float32).reshape(400, 500)
    sigma = disparity_error / quality.divisor / averaged**0.5
    scale = choose_error_scale(sigma, MODEL.disparity_count(quality.divisor, 0.1))
    images = add_errors(exact_disparity, sigma, np.uint64(9), scale)
    (unit,) = np.unique(images.error)
    assert unit * scale == pytest.approx(sigma, rel=0.05)
    if sigma > 1 / 32:  # below, rounding to 1/16 pixel is most of the error
        assert np.std(images.disparity / 16 - exact_disparity) == pytest.approx(sigma, rel=0.05)


@pytest.mark.parametrize("disparities", [1, 72, 433, 2032])
@pytest.mark.parametrize("sigma", [0.0, 1e-9, 1e-4, 0.02, 0.3, 20.0])
def test_disparities_fit_into_16_bits_at_every_scale(sigma: float, disparities: int) -> None:
    scale = choose_error_scale(sigma, disparities)
    assert (disparities + 4 * sigma) / scale < 65536
    factor = 1 / 16 / scale
    assert factor >= 1
    assert factor.is_integer()


def test_confidence_is_the_probability_defined_by_the_manual() -> None:
    k = MODEL.intrinsics(1)
    focal_times_baseline = k.focal_length * MODEL.baseline
    # Planes from frontal to steep make all confidences appear.
    counts = np.zeros(256, np.int64)
    within = np.zeros(256, np.int64)
    for frame, slope in enumerate((0.0, 1.2, 2.2, 3.2, 4.2, 5.2)):
        left = plane(k, 0.0, 1.2, slope)
        exact_disparity = true_disparity(left, plane(k, MODEL.baseline, 1.2, slope), focal_times_baseline, RANGE)
        images = add_errors(exact_disparity, 0.25, frame_key(5, frame, NoiseStream.DISPARITY))
        valid = images.disparity > 0
        inside = np.abs(images.disparity[valid] / 16 - exact_disparity[valid]) <= 3 * images.error[valid] / 16
        counts += np.bincount(images.confidence[valid], minlength=256)
        within += np.bincount(images.confidence[valid], weights=inside, minlength=256).astype(np.int64)
    for low, high in ((26, 77), (102, 141), (141, 191), (191, 242), (242, 256)):
        n = counts[low:high].sum()
        assert n > 5000, f"no pixels with a confidence of {low} to {high}"
        claimed = (counts[low:high] * np.arange(low, high)).sum() / n / 255
        seen = within[low:high].sum() / n
        assert seen == pytest.approx(claimed, abs=4 * np.sqrt(claimed * (1 - claimed) / n) + 1 / 255)


def test_noise_is_determined_by_seed_and_frame() -> None:
    exact_disparity = scene(MODEL, Quality.LOW)[2]

    def make(seed: int, frame: int) -> bytes:
        images = add_errors(exact_disparity, 0.05, frame_key(seed, frame, NoiseStream.DISPARITY))
        return images.disparity.tobytes() + images.confidence.tobytes()

    assert make(1, 1) == make(1, 1)
    assert len({make(1, 1), make(1, 2), make(2, 1)}) == 3


def block(disparity: NDArray[np.uint16], error: int = 2, confidence: int = 254) -> DepthImages:
    valid = disparity > 0
    return DepthImages(
        disparity.copy(), np.where(valid, error, 0).astype(np.uint8), np.where(valid, confidence, 0).astype(np.uint8)
    )


def test_removes_small_segments() -> None:
    d = np.zeros((60, 60), np.uint16)
    d[2:6, 2:6] = 800  # 16 pixels
    d[20:50, 20:50] = 800
    images = block(d)
    apply_filters(images, Filters(seg=17, fill=0), 88.0, 2)
    assert not images.disparity[:10].any()
    assert not images.confidence[:10].any()
    assert (images.disparity[20:50, 20:50] == 800).all()
    images = block(d)
    apply_filters(images, Filters(seg=16, fill=0), 88.0, 2)
    assert (images.disparity == d).all()


def test_holes_are_filled_up_to_the_step_on_their_border() -> None:
    d = np.full((60, 60), 800, np.uint16)
    d[:, 30:] = 832  # two pixels farther on
    d[10:13, 28:32] = 0
    d[30:33, 10:13] = 0
    d[0:3, 40:43] = 0  # at the edge of the image: nothing to interpolate between
    for fill, fills_across_step in ((3, True), (1, False), (0, False)):
        images = block(d)
        apply_filters(images, Filters(seg=0, fill=fill), 88.0, 2)
        assert (images.disparity[10:13, 28:32] > 0).all() == fills_across_step
        assert (images.disparity[30:33, 10:13] == 800).all() == (fill > 0)
        assert not images.disparity[0:3, 40:43].any()
        if fills_across_step:
            assert ((images.disparity[10:13, 28:32] > 800) & (images.disparity[10:13, 28:32] < 832)).all()
            assert (images.confidence[10:13, 28:32] == 128).all()


@pytest.mark.parametrize(("minconf", "filled"), [(0.5, True), (128 / 255, True), (0.51, False), (1.0, False)])
def test_minimum_confidence_applies_to_filled_pixels(minconf: float, filled: bool) -> None:
    d = np.full((60, 60), 800, np.uint16)
    d[30:33, 10:13] = 0
    images = block(d, confidence=255)
    apply_filters(images, Filters(minconf=minconf, seg=0), 88.0, 2)
    assert images.disparity[30:33, 10:13].all() == filled
    assert images.confidence[images.disparity > 0].min() >= minconf * 255


def test_at_most_five_percent_are_filled_smallest_first() -> None:
    d = np.full((100, 100), 800, np.uint16)
    d[10:40, 10:40] = 0  # 9 %
    d[60:64, 60:64] = 0
    images = block(d)
    apply_filters(images, Filters(seg=0), 88.0, 2)
    assert not images.disparity[10:40, 10:40].any()
    assert images.disparity[60:64, 60:64].all()


def test_depth_error_and_confidence_limits() -> None:
    d = np.array([[160, 320, 640, 1280]], np.uint16)
    focal_times_baseline = 88.0
    images = block(np.repeat(d, 3, axis=0))
    z = focal_times_baseline / (d[0] / 16.0)
    z_eps = 2 / 16 * z**2 / focal_times_baseline
    apply_filters(images, Filters(maxdeptherr=float(z_eps[1]) * 1.001, seg=0, fill=0), focal_times_baseline, 2)
    assert (images.disparity[0] > 0).tolist() == [False, True, True, True]
    images = block(np.repeat(d, 3, axis=0), confidence=150)
    apply_filters(images, Filters(minconf=0.6, seg=0, fill=0), focal_times_baseline, 2)
    assert not images.disparity.any()
    images = block(np.repeat(d, 3, axis=0))
    apply_filters(images, Filters(mindepth=float(z[2]), maxdepth=float(z[1]), seg=0, fill=0), focal_times_baseline, 2)
    assert (images.disparity[0] > 0).tolist() == [False, True, True, False]


def test_intrinsics_are_exact_fractions() -> None:
    model = StereoModel("x", 1280, 960, 0.862789, 0.16005)
    low = model.intrinsics(6)
    assert (low.width, low.height) == (214, 160)
    assert low.focal_length == pytest.approx(1104.37 / 6, rel=1e-5)
    assert [low.cx, low.cy] == pytest.approx([640 / 6, 80.0])
    high = model.intrinsics(2)
    assert (high.width, high.height) == (640, 480)
    assert high.focal_length == pytest.approx(552.185, rel=1e-5)
    assert model.disparity_count(2, 0.1) == 221  # ceil(552.185 * 0.16005 / (2.5 * 0.16005))
