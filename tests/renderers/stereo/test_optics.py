"""Lens, fixed pattern, key light and soft dots on arrays."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.stereo.device.profile import PROFILE_NAMES, read_profile
from renderers.camera import Camera
from renderers.stereo.depth.depth_images import DepthRange, true_disparity
from renderers.stereo.depth.image_pair import fine_means
from renderers.stereo.depth.matching import match_pair
from renderers.stereo.light.key_light import FACTOR_ONE, GROUND_LIGHT, KEY_LIGHT, SKY_LIGHT, light_factors
from renderers.stereo.light.projector import projected_dots
from renderers.stereo.light.projector_pattern import SPECKLE_CONTRAST, soft_pattern_levels
from renderers.stereo.model import Intrinsics, Quality
from renderers.stereo.realism import REALISM_PARTS, parse_realism
from renderers.stereo.sensor.camera_image import (
    LENS_BLUR,
    Lens,
    NoiseStream,
    SceneLight,
    frame_key,
    image_from_light,
    light_on_sensor,
)
from renderers.stereo.sensor.exposure import LIGHT_WHITE, Exposure
from renderers.stereo.sensor.fixed_pattern import (
    COLUMN_OFFSET,
    GAIN_UNIT,
    OFFSET_UNIT,
    PIXEL_GAIN,
    PIXEL_OFFSET,
    fixed_pattern,
)
from tests.stereo.analytic import plane, sphere

MODEL = read_profile("rc_visard_160c").model
KEY_LEFT = frame_key(0, 0, NoiseStream.LEFT)
K = MODEL.intrinsics()
NO_LENS, NO_LIGHT = Lens(), SceneLight()


def light_of(
    image: NDArray[np.uint8], lens: Lens = NO_LENS, k: Intrinsics = K, light: SceneLight = NO_LIGHT
) -> NDArray[np.float64]:
    """Return the light of a grey image behind a lens, white is 1."""
    root = light_on_sensor(image, k, Exposure(), light, lens, color=False)[:, :, 0] / LIGHT_WHITE
    return root.astype(np.float64) ** 2


def test_names_of_parts() -> None:
    assert parse_realism("off") == ()
    assert parse_realism("all") == REALISM_PARTS
    assert parse_realism("vignetting, shadows") == ("shadows", "vignetting")
    with pytest.raises(ValueError, match="'haze' is not a part; use 'off', 'all' or some of shadows, lens-blur"):
        parse_realism("shadows,haze")
    with pytest.raises(ValueError, match="'all' cannot be combined with other names"):
        parse_realism("shadows,all")


def test_point_spread_has_the_lens_blur() -> None:
    image = np.zeros((41, 41, 3), np.uint8)
    image[20, 20] = 255
    light = light_of(image, Lens(blur=LENS_BLUR))
    assert light.sum() == pytest.approx(1.0, abs=0.01)
    y, x = np.mgrid[-20:21, -20:21]
    for offset in (x, y):
        assert (light * offset).sum() == pytest.approx(0.0, abs=0.01)
        assert np.sqrt((light * offset**2).sum()) == pytest.approx(LENS_BLUR, rel=0.02)
    image[:] = 90
    np.testing.assert_allclose(light_of(image, Lens(blur=LENS_BLUR)), light_of(image), rtol=2e-3)  # also at the edges


@pytest.mark.parametrize("name", PROFILE_NAMES)
def test_vignetting_is_the_third_power_of_the_cosine(name: str) -> None:
    k = read_profile(name).model.intrinsics()
    grey = np.full((k.height, k.width, 3), 200, np.uint8)
    ratio = light_of(grey, Lens(vignetting=True), k) / light_of(grey, k=k)
    x = (np.arange(k.width) + 0.5 - k.cx) / k.focal_length
    y = (np.arange(k.height) + 0.5 - k.cy) / k.focal_length
    cosine = 1.0 / np.sqrt(1.0 + x[None] ** 2 + y[:, None] ** 2)
    np.testing.assert_allclose(ratio, cosine**3, atol=2e-3, rtol=0)


def test_dots_and_key_light_multiply_the_light() -> None:
    grey = np.full((40, 60, 3), 100, np.uint8)
    dots = np.zeros((40, 60), np.uint16)
    dots[:, 30:] = 255
    lit = light_of(grey, light=SceneLight(dots, 2.0)) / light_of(grey)
    np.testing.assert_allclose(lit[:, :30], 1.0, rtol=1e-6)
    np.testing.assert_allclose(lit[:, 30:], 3.0, rtol=2e-3)
    factors = np.full((20, 30), FACTOR_ONE, np.uint8)
    factors[:, :15] = FACTOR_ONE // 2
    shaded = light_of(grey, light=SceneLight(factors=factors)) / light_of(grey)
    np.testing.assert_allclose(shaded[:, :28], 0.5, rtol=2e-3)
    np.testing.assert_allclose(shaded[:, 32:], 1.0, rtol=2e-3)
    assert shaded[20, 29:31] == pytest.approx([0.5 + 9 / 64, 1 - 9 / 64], rel=5e-3), "interpolated"
    background = SceneLight(factors=factors, background=(100, 100, 100))
    np.testing.assert_allclose(light_of(grey, light=background), light_of(grey), rtol=1e-6)


def test_fixed_pattern_is_fixed_and_has_its_statistics() -> None:
    left, again = (fixed_pattern(3, right=False, height=480, width=640) for _ in range(2))
    assert (left.offset == again.offset).all()
    right, other = (fixed_pattern(seed, right=right, height=480, width=640) for seed, right in ((3, True), (4, False)))
    for each in (right, other):
        assert abs(np.corrcoef(left.offset.ravel(), each.offset.ravel())[0, 1]) < 0.1  # columns are few
    offset, gain = left.offset * OFFSET_UNIT, left.gain * GAIN_UNIT
    assert offset.std() == pytest.approx(np.hypot(PIXEL_OFFSET, COLUMN_OFFSET), rel=0.05)
    assert offset.mean(axis=0).std() == pytest.approx(COLUMN_OFFSET, rel=0.15)
    assert gain.std() == pytest.approx(PIXEL_GAIN, rel=0.05)


def test_fixed_pattern_grows_with_the_gain() -> None:
    grey, level = np.full((480, 640, 3), 200, np.uint8), 255 * (200 / 255) ** 2.2
    pattern = fixed_pattern(0, right=False, height=480, width=640)
    deviations = []
    for gain in (0.0, 18.0):
        exposure = Exposure(0.005 / 10 ** (gain / 20), gain)  # the same brightness
        light = light_on_sensor(grey, K, exposure, color=False)
        images = [
            image_from_light(light, exposure, frame_key(0, number, NoiseStream.LEFT), pattern).image.astype(float)
            for number in range(16)
        ]
        deviations.append(np.corrcoef(np.mean(images[:8], axis=0).ravel(), np.mean(images[8:], axis=0).ravel())[0, 1])
        fixed = np.mean(images, axis=0).std()
        expected = np.hypot(np.hypot(PIXEL_OFFSET, COLUMN_OFFSET) * 10 ** (gain / 20), level * PIXEL_GAIN)
        noise = exposure.noise_sigma(level) / 4
        # At 0 dB, rounding to whole levels hides a part of both.
        tolerance = 0.1 if gain else 0.35
        assert fixed == pytest.approx(np.hypot(expected, np.hypot(noise, 0.29 / 4)), rel=tolerance)
    assert min(deviations) > 0.4, "the same in every frame"


def looking_down() -> Camera:
    """Return a camera 2 m above the ground that looks straight down."""
    X_world_camera = np.array(((1.0, 0, 0, 0), (0, -1, 0, 0), (0, 0, -1, 2), (0, 0, 0, 1)))
    return Camera(64, 48, 60.0, 60.0, 32.0, 24.0, 0.01, 100.0, X_world_camera)


def light_above(offset: float = 0.0) -> Camera:
    """Return the camera of a light that shines straight down from 100 m, with texels of 5 cm."""
    X_world_light = np.array(((1.0, 0, 0, offset), (0, -1, 0, 0), (0, 0, -1, 100), (0, 0, 0, 1)))
    return Camera(128, 128, 2000.0, 2000.0, 64.0, 64.0, 1.0, 1000.0, X_world_light)


def test_key_light_reaches_what_it_sees() -> None:
    depth = np.full((48, 64), 2.0, np.float32)
    normal = np.zeros((48, 64, 3), np.float32)
    normal[:, :, 2] = -1.0  # up
    shadow_depth = np.full((128, 128), 100.0, np.float32)
    open_ground = light_factors(depth, normal, looking_down(), shadow_depth, light_above())
    assert (open_ground == round((KEY_LIGHT + SKY_LIGHT) * FACTOR_ONE)).all()
    shadow_depth[:, :64] = 99.0  # something 1 m above the ground
    half = light_factors(depth, normal, looking_down(), shadow_depth, light_above())
    assert (half[:, :28] == round(SKY_LIGHT * FACTOR_ONE)).all()
    assert (half[:, 36:] == round((KEY_LIGHT + SKY_LIGHT) * FACTOR_ONE)).all()
    assert len(np.unique(half[24, 28:36])) > 2, "a soft edge"
    assert (np.diff(half[24].astype(int)) >= 0).all()
    normal[:, :, 2] = 1.0 / np.sqrt(2)
    normal[:, :, 1] = 1.0 / np.sqrt(2)  # away from the light
    back = light_factors(depth, normal, looking_down(), shadow_depth, light_above())
    assert back.max() <= FACTOR_ONE * SKY_LIGHT / 0.3
    depth[:] = np.inf
    assert (light_factors(depth, normal, looking_down(), shadow_depth, light_above()) == FACTOR_ONE).all()
    assert GROUND_LIGHT < SKY_LIGHT


def test_soft_dots_have_soft_edges_and_speckle_of_each_camera() -> None:
    left, right = (soft_pattern_levels(right=right)[0].astype(float) for right in (False, True))
    lit = np.minimum(left, right) > 100
    ratio = left[lit] / right[lit]
    assert ratio.std() == pytest.approx(SPECKLE_CONTRAST * np.sqrt(2), rel=0.2)
    assert np.corrcoef(left.ravel(), right.ravel())[0, 1] > 0.9, "the same dots"
    # The mean profile of dots on dark ground: half the light one texel (1.5 pixels at full resolution) beside the
    # centre, none two texels beside it.
    mean = (left + right) / 2
    around = np.lib.stride_tricks.sliding_window_view(mean[:, :1023], 7, axis=1)
    centre, outer = around[..., 3], np.maximum(around[..., 0], around[..., 6])
    peaks = around[(centre > 90) & (outer < 3) & (centre == around.max(axis=-1))]
    assert len(peaks) > 300
    profile = peaks.mean(axis=0)
    profile /= profile[3]
    assert profile[[2, 4]] == pytest.approx([0.5, 0.5], abs=0.12)
    assert profile[[1, 5]].max() < 0.15


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
            grey, k, Exposure(), SceneLight(dots, 2.0), Lens(LENS_BLUR / quality.divisor), color=False
        )
        pattern = fixed_pattern(1, right=number == 1, height=k.height, width=k.width)
        depths.append(z)
        images.append(image_from_light(light, Exposure(), frame_key(1, 1, NoiseStream(number + 1)), pattern).image)
    true = true_disparity(depths[0], depths[1], k.focal_length * MODEL.baseline, DepthRange(0.4, 100))
    left, right = (fine_means(image, 1, *image.shape) for image in images)
    measured = match_pair(left, right, MODEL.disparity_count(quality.divisor, 0.1), 0.3)
    sure = (true > 0) & (measured.confidence >= 128)
    assert sure.sum() / (true > 0).sum() >= 0.95
    assert (np.abs(measured.disparity / 16 - true)[sure] > 1).mean() < 0.01
