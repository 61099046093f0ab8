"""Exposure: regions, modes with the projector, high dynamic range, white balance."""

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.imaging.rendered_images import ExposureMemory, choose_exposure
from renderers.stereo.sensor.camera_image import NoiseStream, frame_key
from renderers.stereo.sensor.exposure import AutoExposure, Exposure, auto_exposure
from scenegate.camera import image_interface_pb2 as pb
from tests.adapters.stereo.camera_images import light_of, sensor_image
from tests.adapters.stereo.conftest import Camera, Start, nanoseconds, pixels, settings
from tests.adapters.stereo.scenes import dotted_wall

KEY = frame_key(1, 1, NoiseStream.LEFT)


def scene(level: float = 0.2) -> NDArray[np.float32]:
    values = np.full((120, 160), level, np.float32)
    values[:, 80:] = level * 3
    return values


def test_only_the_exposure_region_is_metered() -> None:
    whole, _ = choose_exposure(scene(), scene(), out1_high=False, settings=settings(), memory=ExposureMemory())
    region = settings(exp_offset_x=640, exp_width=600, exp_height=900)
    right, _ = choose_exposure(scene(), scene(), out1_high=False, settings=region, memory=ExposureMemory())
    expected = auto_exposure(scene()[:, 80:], AutoExposure())
    assert right == expected
    assert right.light < whole.light
    beside = settings(exp_offset_x=5000, exp_width=600, exp_height=900)
    assert choose_exposure(scene(), scene(), out1_high=False, settings=beside, memory=ExposureMemory())[0] == whole


def test_normal_mode_meters_every_image_except_in_alternate_exposure() -> None:
    dark, bright = scene(0.1), scene(0.25)
    low, reduction = choose_exposure(dark, bright, out1_high=False, settings=settings(), memory=ExposureMemory())
    high, _ = choose_exposure(dark, bright, out1_high=True, settings=settings(), memory=ExposureMemory())
    assert (low, high) == (auto_exposure(dark, AutoExposure()), auto_exposure(bright, AutoExposure()))
    assert reduction == 0
    alternate = replace(settings(), out1_mode="ExposureAlternateActive")
    assert choose_exposure(dark, bright, out1_high=False, settings=alternate, memory=ExposureMemory())[0] == high


def test_out1_high_mode_keeps_the_exposure_while_out1_is_low() -> None:
    mode, memory = settings(exp_auto_mode="Out1High"), ExposureMemory()
    high, reduction = choose_exposure(scene(0.1), scene(0.25), out1_high=True, settings=mode, memory=memory)
    assert high.light == pytest.approx(auto_exposure(scene(0.1), AutoExposure()).light * (1 - reduction), rel=1e-6)
    assert 0 < reduction < 1
    # It has become brighter since.
    assert choose_exposure(scene(0.2), scene(0.3), out1_high=False, settings=mode, memory=memory)[0] == high
    assert choose_exposure(scene(0.2), scene(0.3), out1_high=True, settings=mode, memory=memory)[0] != high


def test_adaptive_mode_reduces_images_with_out1_low() -> None:
    mode = settings(exp_auto_mode="AdaptiveOut1")
    low, reduction = choose_exposure(scene(0.1), scene(0.25), out1_high=False, settings=mode, memory=ExposureMemory())
    alone = auto_exposure(scene(0.1), AutoExposure())
    assert low == auto_exposure(scene(0.25), AutoExposure())
    assert 0 < reduction < 1
    assert low.light == pytest.approx(alone.light * (1 - reduction), rel=1e-6)


def gradient() -> NDArray[np.uint8]:
    ramp = np.linspace(5, 255, 256).astype(np.uint8)
    return np.broadcast_to(ramp[None, :, None], (64, 256, 3)).copy()


def test_high_dynamic_range_saturates_nothing_and_keeps_the_order() -> None:
    plain, hdr = Exposure(0.012), Exposure(0.012, hdr=True)
    clipped = sensor_image(gradient(), plain, KEY, noise_factor=0.0).image
    whole = sensor_image(gradient(), hdr, KEY, noise_factor=0.0).image
    assert (clipped[0] == 255).mean() > 0.2
    assert (whole[0] == 255).mean() < 0.02
    assert (np.diff(whole[0].astype(int)) >= 0).all()
    assert len(np.unique(whole[0])) > 150
    # Three exposures have less noise in the dark than one.
    dark = np.full((200, 200, 3), 40, np.uint8)
    exposures = [replace(e, gain=12.0, time=0.005) for e in (plain, hdr)]
    noise = [float(sensor_image(dark, e, KEY).image.std()) for e in exposures]
    assert noise[1] < noise[0]
    assert replace(plain, hdr=True).saturation > 1.5


def test_automatic_exposure_of_high_dynamic_range_meets_its_target() -> None:
    values = light_of(gradient())
    found = auto_exposure(values, AutoExposure(average_max=0.4), Exposure(hdr=True))
    assert found.hdr
    assert sensor_image(gradient(), found, KEY, noise_factor=0.0).brightness == pytest.approx(0.4, abs=0.02)


def test_white_balance_changes_red_and_blue() -> None:
    grey = np.full((40, 40, 3), 100, np.uint8)
    warm = settings(exp_control="Manual", wb_auto=False, wb_ratio_red=2.4, wb_ratio_blue=1.2).manual_exposure
    red, green, blue = sensor_image(grey, warm, KEY, color=True, noise_factor=0.0).image.mean(axis=(0, 1))
    light = 255 * (100 / 255) ** 2.2
    assert (red, green, blue) == pytest.approx((2 * light, light, light / 2), abs=1)
    neutral = settings(exp_control="Manual", wb_auto=False).manual_exposure
    assert (neutral.red, neutral.blue) == (1.0, 1.0)
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    assert sensor_image(grey, warm, KEY, noise_factor=0.0).image.mean() == pytest.approx(luma, abs=1.5)


async def capture_set(camera: Camera, **request: Any) -> pb.ImageSet:
    begin = time.time_ns()
    call = camera.stream(**request)
    while True:
        image_set: pb.ImageSet = await call.read()
        if nanoseconds(image_set.timestamp) >= begin:
            call.cancel()
            return image_set


async def test_modes_in_the_stream(start: Start) -> None:
    camera = await start(rate="max")
    set_ = camera.service.set_parameters
    set_("rc_camera", [("exp_auto_mode", "AdaptiveOut1"), ("exp_auto_average_max", 0.5)])
    low = await capture_set(camera, left_enabled=True)
    assert 0 < low.left.out1_reduction < 1
    set_("rc_iocontrol", [("out1_mode", "High")])
    high = await capture_set(camera, left_enabled=True)
    assert high.left.exposure_time == pytest.approx(low.left.exposure_time)
    assert high.left.out1_reduction == pytest.approx(low.left.out1_reduction)
    assert high.left.brightness > low.left.brightness
    set_("rc_iocontrol", [("out1_mode", "Low")])
    set_("rc_camera", [("exp_auto_mode", "Normal"), ("exp_control", "HDR")])
    hdr = await capture_set(camera, left_enabled=True)
    assert hdr.left.out1_reduction == 0
    assert camera.service.settings.camera_rate == pytest.approx(25 / 3)


async def test_brightness_of_depth_images_is_that_of_their_left_image(start: Start) -> None:
    camera = await start(scene=lambda: (dotted_wall(), 1), rate="max")
    set_ = camera.service.set_parameters
    for color in (False, True):
        image_set = await capture_set(
            camera, left_enabled=True, disparity_enabled=True, confidence_enabled=True, color=color
        )
        seen = {image_set.left.brightness, image_set.disparity.image.brightness, image_set.confidence.brightness}
        assert len(seen) == 1
        assert image_set.left.brightness == pytest.approx(pixels(image_set.left).mean() / 255, abs=0.006)
    # Without a camera image in the set it is that of the image from which depth is measured.
    set_("rc_stereomatching", [("quality", "Full")])
    set_("rc_camera", [("exp_control", "Manual"), ("exp_value", 0.012)])
    alone = await capture_set(camera, disparity_enabled=True)
    assert alone.disparity.image.brightness == pytest.approx(
        (await capture_set(camera, left_enabled=True)).left.brightness
    )
    set_("rc_iocontrol", [("out1_mode", "ExposureAlternateActive")])
    apart = await capture_set(camera, left_enabled=True, disparity_enabled=True)
    set_("rc_iocontrol", [("out1_mode", "High")])
    lit = await capture_set(camera, left_enabled=True)
    assert apart.disparity.image.brightness == pytest.approx(lit.left.brightness, abs=0.01)
    assert apart.left.brightness < apart.disparity.image.brightness


async def test_switching_auto_exposure_off_keeps_its_result(start: Start) -> None:
    camera = await start(rate="max")
    set_, values = camera.service.set_parameters, camera.service.parameters.values("rc_camera")
    image_set = await capture_set(camera, left_enabled=True)
    await camera.take(2, left_enabled=True)
    set_("rc_camera", [("wb_auto", False), ("wb_ratio_red", 2.0), ("exp_control", "Manual")])
    assert values["exp_value"] == pytest.approx(image_set.left.exposure_time, rel=1e-5)
    assert values["gain_value"] == pytest.approx(image_set.left.gain, abs=1e-5)
    assert (values["wb_ratio_red"], values["wb_ratio_blue"]) == (2.0, 2.4)
    two = await capture_set(camera, left_enabled=True)
    assert two.left.exposure_time == pytest.approx(image_set.left.exposure_time)
    set_("rc_camera", [("exp_value", 0.01)])
    set_("rc_camera", [("fps", 10.0)])
    assert values["exp_value"] == 0.01, "only the switch sets it"


async def test_switching_automatic_white_balance_off_keeps_its_result_once(start: Start) -> None:
    camera = await start(rate="max")
    set_, values = camera.service.set_parameters, camera.service.parameters.values("rc_camera")
    set_("rc_camera", [("wb_ratio_red", 3.0), ("wb_ratio_blue", 3.0)])
    set_("rc_camera", [("wb_auto", False)])
    assert (values["wb_ratio_red"], values["wb_ratio_blue"]) == (1.2, 2.4)
    set_("rc_camera", [("wb_ratio_red", 3.0)])
    set_("rc_camera", [("fps", 5.0)])
    assert values["wb_ratio_red"] == 3.0


@pytest.mark.parametrize("mode", ["matched", "ground_truth"])
async def test_depth_only_within_its_region(start: Start, mode: str) -> None:
    camera = await start(rate="max", depth_mode=mode)
    set_ = camera.service.set_parameters
    set_("rc_iocontrol", [("out1_mode", "High")])
    region = [("roi_offset_x", 100), ("roi_offset_y", 60), ("roi_width", 120), ("roi_height", 100)]
    everywhere = await capture_set(camera, disparity_enabled=True)
    set_("rc_stereomatching", region)
    image_set = await capture_set(camera, disparity_enabled=True, confidence_enabled=True)
    inside = np.zeros((120, 160), np.bool_)
    inside[30:80, 50:110] = True
    d = pixels(image_set.disparity.image)
    assert (d[inside] > 0).mean() > 0.8 * (pixels(everywhere.disparity.image)[inside] > 0).mean()
    assert not d[~inside].any()
    assert not pixels(image_set.confidence)[~inside].any()
    set_("rc_stereomatching", [("roi_offset_x", 5000)])
    none = await capture_set(camera, disparity_enabled=True)
    assert not pixels(none.disparity.image).any()


@pytest.mark.parametrize(("out1", "noise", "gain"), [("High", 20.0, 0.05), ("ExposureAlternateActive", 1.0, 0.002)])
async def test_double_shot_fills_holes(start: Start, out1: str, noise: float, gain: float) -> None:
    """At half the resolution; in alternate exposure from images without dots, which have no texture on blank walls."""
    camera = await start(rate="max", depth_mode="matched", image_noise=noise)
    set_ = camera.service.set_parameters
    set_("rc_stereomatching", [("fill", 0), ("seg", 0), ("quality", "Full")])
    set_("rc_iocontrol", [("out1_mode", out1)])
    density = []
    for on in (False, True):
        set_("rc_stereomatching", [("double_shot", on)])
        image_set = await capture_set(camera, disparity_enabled=True)
        density.append(float((pixels(image_set.disparity.image) > 0).mean()))
    assert density[1] > density[0] + gain


async def test_static_scenes_are_matched_in_images_with_less_noise(start: Start) -> None:
    """Eight images have sqrt(8) times less, so that disparities change less from one frame to the next."""
    camera = await start(rate="max", depth_mode="matched", image_noise=10.0)
    camera.service.set_parameters("rc_iocontrol", [("out1_mode", "High")])
    changes = []
    for on in (False, True):
        camera.service.set_parameters("rc_stereomatching", [("quality", "Full"), ("static_scene", on)])
        first, second = (
            pixels(image_set.disparity.image).astype(float)
            for image_set in await camera.take(2, disparity_enabled=True)
        )
        valid_in_both = (first > 0) & (second > 0)
        changes.append(float(np.abs(first - second)[valid_in_both].clip(max=16.0).mean()))
    assert changes[0] > 1.5 * changes[1]
