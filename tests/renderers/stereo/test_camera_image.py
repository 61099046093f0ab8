"""Lens, dots, key light and fixed pattern in camera images."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.profile import PROFILE_NAMES, read_profile
from renderers.stereo.model import Intrinsics
from renderers.stereo.sensor.camera_image import (
    COLUMN_OFFSET,
    GAIN_UNIT,
    LENS_BLUR,
    OFFSET_UNIT,
    PIXEL_GAIN,
    PIXEL_OFFSET,
    Lens,
    NoiseStream,
    SceneLight,
    fixed_pattern,
    frame_key,
    image_from_light,
    light_on_sensor,
    roots_of,
)
from renderers.stereo.sensor.exposure import LIGHT_WHITE, Exposure

MODEL = read_profile("rc_visard_160c").model
K = MODEL.intrinsics()
NO_LENS, NO_LIGHT = Lens(), SceneLight()


def light_of(
    image: NDArray[np.uint8], lens: Lens = NO_LENS, k: Intrinsics = K, light: SceneLight = NO_LIGHT
) -> NDArray[np.float64]:
    """Return the light of a grey image behind a lens, white is 1."""
    k = replace(k, width=image.shape[1])
    root = light_on_sensor(roots_of(image), k, Exposure(), light, lens, color=False)[:, :, 0] / LIGHT_WHITE
    return root.astype(np.float64) ** 2


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
    factors = np.ones((40, 68), np.float32)
    factors[:, :30] = 0.5
    shaded = light_of(grey, light=SceneLight(factors=factors)) / light_of(grey)
    np.testing.assert_allclose(shaded[:, :30], 0.5, rtol=2e-3)
    np.testing.assert_allclose(shaded[:, 30:], 1.0, rtol=2e-3)
    both = light_of(grey, light=SceneLight(dots, 2.0, factors)) / light_of(grey)
    np.testing.assert_allclose(both[:, 30:], 3.0, rtol=2e-3)


def test_fixed_pattern_grows_with_the_gain() -> None:
    grey, level = np.full((480, 640, 3), 200, np.uint8), 255 * (200 / 255) ** 2.2
    pattern = fixed_pattern(0, right=False, height=480, width=640)
    deviations = []
    for gain in (0.0, 18.0):
        exposure = Exposure(0.005 / 10 ** (gain / 20), gain)  # the same brightness
        light = light_on_sensor(roots_of(grey), replace(K, width=640), exposure, color=False)
        images = [
            image_from_light(light, exposure, frame_key(0, number, NoiseStream.LEFT), pattern).image.astype(float)
            for number in range(16)
        ]
        deviations.append(np.corrcoef(np.mean(images[:8], axis=0).ravel(), np.mean(images[8:], axis=0).ravel())[0, 1])
        fixed = np.mean(images, axis=0).std()
        expected = np.hypot(np.hypot(PIXEL_OFFSET, COLUMN_OFFSET) * 10 ** (gain / 20), level * PIXEL_GAIN)
        noise = exposure.noise_by_level[round(level)] / 4
        # At 0 dB, rounding to whole levels hides a part of both.
        tolerance = 0.1 if gain else 0.35
        assert fixed == pytest.approx(np.hypot(expected, np.hypot(noise, 0.29 / 4)), rel=tolerance)
    assert min(deviations) > 0.4, "the same in every frame"


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
