"""Ground-truth depth of analytic scenes: geometry, holes, filters."""

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.profile import read_profile
from renderers.stereo.depth.depth_images import DepthImages, DepthRange, exact_images, true_disparity
from renderers.stereo.depth.filters import Filters, apply_filters
from renderers.stereo.model import Quality, StereoModel
from tests.adapters.stereo.analytic import plane, sphere

MODEL = read_profile("rc_visard_160c").model
RANGE = DepthRange(0.4, 100.0)


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
    images = exact_images(exact_disparity)
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
