"""Normals, base colours, flow and stereo images of plates, whose values follow from arithmetic."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.profile import DepthMode
from gateway.datasets.measured_depth import cached_profile
from gateway.datasets.rendering import SampleInputs, flow_between, flow_file, render_sample, right_camera
from gateway.datasets.scenes import LoadedScene
from gateway.scene.draw.cameras import CameraError
from gateway.scene.draw.style import Style
from renderers.camera import Camera
from renderers.light_rig import Rig
from renderers.raster import CpuRenderer
from scenegate.datasets.dataset import decode_flow
from scenegate.datasets.manifest import ImageType, RecordError
from tests.datasets.plates import FOCAL, HEIGHT, WIDTH, Plate, plate_camera, scene_of

MIDDLE = (HEIGHT // 2, WIDTH // 2)
QUARTER_TURN = [0.0, np.sin(0.5), 0.0, np.cos(0.5)]
"""A turn of one radian about Y."""


def image(
    renderer: CpuRenderer, inputs: SampleInputs, image_type: ImageType, style: Style | None = None
) -> NDArray[np.uint8]:
    """Return a PNG image of a sample in RGB."""
    images, objects = render_sample(renderer, inputs, {image_type: "png"}, style or Style())
    assert objects == ()
    bgr = cv2.imdecode(np.frombuffer(images[image_type], np.uint8), cv2.IMREAD_COLOR)
    assert bgr is not None
    return np.asarray(bgr[..., ::-1], np.uint8)


def test_normals_are_in_the_optical_frame(renderer: CpuRenderer, tmp_path: Path) -> None:
    facing = image(renderer, SampleInputs(scene_of(tmp_path, Plate("a")), plate_camera()), "normal")
    assert facing[MIDDLE].tolist() == [128, 128, 1]
    assert facing[0, 0].tolist() == [128, 128, 128]
    scene = scene_of(tmp_path, Plate("a", node={"rotation": QUARTER_TURN}))
    turned = image(renderer, SampleInputs(scene, plate_camera()), "normal")
    normal = (turned[MIDDLE].astype(float) - 128.0) / 127.0
    np.testing.assert_allclose(normal, (-np.sin(1.0), 0.0, -np.cos(1.0)), atol=1 / 127)


@pytest.mark.parametrize("look", ["studio", "phong", "pbr", "plain"])
def test_base_colours_are_srgb_without_light(renderer: CpuRenderer, tmp_path: Path, look: str) -> None:
    """A factor of 0.2 in linear light is 124 in sRGB, on both sides and at any angle."""
    material = {"pbrMetallicRoughness": {"baseColorFactor": [0.2, 1.0, 0.0, 1.0]}, "emissiveFactor": [1, 1, 1]}
    away = [1.0, 0.0, 0.0, 0.0]
    scene = scene_of(tmp_path, Plate("a", node={"rotation": away}, material=material))
    for rig in (Rig(), Rig(surroundings=None)):
        seen = image(renderer, SampleInputs(scene, plate_camera()), "albedo", Style(look, rig=rig))  # type: ignore[arg-type]  # text
        assert seen[MIDDLE].tolist() == [124, 255, 0]
        assert seen[0, 0].tolist() == [0, 0, 0]


def test_base_colours_multiply_textures_and_are_cut_out(renderer: CpuRenderer, tmp_path: Path) -> None:
    """The texture is white; its left half has alpha 0. A film below the threshold is not there."""
    pbr = {"baseColorFactor": [0.5, 0.0, 0.0, 1.0]}
    mask = {"alphaMode": "MASK", "pbrMetallicRoughness": pbr}
    blend = {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [0.0, 1.0, 0.0, 0.25]}}
    leaf = Plate("leaf", (0.0, 0.0, 2.0), "leaf", material=mask, half=True)
    scene = scene_of(tmp_path, leaf, Plate("film", (0.0, 0.0, 3.0), "film", material=blend), Plate("wall"))
    row, column = MIDDLE
    for threshold, behind in ((0.0, [0, 255, 0]), (0.5, [255, 255, 255])):
        seen = image(renderer, SampleInputs(scene, plate_camera()), "albedo", Style(alpha_threshold=threshold))
        assert seen[row, column + 3].tolist() == [188, 0, 0]
        assert seen[row, column - 3].tolist() == behind


def wall(tmp_path: Path, depth: float) -> LoadedScene:
    """A plate of 20 m that fills the image."""
    return scene_of(tmp_path, Plate("wall", (0.0, 0.0, depth), node={"scale": [20.0, 20.0, 1.0]}))


def flow(renderer: CpuRenderer, scene: LoadedScene, camera: Camera, next_camera: Camera | None) -> NDArray[np.float32]:
    images, _ = render_sample(renderer, SampleInputs(scene, camera, None, next_camera), {"flow": "flo"}, Style())
    return decode_flow(images["flow"], "flow")


def test_flow_of_a_sideways_move(renderer: CpuRenderer, tmp_path: Path) -> None:
    """0.5 m to the right and 0.2 m down, at 4 m: 5 pixels to the left and 2 up."""
    X = np.eye(4)
    X[:3, 3] = 0.5, 0.2, 0.0
    seen = flow(renderer, wall(tmp_path, 4.0), plate_camera(), plate_camera(X_world_camera=X))
    np.testing.assert_allclose(seen, np.broadcast_to((-FOCAL * 0.5 / 4, -FOCAL * 0.2 / 4), seen.shape), atol=1e-4)


def test_flow_follows_points_of_the_next_image(renderer: CpuRenderer, tmp_path: Path) -> None:
    """The next camera is turned, nearer, and has another lens."""
    X = np.eye(4)
    X[:3, :3] = cv2.Rodrigues(np.array((0.1, 0.2, -0.1)))[0]
    X[:3, 3] = -0.8, 0.1, 0.3
    seen = flow(renderer, wall(tmp_path, 4.0), plate_camera(), plate_camera(X_world_camera=X, fx=3 * FOCAL, cx=30.0))
    for row, column in ((5, 9), (24, 32), (40, 50)):
        point = np.array(((column + 0.5 - WIDTH / 2) / FOCAL, (row + 0.5 - HEIGHT / 2) / FOCAL, 1.0)) * 4.0
        x, y, z = X[:3, :3].T @ (point - X[:3, 3])
        expected = 3 * FOCAL * x / z + 30.0 - column - 0.5, FOCAL * y / z + HEIGHT / 2 - row - 0.5
        np.testing.assert_allclose(seen[row, column], expected, atol=1e-3)


def test_flow_is_not_known_of_the_background_and_behind_the_camera() -> None:
    depth = np.array([[np.inf, 1.0, 3.0, 0.0]], np.float32)
    X = np.eye(4)
    X[2, 3] = 2.0
    camera = plate_camera(width=4, height=1)
    seen = flow_between(depth, camera, plate_camera(width=4, height=1, X_world_camera=X))
    assert np.isnan(seen[0, (0, 1, 3)]).all()
    assert np.isfinite(seen[0, 2]).all()
    np.testing.assert_array_equal(decode_flow(flow_file(seen), ""), seen)


def test_there_is_no_flow_without_a_next_view(renderer: CpuRenderer, tmp_path: Path) -> None:
    inputs = SampleInputs(wall(tmp_path, 4.0), plate_camera())
    assert render_sample(renderer, inputs, {"flow": "flo", "depth": "tiff"}, Style())[0].keys() == {"depth"}


@pytest.mark.parametrize("cut", [0, 11, 12, -1, -8])
def test_damaged_flow_files_are_errors(cut: int) -> None:
    data = flow_file(np.zeros((2, 3, 2), np.float32))
    with pytest.raises(RecordError, match=r"f: not a flow file"):
        decode_flow(data[:cut], "f")


def test_the_right_image_is_shifted_by_the_disparity(renderer: CpuRenderer, tmp_path: Path) -> None:
    """A baseline of 0.5 m at 4 m is a disparity of 5 pixels."""
    scene = scene_of(tmp_path, Plate("a"))
    inputs = SampleInputs(scene, plate_camera(), baseline=0.5)
    left, right = (image(renderer, inputs, name, Style("plain", antialias="none")) for name in ("color", "stereo"))
    np.testing.assert_array_equal(left[:, 5:], right[:, :-5])
    assert (left != right).any()
    X = np.eye(4)
    X[:3, :3] = cv2.Rodrigues(np.array((0.3, 0.2, 0.1)))[0]
    np.testing.assert_allclose(right_camera(plate_camera(X_world_camera=X), 0.5).X_world_camera[:3, 3], X[:3, 0] * 0.5)


PROFILE = """
name = "small"
[stereo]
size = [64, 48]
focal_length = 40.0
baseline = 0.2
[depth]
[projector]
output = "High"
"""


@pytest.mark.parametrize("depth_mode", ["ground_truth", "matched"])
def test_measured_depth_is_that_of_a_profile(renderer: CpuRenderer, tmp_path: Path, depth_mode: DepthMode) -> None:
    (tmp_path / "small.toml").write_text(PROFILE)
    profile = cached_profile(str(tmp_path / "small.toml"))
    scene = wall(tmp_path, 2.0)

    def measured(number: int, camera: Camera) -> NDArray[np.uint16]:
        inputs = SampleInputs(scene, camera, profile=profile, depth_mode=depth_mode, noise_seed=number)
        images, _ = render_sample(renderer, inputs, {"measured": "png"}, Style())
        return np.asarray(cv2.imdecode(np.frombuffer(images["measured"], np.uint8), cv2.IMREAD_UNCHANGED), np.uint16)

    first = measured(1, plate_camera())
    seen = first[first > 0]
    assert len(seen) > first.size / 4
    # The disparity is 4 pixels: 1/32 is 0.8 % of the depth, which the projector's dots do not reach everywhere.
    assert np.median(np.abs(seen.astype(float) - 2000)) < (20 if depth_mode == "ground_truth" else 100)
    np.testing.assert_array_equal(measured(1, plate_camera()), first)
    assert (measured(2, plate_camera()) != first).any() == (depth_mode == "matched")
    with pytest.raises(CameraError, match="the size and lens of --stereo-profile"):
        measured(1, plate_camera(fx=41.0))
