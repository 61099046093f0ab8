"""Matching of camera images with soft dots."""

from contextlib import closing

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gateway.adapters.stereo.device.profile import read_profile
from renderers.raster import CpuRenderer
from renderers.stereo.depth.depth_images import DepthRange, true_disparity
from renderers.stereo.depth.matching import MIN_HEIGHT_OF_BANDS, fine_means, match_pair
from renderers.stereo.light.projector import projected_dots
from renderers.stereo.model import Quality
from renderers.stereo.sensor.camera_image import (
    LENS_BLUR,
    Lens,
    NoiseStream,
    SceneLight,
    fixed_pattern,
    frame_key,
    image_from_light,
    light_on_sensor,
    roots_of,
)
from renderers.stereo.sensor.exposure import Exposure
from tests.adapters.stereo.analytic import plane, sphere

MODEL = read_profile("rc_visard_160c").model
NOISE = np.full(256, 0.3)


@pytest.mark.parametrize("quality", [Quality.HIGH, Quality.MEDIUM, Quality.LOW])
def test_matching_with_soft_dots(quality: Quality) -> None:
    k = MODEL.intrinsics(quality.divisor)
    depths, images = [], []
    for number, x in enumerate((0.0, MODEL.baseline)):
        z = np.minimum(plane(k, x, 2.0, 0.3, 0.1), sphere(k, x, (0.1, 0.1, 1.2), 0.25))
        dots = projected_dots(
            z, k.focal_length, k.cx, k.cy, x - MODEL.baseline / 2, np.full_like(z, np.inf), soft=True, right=number == 1
        )
        grey = np.full((*z.shape, 3), 90, np.uint8)
        light = light_on_sensor(
            roots_of(grey), k, Exposure(), SceneLight(dots, 2.0), Lens(LENS_BLUR / quality.divisor), color=False
        )
        pattern = fixed_pattern(1, right=number == 1, height=k.height, width=k.width)
        depths.append(z)
        images.append(image_from_light(light, Exposure(), frame_key(1, 1, NoiseStream(number + 1)), pattern).image)
    true = true_disparity(depths[0], depths[1], k.focal_length * MODEL.baseline, DepthRange(0.4, 100))
    left, right = (fine_means(image, 1, *image.shape) for image in images)
    measured = match_pair(left, right, MODEL.disparity_count(quality.divisor, 0.1), NOISE, quality.divisor)
    sure = (true > 0) & (measured.confidence >= 128)
    assert sure.sum() / (true > 0).sum() >= 0.95
    error = np.abs(measured.disparity / 16 - true)
    assert (error[sure] > 1).mean() < 0.01
    # The confidence is a promise: that share lies within three standard deviations.
    within = error <= 3 * measured.error / 16
    assert within[sure].mean() == pytest.approx(measured.confidence[sure].mean() / 255, abs=0.05)


@pytest.mark.parametrize("width", [640, 1280])
def test_a_small_near_thing_is_found_before_a_far_wall(width: int) -> None:
    """The search is limited by the nearest thing in images of half the size."""
    height, far, near = width // 2, 20, 180
    random = np.random.default_rng(5)
    right = random.integers(300, 3000, (height, width), np.uint16)
    left = np.roll(right, far, axis=1)
    side = width // 40
    rows, columns = slice(100, 100 + 4 * side), slice(400, 400 + side)
    left[rows, columns] = random.integers(300, 3000, (4 * side, side), np.uint16)
    right[rows, columns.start - near : columns.stop - near] = left[rows, columns]
    measured = match_pair(left, right, 216, NOISE, 2)
    inside = measured.disparity[rows, columns][4:-4, 4:-4]
    assert (np.abs(inside / 16.0 - near) <= 0.5).mean() > 0.8
    elsewhere = measured.disparity[:90, 40:-40]
    assert (np.abs(elsewhere / 16.0 - far) <= 0.5).mean() > 0.95


def test_both_halves_of_an_image_are_matched_at_a_time_without_a_seam() -> None:
    """The result does not depend on the threads, and a wall has the same depth on both sides of the border."""
    random = np.random.default_rng(3)
    right = random.integers(300, 3000, (MIN_HEIGHT_OF_BANDS, 320), np.uint16)
    left = np.roll(right, 20, axis=1)
    one_thread = match_pair(left, right, 48, NOISE, 2)
    with closing(CpuRenderer(2)) as renderer:
        two_threads = match_pair(left, right, 48, NOISE, 2, renderer.parallel)
    for name in ("disparity", "error", "confidence"):
        assert_array_equal(getattr(two_threads, name), getattr(one_thread, name))
    middle = MIN_HEIGHT_OF_BANDS // 2
    beside_border = two_threads.disparity[middle - 3 : middle + 3, 60:-20]
    assert_array_equal(beside_border, np.full_like(beside_border, 20 * 16))
