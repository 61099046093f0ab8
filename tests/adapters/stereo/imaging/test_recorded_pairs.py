"""Recorded stereo pairs, from a folder or uploaded."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import cv2
import grpc
import httpx2 as httpx
import numpy as np
import pytest
from fastapi import FastAPI

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.timestamps import timestamp_text
from gateway.adapters.stereo.imaging.pair_files import find_pairs, read_geometry
from gateway.adapters.stereo.imaging.recorded_pairs import Pair, PairSequence, pair_imaging
from gateway.adapters.stereo.imaging.rendered_images import ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.adapters.stereo.routes.node_routes import node_router
from gateway.adapters.stereo.routes.system_routes import system_router
from gateway.adapters.stereo.routes.truth_routes import truth_router
from gateway.adapters.stereo.routes.upload_routes import upload_router
from renderers.drawlist import ImageError
from renderers.stereo.sensor.camera_image import NoiseStream, SensorImage
from renderers.stereo.sensor.exposure import Exposure
from scenegate.camera import image_interface_pb2 as pb
from scenegate.camera.files import save
from tests.adapters.stereo.conftest import SMALL, Camera, Start, pixels
from tests.adapters.stereo.imaging.test_exposure import capture_set

LIMIT = 1_000_000
PATH = "/api/v2/pipelines/0/test/set"


def png(array: np.ndarray) -> bytes:
    return cv2.imencode(".png", array[..., ::-1] if array.ndim == 3 else array)[1].tobytes()


@pytest.fixture
async def recorded(start: Start) -> pb.ImageSet:
    """Return a set with the projector on."""
    camera = await start(rate="max", depth_mode="matched")
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "High")])
    return await capture_set(camera, left_enabled=True, right_enabled=True, disparity_enabled=True)


@pytest.fixture
async def camera(start: Start) -> Camera:
    return await start(rate="max")


@pytest.fixture
async def rest_client(camera: Camera) -> AsyncIterator[httpx.AsyncClient]:
    app = FastAPI()
    app.include_router(node_router(camera.service))
    app.include_router(system_router(camera.service))
    app.include_router(upload_router(camera.service))
    app.include_router(truth_router(camera.service))
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app=app), base_url="http://camera") as client:
        yield client


async def test_shows_a_folder_written_by_our_client(recorded: pb.ImageSet, camera: Camera, tmp_path: Path) -> None:
    save(recorded, tmp_path)
    geometry = read_geometry(tmp_path)
    assert geometry is not None
    assert list(geometry) == [pytest.approx(SMALL.focal_factor), pytest.approx(SMALL.baseline)]
    camera.service.show_pairs(pair_imaging(camera.service.scene_imaging, find_pairs(tmp_path, 10, LIMIT), *geometry))
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
    camera.service.show_pairs(None)
    back = await capture_set(camera, left_enabled=True, disparity_enabled=True)
    assert camera.service.config.depth_mode == "modelled"
    assert (pixels(back.left) != pixels(recorded.left)).any()


async def test_ground_truth_of_the_newest_frame_is_not_that_of_a_scene_shown_before(
    recorded: pb.ImageSet, camera: Camera, rest_client: httpx.AsyncClient
) -> None:
    scene_set = await capture_set(camera, left_enabled=True)
    left, right = pixels(recorded.left), pixels(recorded.right)
    files = {"left_out1_low": png(left), "right_out1_low": png(right)}
    assert (await rest_client.post(PATH, files=files)).status_code == 200
    newest = await rest_client.get("/stereo/truth.npz")
    assert (newest.status_code, newest.json()["message"][:22]) == (404, "no frame was taken yet")
    time = timestamp_text(scene_set.timestamp.sec * 10**9 + scene_set.timestamp.nsec)
    assert (await rest_client.get("/stereo/truth.npz", params={"timestamp": time})).status_code == 200


async def test_shows_an_uploaded_pair_in_test_mode(
    recorded: pb.ImageSet, camera: Camera, rest_client: httpx.AsyncClient
) -> None:
    left, right = pixels(recorded.left), pixels(recorded.right)
    files = {
        "left_out1_low": png(left // 2), "right_out1_low": png(right // 2),
        "left_out1_high": png(left), "right_out1_high": png(right),
    }  # fmt: skip
    response = await rest_client.post(PATH, files=files, data={"f": "270.368", "t": "0.2"})
    assert (response.status_code, response.json()["return_code"]["value"]) == (200, 0)
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "ExposureAlternateActive")])
    image_set = await capture_set(camera, left_enabled=True, disparity_enabled=True, color=True)
    assert (pixels(image_set.left)[:, :, 1] == left // 2).all()
    assert image_set.left.encoding == "rgb8"
    assert image_set.disparity.baseline == pytest.approx(0.2)
    assert image_set.left.focal_length == pytest.approx(270.368)
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "High")])
    lit = await capture_set(camera, left_enabled=True)
    assert (pixels(lit.left) == left).all()
    status = (await rest_client.get("/api/v2/pipelines/0/nodes/rc_camera/status")).json()["values"]
    assert (status["test"], status["baseline"]) == ("1", "0.2")
    assert (await rest_client.get("/api/v2/system")).json()["model_name"] == "rc_test"
    truth = await rest_client.get("/stereo/truth.npz")
    assert truth.status_code == 404
    assert "there is no ground truth" in truth.json()["message"]
    assert (await rest_client.delete(PATH)).status_code == 200
    assert (await rest_client.get("/api/v2/system")).json()["model_name"] == "small"


@pytest.mark.parametrize(
    ("files", "data", "sentence"),
    [
        ({"left_out1_low": png(np.zeros((64, 64), np.uint8))}, {}, "needs the files left_out1_low and right_out1_low"),
        ({"left_out1_low": b"GIF89a", "right_out1_low": b"x"}, {}, "GIF images are"),
        ({}, {"f": "1"}, "needs the files"),
        ("pair", {"f": "soft"}, "f: 'soft' is not a number"),
        ("pair", {"t": "nan"}, "baseline nan m must be within"),
        ("pair", {"f": "0.001"}, "focal_factor 0.001 must be within"),
        ("sizes", {}, "has 32x32 pixels, the first one 64x64"),
        ("high", {}, "the right image of pair 1: an image that starts with b'broken'"),
        ("tiny", {}, "size 8x8 must be within"),
    ],
)
async def test_invalid_uploads_are_rejected_without_effect(
    rest_client: httpx.AsyncClient, camera: Camera, files: dict[str, bytes] | str, data: dict[str, str], sentence: str
) -> None:
    side = 8 if files == "tiny" else 64
    blank = png(np.zeros((side, side), np.uint8))
    if isinstance(files, str):
        other = png(np.zeros((32, 32), np.uint8)) if files == "sizes" else blank
        lit = {"left_out1_high": blank, "right_out1_high": b"broken"} if files == "high" else {}
        files = {"left_out1_low": blank, "right_out1_low": other, **lit}
    response = await rest_client.post(PATH, files=files or {"x": b"y"}, data=data)
    assert response.status_code == 400
    assert sentence in response.json()["message"]
    assert camera.service.config.model is SMALL


async def test_uploads_are_limited(start: Start) -> None:
    camera = await start(max_upload=10_000)
    app = FastAPI()
    app.include_router(upload_router(camera.service))
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app=app), base_url="http://camera") as client:
        response = await client.post(PATH, files={"left_out1_low": b"x" * 20_000})
        assert (response.status_code, response.json()["message"]) == (413, "the form is larger than 10000 bytes")
        many = {f"file{i}": b"x" for i in range(9)}
        assert (await client.post(PATH, files=many)).status_code == 400
        assert (await client.post(PATH, json={"f": 1})).status_code == 400
        bomb = PairSequence([Pair((png(np.zeros((2000, 2000), np.uint8)),) * 2)], LIMIT)
        with pytest.raises(ImageError, match="2000x2000 pixels are more than the limit of 1000000"):
            bomb.image(0, high=False, right=False)


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("multipart/form-data; " + "a=b;" * 15_000, "Content-Type has 60021 characters, the limit is 1024"),
        ("multipart/form-data", "multipart/form-data with a boundary is needed"),
        ("multipart/form-data-not; boundary=x", "multipart/form-data with a boundary is needed"),
        ("application/json", "multipart/form-data with a boundary is needed"),
        ('multipart/form-data; boundary="\\"\\\\"', "the form needs the files"),
    ],
)
async def test_the_content_type_of_a_form(rest_client: httpx.AsyncClient, kind: str, sentence: str) -> None:
    body = b'--"\\\r\nContent-Disposition: form-data; name="f"\r\n\r\n1\r\n--"\\--\r\n'
    response = await rest_client.post(PATH, content=body, headers={"Content-Type": kind})
    assert response.status_code == 400
    assert sentence in response.json()["message"]


async def test_the_charset_of_a_form_is_ignored(rest_client: httpx.AsyncClient) -> None:
    body = b'--x\r\nContent-Disposition: form-data; name="f"\r\n\r\nMQ==\r\n--x--\r\n'
    for charset in ("idna", "undefined", "utf-16"):  # the first takes a minute for a megabyte, the second any name
        response = await rest_client.post(
            PATH, content=body, headers={"Content-Type": f"multipart/form-data; boundary=x; charset={charset}"}
        )
        assert "the form needs the files" in response.json()["message"]


async def test_a_broken_later_image_ends_the_stream_with_the_reason(camera: Camera, tmp_path: Path) -> None:
    good = png(np.zeros((64, 64), np.uint8))
    for number, right in enumerate((good, b"\x89PNG\r\n\x1a\n broken")):
        (tmp_path / f"{number}_left.png").write_bytes(good)
        (tmp_path / f"{number}_right.png").write_bytes(right)
    imaging = pair_imaging(camera.service.scene_imaging, find_pairs(tmp_path, 10, LIMIT), 0.8, 0.1)
    camera.service.show_pairs(imaging)
    call = camera.stream(left_enabled=True, right_enabled=True)
    with pytest.raises(grpc.aio.AioRpcError, match=r"1_right\.png"):
        async for _ in call:
            pass


def test_pairs_are_found_by_name(tmp_path: Path) -> None:
    image = png(np.zeros((20, 20), np.uint8))
    names = ["left/0.png", "right/0.png", "left/1.png", "a_left_out1_low.jpg", "a_right_out1_low.jpg"]
    names += ["a_left_out1_high.jpg", "a_right_out1_high.jpg", "leftover.txt"]
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(image)
    assert len(find_pairs(tmp_path, 2, LIMIT)) == 2
    with pytest.raises(ValueError, match="holds 2 stereo pairs, more than 1"):
        find_pairs(tmp_path, 1, LIMIT)
    with pytest.raises(ValueError, match="nowhere is not a folder"):
        find_pairs(tmp_path / "nowhere", 10, 10_000_000)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match=r"empty holds no images \(\.png, "):
        find_pairs(tmp_path / "empty", 10, 10_000_000)
    with pytest.raises(ValueError, match="holds no stereo pairs: none of its 1 images"):
        find_pairs(tmp_path / "right", 1, LIMIT)


def test_geometry_from_the_vendors_parameter_file(tmp_path: Path) -> None:
    text = "# Created by grpc_image_client\ncamera.A=[552.18500 0 320.00000; 0 552.18500 240.00000; 0 0 1]\n"
    text += "camera.height=480\ncamera.width=640\nrho=88.37721\nt=0.16005\n"
    (tmp_path / "image_1.000000002_00_00_param.txt").write_text(text)
    assert list(read_geometry(tmp_path) or ()) == [pytest.approx(0.862789, rel=1e-5), 0.16005]
    assert read_geometry(tmp_path / "none") is None
    (tmp_path / "image_1.000000002_00_00_param.txt").write_text(text.replace("width=640", "width=0"))
    with pytest.raises(ValueError, match="is not a number"):
        read_geometry(tmp_path)


def test_brightness_is_the_mean_of_the_recorded_image() -> None:
    image = np.zeros((64, 64, 3), np.uint8)
    image[:, :32] = 255
    assert exposed(image).brightness == 0.5
    assert exposed(np.full_like(image, 255)).brightness == 1.0


def exposed(image: np.ndarray) -> SensorImage:
    renderer: Any = None
    scene: Any = None
    pairs = PairSequence([Pair((png(image), png(image)))], LIMIT)
    imaging = pair_imaging(Imaging(StereoConfig(model=SMALL), renderer), pairs, 0.8, 0.1)
    request = ImageRequest(Exposure(), NoiseStream.LEFT, frozenset((True,)))
    return imaging.expose(Capture(0, scene, 1, np.eye(4), 0, 1), request)[True]


async def test_showing_other_images_is_a_change(camera: Camera) -> None:
    """Sets that were made before it are not sent any more."""
    before = camera.service.hub.generation
    camera.service.show_pairs(None)
    assert camera.service.hub.generation == before + 1


@pytest.mark.parametrize("name", ["left_out1_high", "right_out1_high"])
async def test_images_of_the_projector_come_in_pairs(rest_client: httpx.AsyncClient, name: str) -> None:
    image = png(np.zeros((64, 64), np.uint8))
    files = dict.fromkeys(("left_out1_low", "right_out1_low", name), image)
    response = await rest_client.post(PATH, files=files)
    assert response.status_code == 400
    assert "left_out1_high and right_out1_high need each other" in response.json()["message"]


@pytest.mark.parametrize("missing", ["left_out1_low", "right_out1_low"])
async def test_both_images_are_needed(rest_client: httpx.AsyncClient, missing: str) -> None:
    image = png(np.zeros((64, 64), np.uint8))
    files = {key: image for key in ("left_out1_low", "right_out1_low") if key != missing}
    response = await rest_client.post(PATH, files=files)
    assert (response.status_code, "needs the files" in response.json()["message"]) == (400, True)


def test_damaged_geometry_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "one.npz"
    path.write_bytes(b"no archive")
    with pytest.raises(ValueError, match=r"one\.npz cannot be read: "):
        read_geometry(tmp_path)
    path.unlink()
    assert read_geometry(tmp_path) is None
