"""Recorded stereo pairs, from a folder."""

import itertools
from pathlib import Path
from typing import Any

import cv2
import grpc
import numpy as np
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.imaging.recorded_pairs import RecordedPairs, find_pairs, pair_imaging, read_geometry
from gateway.adapters.stereo.imaging.rendered_images import ImageRequest
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.adapters.stereo.routes.node_routes import node_router
from gateway.adapters.stereo.routes.system_routes import system_router
from gateway.adapters.stereo.routes.truth_routes import truth_router
from renderers.drawlist import ImageError
from renderers.stereo.sensor.camera_image import NoiseStream, SensorImage
from renderers.stereo.sensor.exposure import Exposure
from scenegate.camera import image_interface_pb2 as pb
from scenegate.camera.files import save
from tests.adapters.stereo.conftest import SMALL, Start, http_client, pixels
from tests.adapters.stereo.imaging.test_exposure import capture_set

LIMIT = 1_000_000
NO_RENDERER: Any = None
"""Recorded images are not rendered."""


def png(array: np.ndarray) -> bytes:
    return cv2.imencode(".png", array[..., ::-1] if array.ndim == 3 else array)[1].tobytes()


def recorded_pair(
    folder: Path, left: bytes, right: bytes, focal_factor: float = 0.8, baseline: float = 0.1
) -> RecordedPairs:
    """Write a pair into a folder, and return the sequence of it."""
    for name, data in (("left.png", left), ("right.png", right)):
        (folder / name).write_bytes(data)
    return RecordedPairs(find_pairs(folder, 1), focal_factor, baseline, LIMIT)


@pytest.fixture
async def recorded(start: Start) -> pb.ImageSet:
    camera = await start(rate="max", depth_mode="matched")
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "High")])
    return await capture_set(camera, left_enabled=True, right_enabled=True, disparity_enabled=True)


async def test_shows_a_folder_written_by_our_client(recorded: pb.ImageSet, start: Start, tmp_path: Path) -> None:
    save(recorded, tmp_path)
    focal_factor, baseline = read_geometry(tmp_path)
    assert (focal_factor, baseline) == pytest.approx((SMALL.focal_factor, SMALL.baseline))
    camera = await start(rate="max", pairs=RecordedPairs(find_pairs(tmp_path, 10), focal_factor, baseline, LIMIT))
    image_set = await capture_set(
        camera, left_enabled=True, right_enabled=True, disparity_enabled=True, mesh_enabled=True
    )
    assert (pixels(image_set.left) == pixels(recorded.left)).all()
    assert (pixels(image_set.right) == pixels(recorded.right)).all()
    assert image_set.left.brightness == pytest.approx(recorded.left.brightness, abs=0.02)
    assert image_set.disparity.baseline == pytest.approx(SMALL.baseline)
    assert image_set.disparity.image.focal_length == pytest.approx(recorded.disparity.image.focal_length)
    # The device renders depth images at their own resolution, a recording is reduced: nearly the same disparity.
    valid_in_both = (pixels(image_set.disparity.image) > 0) & (pixels(recorded.disparity.image) > 0)
    assert valid_in_both.mean() > 0.4
    difference = pixels(image_set.disparity.image).astype(int) - pixels(recorded.disparity.image).astype(int)
    assert np.median(np.abs(difference[valid_in_both])) <= 4
    assert image_set.mesh.data.startswith(b"ply")


async def test_status_and_truth_with_pairs(recorded: pb.ImageSet, start: Start, tmp_path: Path) -> None:
    left = pixels(recorded.left)
    pairs = recorded_pair(tmp_path, png(left), png(pixels(recorded.right)), focal_factor=0.8449, baseline=0.2)
    camera = await start(rate="max", pairs=pairs)
    image_set = await capture_set(camera, left_enabled=True, disparity_enabled=True, color=True)
    assert (pixels(image_set.left)[:, :, 1] == left).all()
    assert image_set.left.encoding == "rgb8"
    assert image_set.disparity.baseline == pytest.approx(0.2)
    assert image_set.left.focal_length == pytest.approx(270.368)
    async with http_client(*(each(camera.service) for each in (node_router, system_router, truth_router))) as client:
        status = (await client.get("/api/v2/pipelines/0/nodes/rc_camera/status")).json()["values"]
        assert (status["test"], status["baseline"]) == ("1", "0.2")
        assert (await client.get("/api/v2/system")).json()["model_name"] == "rc_test"
        truth = await client.get("/stereo/truth.npz")
        assert (truth.status_code, "no ground truth" in truth.json()["message"]) == (404, True)


@pytest.mark.parametrize(
    ("focal", "baseline", "field"), [(0.8, float("nan"), "baseline nan"), (0.001, 0.1, "focal_factor 0.001")]
)
def test_impossible_geometry_is_refused(tmp_path: Path, focal: float, baseline: float, field: str) -> None:
    blank = png(np.zeros((64, 64), np.uint8))
    with pytest.raises(ValueError, match=field):
        recorded_pair(tmp_path, blank, blank, focal, baseline)


def test_pairs_repeat_and_are_limited_in_pixels(tmp_path: Path) -> None:
    files = [tmp_path / f"{value}.png" for value in (1, 2, 3, 4)]
    for value, file in enumerate(files, 1):
        file.write_bytes(png(np.full((16, 16), value, np.uint8)))
    pairs = RecordedPairs([(files[0], files[1]), (files[2], files[3])], 0.8, 0.1, 256)
    views = itertools.product((0, 1, 2), (False, True))
    assert [pairs.image(number, right=right)[0, 0, 0] for number, right in views] == [1, 2, 3, 4, 1, 2]
    with pytest.raises(ImageError, match=r"16x16 .* 255"):
        RecordedPairs([(files[0], files[1])], 0.8, 0.1, 255)


def test_images_have_limits(tmp_path: Path) -> None:
    bomb, blank, tiny = (png(np.zeros((size, size), np.uint8)) for size in (2000, 64, 8))
    for left, right, what in (
        (bomb, bomb, "2000x2000 pixels are more than the limit of 1000000"),
        (blank, png(np.zeros((32, 64), np.uint8)), "has 64x32 pixels, the first one 64x64"),
        (blank, png(np.zeros((64, 32), np.uint8)), "has 32x64 pixels, the first one 64x64"),
        (blank, b"broken", r"right\.png"),
        (tiny, tiny, "8x8"),
    ):
        with pytest.raises((ImageError, ValueError), match=what):
            recorded_pair(tmp_path, left, right)


async def test_a_broken_later_image_ends_the_stream_with_the_reason(start: Start, tmp_path: Path) -> None:
    good = png(np.zeros((64, 64), np.uint8))
    for number, right in enumerate((good, b"\x89PNG\r\n\x1a\n broken")):
        (tmp_path / f"{number}_left.png").write_bytes(good)
        (tmp_path / f"{number}_right.png").write_bytes(right)
    camera = await start(rate="max", pairs=RecordedPairs(find_pairs(tmp_path, 10), 0.8, 0.1, LIMIT))
    call = camera.stream(left_enabled=True, right_enabled=True)
    with pytest.raises(grpc.aio.AioRpcError, match=r"1_right\.png"):
        async for _ in call:
            pass


def test_pairs_are_found_by_name(tmp_path: Path) -> None:
    image = png(np.zeros((20, 20), np.uint8))
    names = ["left/0.png", "right/0.png", "left/1.png", "a_left.jpg", "a_right.jpg", "leftover.txt"]
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(image)
    pairs = find_pairs(tmp_path, 2)
    assert [(left.name, right.name) for left, right in pairs] == [("a_left.jpg", "a_right.jpg"), ("0.png", "0.png")]
    with pytest.raises(ValueError, match="holds 2 stereo pairs, more than 1"):
        find_pairs(tmp_path, 1)
    with pytest.raises(ValueError, match="nowhere is not a folder"):
        find_pairs(tmp_path / "nowhere", 10)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match=r"empty holds no images \(\.png, "):
        find_pairs(tmp_path / "empty", 10)
    with pytest.raises(ValueError, match="holds no stereo pairs: none of its 1 images"):
        find_pairs(tmp_path / "right", 1)


def test_geometry_from_the_vendors_parameter_file(tmp_path: Path) -> None:
    text = "# Created by grpc_image_client\ncamera.A=[552.18500 0 320.00000; 0 552.18500 240.00000; 0 0 1]\n"
    text += "camera.height=480\ncamera.width=640\nrho=88.37721\nt=0.16005\n"
    (tmp_path / "image_1.000000002_00_00_param.txt").write_text(text)
    assert list(read_geometry(tmp_path) or ()) == [pytest.approx(0.862789, rel=1e-5), 0.16005]
    assert read_geometry(tmp_path / "none") is None
    (tmp_path / "image_1.000000002_00_00_param.txt").write_text(text.replace("width=640", "width=0"))
    with pytest.raises(ValueError, match="is not a number"):
        read_geometry(tmp_path)


def test_brightness_is_the_mean_of_the_recorded_image(tmp_path: Path) -> None:
    image = np.zeros((64, 64, 3), np.uint8)
    image[:, :32] = 255
    assert exposed(tmp_path, image).brightness == 0.5
    assert exposed(tmp_path, np.full_like(image, 255)).brightness == 1.0


def exposed(folder: Path, image: np.ndarray) -> SensorImage:
    scene: Any = None
    pairs = recorded_pair(folder, png(image), png(image))
    imaging = pair_imaging(StereoConfig(model=SMALL), NO_RENDERER, pairs)
    request = ImageRequest(Exposure(), NoiseStream.LEFT, frozenset((True,)))
    return imaging.expose(Capture(0, scene, 1, np.eye(4), 0, 1), request)[True]


def test_damaged_geometry_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "one.npz").write_bytes(b"no archive")
    with pytest.raises(ValueError, match=r"one\.npz"):
        read_geometry(tmp_path)
