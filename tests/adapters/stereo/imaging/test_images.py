"""Sensor, projector and matching on arrays."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.profile import read_profile
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture, OtherProjector, SceneState
from renderers.drawlist import AlphaMode, DrawList, Image, Instance, Material, Mesh, Texture
from renderers.raster import CpuRenderer
from renderers.stereo.depth.matching import fine_means, match_pair
from renderers.stereo.light.projector import FULL_LIGHT, projected_dots, returned_shares
from renderers.stereo.sensor.camera_image import NoiseStream, frame_key
from renderers.stereo.sensor.exposure import BRIGHT, AutoExposure, Exposure, auto_exposure
from tests.adapters.stereo.analytic import plane, sphere
from tests.adapters.stereo.camera_images import expose, light_of, rendered_grey, sensor_image
from tests.adapters.stereo.conftest import settings
from tests.adapters.stereo.scenes import pose, table

MODEL = read_profile("rc_visard_160c").model
KEY = frame_key(0, 0, NoiseStream.LEFT)


def grey(level: int, shape: tuple[int, int] = (240, 320)) -> NDArray[np.uint8]:
    return np.full((*shape, 3), level, np.uint8)


def test_the_response_is_linear_in_the_light() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)
    light = (picture / 255.0) ** 2.2
    color = sensor_image(picture, Exposure(), KEY, color=True, noise_factor=0.0).image
    assert np.abs(color - 255.0 * light).max() <= 1
    grey_image = sensor_image(picture, Exposure(), KEY, noise_factor=0.0).image
    assert np.abs(grey_image - 255.0 * light @ (0.299, 0.587, 0.114)).max() <= 1


@pytest.mark.parametrize("factor", [0.25, 0.5, 2.0, 2.5])
def test_exposure_and_gain_multiply_grey_values_until_saturation(factor: float) -> None:
    ramp = np.broadcast_to(np.arange(256, dtype=np.uint8)[None, :, None], (4, 256, 3)).copy()
    once = 255.0 * (ramp[:, :, 0] / 255.0) ** 2.2
    expected = np.minimum(factor * once, 255.0)
    longer = sensor_image(ramp, Exposure(0.005 * factor), KEY, noise_factor=0.0).image
    gain = 20.0 * np.log10(factor)
    amplified = sensor_image(ramp, Exposure(0.005, gain), KEY, noise_factor=0.0).image
    for image in (longer, amplified):
        np.testing.assert_allclose(image, expected, atol=0.8)


@pytest.mark.parametrize("gamma", [0.1, 0.5, 0.8, 2.0, 10.0])
def test_gamma_is_the_power_of_the_light(gamma: float) -> None:
    for light in (0.02, 0.2, 0.6):
        image = sensor_image(rendered_grey(light), Exposure(gamma=gamma), KEY, noise_factor=0.0).image
        assert image.mean() == pytest.approx(255 * light_of(rendered_grey(light)).mean() ** gamma, abs=1.5)
    assert sensor_image(grey(0), Exposure(gamma=gamma), KEY, noise_factor=0.0).image.max() == 0
    assert sensor_image(grey(255), Exposure(gamma=gamma), KEY, noise_factor=0.0).image.min() == 255


@pytest.mark.parametrize("gamma", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("gain", [9.0, 12.0, 18.0])
def test_noise_matches_the_message(gain: float, gamma: float) -> None:
    exposure = Exposure(0.005 / 10 ** (gain / 20), gain, gamma)  # the same brightness
    image = sensor_image(rendered_grey((128 / 255) ** (1 / gamma), (960, 1280)), exposure, KEY).image.astype(float)
    # Rounding to whole levels adds 1/12.
    assert image.std() == pytest.approx(np.sqrt(exposure.mid_grey_noise**2 + 1 / 12), rel=0.15)
    assert image.mean() == pytest.approx(128, abs=2.5)


def test_left_and_right_noise_is_independent() -> None:
    a, b = (
        sensor_image(grey(128), Exposure(0.0006, 18.0), frame_key(0, 0, s)).image.astype(float).ravel()
        for s in (NoiseStream.LEFT, NoiseStream.RIGHT)
    )
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.02


@pytest.mark.parametrize("gamma", [0.5, 1.0, 2.0])
def test_automatic_exposure_meets_its_target(gamma: float) -> None:
    manual = Exposure(gamma=gamma)
    for level in (20, 60, 120):
        light = light_of(grey(level))
        exposure = auto_exposure(light, AutoExposure(), manual)
        expected = min(0.75, float(light.mean() * Exposure(0.018, 18.0).light) ** gamma)
        brightness = sensor_image(grey(level), exposure, KEY, noise_factor=0.0).brightness
        assert brightness == pytest.approx(expected, abs=0.02)
    # With something white in the picture it stays as bright as it can without saturating.
    picture = grey(60)
    picture[:, :100] = 250
    exposure = auto_exposure(light_of(picture), AutoExposure(), manual)
    image = sensor_image(picture, exposure, KEY, noise_factor=0.0).image
    assert image.max() >= 252 or image.mean() == pytest.approx(0.25 * 255, abs=2)
    # What is a little brighter than the rest is kept from saturation, too.
    picture = grey(150)
    picture[:, :100] = 160
    exposure = auto_exposure(light_of(picture), AutoExposure(), manual)
    image = sensor_image(picture, exposure, KEY, noise_factor=0.0).image
    assert image.max() <= 255 * BRIGHT + 3
    # Longest time first, gain only after it.
    assert auto_exposure(light_of(grey(160)), AutoExposure(), manual).gain == 0
    assert auto_exposure(light_of(grey(20)), AutoExposure(0.001), manual).time == 0.001


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


def test_dots_fade_with_the_square_of_the_distance() -> None:
    k = MODEL.intrinsics(2)
    middle = np.s_[k.height // 2 - 60 : k.height // 2 + 60, k.width // 2 - 80 : k.width // 2 + 80]

    def mean(z: float) -> float:
        depth = np.full((k.height, k.width), z, np.float32)
        return float(projected_dots(depth, k.focal_length, k.cx, k.cy, 0.0, depth)[middle].mean())

    assert 0.2 * FULL_LIGHT < mean(1.5) < FULL_LIGHT
    for z, share in ((0.75, 4.0), (0.3, 4.0), (3.0, 0.25), (6.0, 0.0625)):
        assert mean(z) == pytest.approx(share * mean(1.5), rel=0.05)


def test_metal_returns_dots_by_its_roughness() -> None:
    mesh = Mesh(np.zeros((3, 3), np.float32), np.array(((0, 1, 2),), np.uint32))
    materials = [Material(metallic=m, roughness=r) for m, r in ((0.0, 0.0), (1.0, 0.05), (1.0, 0.4), (1.0, 1.0))]
    shares = returned_shares([Instance(mesh, each, np.eye(4), instance_id=i) for i, each in enumerate(materials)])
    assert shares[:4] == pytest.approx((1.0, 0.0025, 0.16, 1.0))
    assert shares[-1] == 1.0, "surfaces without an id"


def test_textures_of_metal_return_the_mean_of_their_texels() -> None:
    texels = np.zeros((4, 600, 4), np.uint8)
    texels[:, :300] = 0, 51, 255, 255  # metal of roughness 0.2; the rest is plastic
    texture = Texture(Image(b"", lambda: texels))
    mesh = Mesh(np.zeros((3, 3), np.float32), np.array(((0, 1, 2),), np.uint32))
    materials = [Material(metallic=m, metallic_roughness_texture=texture) for m in (1.0, 0.5)]
    shares = returned_shares([Instance(mesh, each, np.eye(4), instance_id=i) for i, each in enumerate(materials)])
    assert shares[:2] == pytest.approx((1 - 0.5 * 0.96, 1 - 0.25 * 0.96), abs=1e-3)


def test_dots_fall_on_what_is_behind_glass_and_not_on_mirrors(renderer: CpuRenderer) -> None:
    imaging = Imaging(StereoConfig(noise=False), renderer)

    def board(z: float, material: Material, index: int) -> Instance:
        corners = np.array(((-4, -4, z), (4, -4, z), (4, 4, z), (-4, 4, z)), np.float32)
        mesh = Mesh(corners, np.array(((0, 1, 2), (0, 2, 3)), np.uint32))
        return Instance(mesh, replace(material, double_sided=True), np.eye(4), instance_id=index)

    def dots(*boards: Instance) -> NDArray[np.float64]:
        """Return the light that the projector adds in the left image."""
        captures = (Capture(0, DrawList(boards), 1, np.eye(4), gpio) for gpio in (0, 1))
        low, high = (expose(imaging, each, Exposure()).image.astype(float) for each in captures)
        difference: NDArray[np.float64] = high - low
        return difference

    wall = board(2.0, Material((0.3, 0.3, 0.3, 1.0), metallic=0.0), 0)
    glass = Material((0.8, 0.8, 0.8, 0.2), metallic=0.0, alpha_mode=AlphaMode.BLEND)
    on_wall = dots(wall)
    assert on_wall.std() > 5
    assert np.corrcoef(on_wall.ravel(), dots(wall, board(1.2, glass, 1)).ravel())[0, 1] > 0.95
    frosted = replace(glass, base_color=(0.8, 0.8, 0.8, 0.9))
    assert np.corrcoef(on_wall.ravel(), dots(wall, board(1.2, frosted, 1)).ravel())[0, 1] < 0.3
    mirror = dots(board(1.5, Material((0.9, 0.9, 0.9, 1.0), metallic=1.0, roughness=0.05), 0))
    assert mirror.std() < 0.05 * on_wall.std()


def other_projector(x: float, angle: float, mode: str = "High", light: float = 2.0) -> OtherProjector:
    """Return the projector of a camera at x metres beside this one, turned about y by an angle."""
    X = np.eye(4)
    X[0, 0] = X[2, 2] = np.cos(angle)
    X[0, 2], X[2, 0] = np.sin(angle), -np.sin(angle)
    X[0, 3] = x
    return OtherProjector(X, MODEL, light, settings("rc_iocontrol", out1_mode=mode))


def test_another_camera_at_the_same_place_has_the_light_of_the_own_projector(renderer: CpuRenderer) -> None:
    imaging = Imaging(StereoConfig(noise=False), renderer)
    own, other = Capture(0, table(), 1, pose(), 1), Capture(0, table(), 1, pose(), 0)
    other = replace(other, projectors=(replace(other_projector(0.0, 0.0), X_world_left=pose()),))
    exposures = [imaging.meter(each, settings()).exposure for each in (own, other)]
    assert exposures[0].light == pytest.approx(exposures[1].light, rel=0.05)
    for stream in (NoiseStream.LEFT, NoiseStream.RIGHT):
        # Points at the edges are outside the other projector's field of view.
        inside = np.s_[200:-200, 200:-200]
        images = [expose(imaging, each, Exposure(), stream).image[inside].astype(float) for each in (own, other)]
        assert np.corrcoef(images[0].ravel(), images[1].ravel())[0, 1] > 0.97
        assert images[0].mean() == pytest.approx(images[1].mean(), rel=0.05)


def test_light_of_another_projector_is_fixed_to_surfaces_and_casts_shadows(renderer: CpuRenderer) -> None:
    imaging = Imaging(StereoConfig(noise=False, projector=False, dot_light=0.0), renderer)
    corners = np.array(((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)), np.float32)
    mesh = Mesh(corners, np.array(((0, 1, 2), (0, 2, 3)), np.uint32))
    grey = Material((0.5, 0.5, 0.5, 1.0), metallic=0.0, double_sided=True)

    def board(z: float, x: float, side: float) -> Instance:
        X = np.diag((side, side, 1.0, 1.0))
        X[:3, 3] = x, 0.0, z
        return Instance(mesh, grey, X)

    def dots(*boards: Instance, projector: OtherProjector) -> list[NDArray[np.float64]]:
        """Return the light that a projector adds in both images."""
        dark = Capture(0, DrawList(boards), 1, np.eye(4), 0)
        differences = []
        for stream in (NoiseStream.LEFT, NoiseStream.RIGHT):
            low, high = (
                expose(imaging, each, Exposure(), stream).image.astype(float)
                for each in (dark, replace(dark, projectors=(projector,)))
            )
            differences.append(high - low)
        return differences

    left, right = dots(board(2.0, 0.0, 4.0), projector=other_projector(1.2, -0.5))
    shift = round(MODEL.focal_times_baseline(1) / 2.0)
    assert left.std() > 3
    assert np.corrcoef(left[:, shift:].ravel(), right[:, :-shift].ravel())[0, 1] > 0.9
    assert np.corrcoef(left.ravel(), right.ravel())[0, 1] < 0.3
    facing, grazing = (
        dots(board(2.0, 0.0, 4.0), projector=other_projector(*each))[0] for each in ((0.0, 0.0), (6.0, -1.3))
    )
    assert grazing[480, 600:680].mean() < 0.3 * facing[480, 600:680].mean()
    # A board half-way between projector and wall, beside the line of sight, keeps the dots from the middle.
    shaded = dots(board(2.0, 0.0, 4.0), board(1.0, 0.67, 0.1), projector=other_projector(1.26, -0.55))[0]
    lit = dots(board(2.0, 0.0, 4.0), projector=other_projector(1.26, -0.55))[0]
    assert lit[470:490, 630:650].std() > 3
    assert not shaded[470:490, 630:650].any()


def test_projectors_of_other_cameras_are_seen_while_they_are_on() -> None:
    projectors = [other_projector(0.0, 0.0, mode) for mode in ("Low", "High", "ExposureAlternateActive")]
    state = SceneState(0, table(), pose(), projectors=tuple(projectors))
    camera, depth = (Capture.of_state(state, settings(), 0, 1, depth=depth) for depth in (False, True))
    assert camera.projectors == (projectors[1],)
    assert depth.projectors == (projectors[1], projectors[2])


def test_matching_a_blank_wall_is_invalid() -> None:
    image = sensor_image(grey(120), Exposure(), KEY).image
    other = sensor_image(grey(120), Exposure(), frame_key(0, 0, NoiseStream.RIGHT)).image
    left, right = (fine_means(i, 1, *i.shape) for i in (image, other))
    measured = match_pair(left, right, 64, np.full(256, 0.3), 2)
    assert (measured.confidence >= 128).mean() < 0.2
