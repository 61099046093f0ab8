"""Ground-truth depth of analytic scenes: geometry, holes, filters."""

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.profile import read_profile
from renderers.stereo.depth.depth_images import DepthRange, true_disparity
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
