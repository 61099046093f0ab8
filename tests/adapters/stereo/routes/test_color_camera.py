"""Colour and depth of an RGB-D camera: in the stream and over HTTP."""

import io
from itertools import count
from typing import Any

import cv2
import grpc
import httpx2 as httpx
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.parameter_specs import DeviceLimits
from gateway.adapters.stereo.imaging.scene_view import SceneState
from gateway.adapters.stereo.routes.camera_routes import camera_router
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.timeline import TimeError
from gateway.scene.tree.transforms import translation
from renderers.drawlist import DrawList, Material
from renderers.stereo.lens.color_camera import ColorCamera
from renderers.stereo.model import Intrinsics, Quality
from scenegate.messages.geometry import Box
from tests.adapters.stereo.conftest import SMALL, Camera, Start, http_client, pixels
from tests.adapters.stereo.scenes import pose, scene_of

WIDE = Intrinsics(400, 300, 300.0, 200.0, 150.0)
COLOR_CAMERA = ColorCamera(WIDE, (0.02, 0.0, 0.0))
RGBD: dict[str, Any] = {
    "color": False,
    "color_camera": COLOR_CAMERA,
    "limits": DeviceLimits(fps=30.0, quality=Quality.FULL, depth_rates=dict.fromkeys(Quality, 30.0), out1_mode="High"),
}


def moving_box(x: float) -> DrawList:
    return scene_of(Part(Box((0.5, 0.2, 3.0)), Material((0.9, 0.1, 0.1, 1.0)), translation(0.3, x, 0.2)))


async def get(camera: Camera, path: str) -> httpx.Response:
    async with http_client(camera_router(camera.service)) as client:
        return await client.get(path)


def decoded(response: httpx.Response) -> NDArray[Any]:
    assert response.status_code == 200, response.text
    assert response.headers["content-type"] == "image/png"
    image: Any = cv2.imdecode(np.frombuffer(response.content, np.uint8), cv2.IMREAD_UNCHANGED)
    return image


async def test_a_set_has_colour_and_depth_of_one_instant(start: Start) -> None:
    camera = await start(**RGBD, rate="max")
    request = {"left_enabled": True, "color": True, "color_camera_enabled": True, "depth_mm_enabled": True}
    (plain,) = await camera.take(**request)
    (aligned,) = await camera.take(**request, depth_aligned=True)
    assert plain.left.encoding == "mono8", "the stereo cameras are monochrome"
    assert pixels(plain.color_camera).shape == (WIDE.height, WIDE.width, 3)
    assert pixels(plain.depth_mm).shape == (SMALL.height, SMALL.width)
    assert pixels(aligned.depth_mm).shape == (WIDE.height, WIDE.width)
    assert aligned.depth_mm.focal_length == aligned.color_camera.focal_length == WIDE.focal_length
    assert plain.depth_mm.focal_length == pytest.approx(SMALL.focal_factor * SMALL.width)
    assert plain.timestamp == plain.color_camera.timestamp == plain.depth_mm.timestamp
    depth = pixels(plain.depth_mm)
    assert (depth > 0).mean() > 0.5
    nearest, farthest = np.percentile(depth[depth > 0], (0.5, 99.5))  # single wrong pixels may be anywhere
    assert 800 < nearest < farthest < 4500


async def test_colour_of_an_rc_visard_is_the_left_image(start: Start) -> None:
    camera = await start(rate="max", noise=False)
    (images,) = await camera.take(left_enabled=True, color=True, color_camera_enabled=True, depth_mm_enabled=True)
    assert (pixels(images.color_camera) == pixels(images.left)).all()
    assert images.depth_mm.width == SMALL.width // 2
    only_color = (await camera.take(color_camera_enabled=True))[0]
    assert pixels(only_color.color_camera).shape == (SMALL.height, SMALL.width, 3)
    (aligned,) = await camera.take(depth_mm_enabled=True, depth_aligned=True)
    assert aligned.depth_mm.width == SMALL.width // 2, "there is no other camera to align to"


async def test_a_monochrome_camera_refuses_colour(start: Start) -> None:
    camera = await start(color=False)
    with pytest.raises(grpc.aio.AioRpcError, match="color_camera_enabled: the small is monochrome") as refusal:
        await camera.take(color_camera_enabled=True)
    assert refusal.value.code() == grpc.StatusCode.INVALID_ARGUMENT
    response = await get(camera, "/cameras/stereo/color")
    assert (response.status_code, response.json()["message"]) == (404, "the camera 'stereo', small, is monochrome")
    (images,) = await camera.take(left_enabled=True, color=True)
    assert images.left.encoding == "mono8"


async def test_projector_dots_are_in_the_left_image_alone(start: Start) -> None:
    camera = await start(**RGBD, rate="max", noise=False)
    (images,) = await camera.take(left_enabled=True, color_camera_enabled=True)
    greys = pixels(images.left), pixels(images.color_camera)[:, :, 1]
    roughness = [float(np.abs(np.diff(grey.astype(int), axis=1)).mean()) for grey in greys]
    assert roughness[0] > 4 * roughness[1]


async def test_a_rolling_shutter_slants_what_moves(start: Start) -> None:
    async def left_edge(readout: float) -> NDArray[np.int64]:
        """Return the first red column in the rows of a box that moves by 3 m/s to the left of the image."""
        rolling = ColorCamera(WIDE, (0.0, 0.0, 0.0), readout=readout)
        numbers = count()

        def scene() -> tuple[DrawList, int]:
            number = next(numbers)
            return moving_box(0.12 * number), number

        fields = {**RGBD, "color_camera": rolling, "look": "plain", "noise": False, "background": (0, 0, 0)}
        camera = await start(scene=scene, simulated_clock=True, **fields)
        sets = await camera.take(4, color_camera_enabled=True)
        red = pixels(sets[-1].color_camera)[:, :, 0] > 100
        return np.asarray(red[40:260].argmax(axis=1), np.int64)

    still, slanted = await left_edge(0.0), await left_edge(0.02)
    slope = (slanted - still)[-20:].mean() - (slanted - still)[:20].mean()
    # 3.6 m/s at 1.7 m: 635 px/s; 200 of 300 rows take 13 ms.
    assert slope == pytest.approx(-8.5, abs=3.5)


async def test_images_over_http(start: Start) -> None:
    camera = await start(**RGBD)
    listing = (await get(camera, "/cameras")).json()["cameras"]
    assert [entry["name"] for entry in listing] == ["stereo"]
    description = (await get(camera, "/cameras/0")).json()
    assert description == listing[0]
    assert description["images"]["color"] == {
        "width": 400,
        "height": 300,
        "K": [[300.0, 0.0, 200.0], [0.0, 300.0, 150.0], [0.0, 0.0, 1.0]],
        "K_opencv": [[300.0, 0.0, 199.5], [0.0, 300.0, 149.5], [0.0, 0.0, 1.0]],
    }
    assert np.array(description["X_left_color"])[:3, 3].tolist() == [0.02, 0.0, 0.0]
    small = {"depth": np.uint16, "left": np.uint8, "right": np.uint8, "disparity": np.uint16, "confidence": np.uint8}
    kinds: dict[str, Any] = {name: ((240, 320), dtype) for name, dtype in small.items()}
    kinds |= {"color": ((300, 400, 3), np.uint8), "depth?aligned=true": ((300, 400), np.uint16)}
    for name, kind in kinds.items():
        response = await get(camera, f"/cameras/stereo/{name}")
        image = decoded(response)
        assert (image.shape, image.dtype) == kind, name
        assert float(response.headers["x-timestamp"]) > 1e9


@pytest.mark.parametrize("aligned", [False, True])
async def test_rgbd_file(start: Start, aligned: bool) -> None:
    camera = await start(**RGBD)
    response = await get(camera, f"/cameras/stereo/rgbd.npz?aligned={aligned}")
    with np.load(io.BytesIO(response.content)) as file:
        arrays = dict(file)
    assert arrays["color"].shape == (300, 400, 3)
    assert arrays["depth_mm"].shape == ((300, 400) if aligned else (240, 320))
    assert (arrays["K_depth"] == arrays["K_color"]).all() == aligned
    offset = np.linalg.inv(arrays["X_world_depth"]) @ arrays["X_world_color"]
    assert offset[:3, 3] == pytest.approx([0.0 if aligned else 0.02, 0.0, 0.0])


async def test_images_of_an_earlier_time(start: Start) -> None:
    camera = await start(noise=False)
    asked = []

    async def earlier(time: float) -> SceneState:
        asked.append(time)
        if time < -60.0:
            raise TimeError(f"time={time:g} is gone")
        return SceneState(7_500_000_000, DrawList(), pose(), 3, 7_500_000_000)

    response = await get(camera, "/cameras/stereo/left?time=-5")
    elsewhere = "time=-5: the camera 'stereo' does not see the live scene"
    assert (response.status_code, response.json()["message"]) == (404, elsewhere)
    camera.service.earlier_state = earlier
    response = await get(camera, "/cameras/stereo/left?time=-5")
    assert response.headers["x-timestamp"] == "7.500000000"
    assert not (decoded(response) == decoded(await get(camera, "/cameras/stereo/left"))).all()
    gone = await get(camera, "/cameras/stereo/rgbd.npz?time=-100")
    assert (gone.status_code, gone.json()["message"]) == (404, "time=-100 is gone")
    assert (await get(camera, "/cameras/stereo/left?time=1e11")).status_code == 422
    assert asked == [-5.0, -100.0]


async def test_unknown_cameras_and_images(start: Start) -> None:
    camera = await start(name="wrist")
    response = await get(camera, "/cameras/stereo/color")
    assert (response.status_code, response.json()["message"]) == (404, "there is no camera 'stereo'; there are wrist")
    assert (await get(camera, "/cameras/wrist/thermal")).status_code == 422


async def test_realism_gives_the_colour_camera_shadows_and_vignetting(start: Start) -> None:
    images: list[NDArray[np.float64]] = []
    for parts in (frozenset(), frozenset({"shadows"}), frozenset({"vignetting"})):
        camera = await start(**RGBD, name=f"camera{len(images)}", noise=False, realism=parts)
        camera.service.set_parameters("rc_camera", [("exp_control", "Manual")])
        images.append(decoded(await get(camera, "/cameras/0/color")).astype(float).mean(axis=2))
    plain, shaded, vignetted = images
    assert np.abs(shaded - plain).mean() > 5.0
    corner, centre = vignetted[-20:, :20].mean() / plain[-20:, :20].mean(), np.s_[140:160, 190:210]
    assert corner < 0.85
    assert vignetted[centre].mean() == pytest.approx(plain[centre].mean(), rel=0.02)
