"""The view's routes, with a renderer that only counts."""

import asyncio
import io
from collections.abc import AsyncIterator, Callable
from typing import Any

import httpx2
import numpy as np
import pytest
from fastapi import APIRouter, FastAPI
from fastapi.exceptions import RequestValidationError
from PIL import Image as Pillow

from gateway.adapters.viewer.config import ViewerConfig
from gateway.adapters.viewer.hub import ViewHub
from gateway.adapters.viewer.image_routes import image_router
from gateway.adapters.viewer.resources import RECENT_IMAGES, Resources
from gateway.adapters.viewer.routes import router
from gateway.adapters.viewer.scene_images import ImageRequest, SceneImages
from gateway.adapters.viewer.sensor_images import SensorImages
from gateway.adapters.viewer.sources import StereoImages
from gateway.runtime.http.error_handlers import invalid_parameters
from gateway.runtime.logs.render_record import RenderRecord
from gateway.runtime.workers.pool_errors import DeadlineExceeded, QueueFull
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.cameras import parse_camera
from gateway.scene.draw.live_scene import LiveScene
from gateway.scene.draw.style import Style
from gateway.scene.tree.geometry import Part, PointCloud
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.nodes import Node
from renderers.compiler import pending
from renderers.drawlist import Image, ImageError, Material
from renderers.encode import png_rgb
from renderers.images import image_from_bytes
from renderers.interface import Frame, Look
from renderers.light_rig import Rig
from scenegate.messages.geometry import Box
from tests.adapters.sceneapi.conftest import RecordingRenderer
from tests.adapters.viewer.recordings import SECOND, States
from tests.support.endless import EndlessRenderer, waits_for_studio
from tests.support.view_frames import parse_frame
from tests.support.waiting import SECONDS, until


def app_of(*routers: APIRouter) -> FastAPI:
    app = FastAPI(exception_handlers={RequestValidationError: invalid_parameters})
    for each in routers:
        app.include_router(each)
    return app


def served(*routers: APIRouter) -> httpx2.AsyncClient:
    """Return a client of an application with these routes."""
    return httpx2.AsyncClient(transport=httpx2.ASGITransport(app_of(*routers)), base_url="http://view")


class World:
    """The routes of the view over a tree of one box and a cloud."""

    def __init__(self) -> None:
        self.tree = LiveTree()
        points = np.array([[0, 0, 0], [1, 1, np.nan], [2, 2, 2]], np.float32)
        self.cloud = PointCloud(points, {"intensity": np.array([1, 2, 3], np.float32)})
        with self.tree.edit() as edit:
            edit.set_parts(("box",), (Part(Box((1, 1, 1)), Material()),))
            edit.set_parts(("cloud",), (Part(self.cloud, Material()),))
        self.config = ViewerConfig(
            max_side=1024, max_pixels=800_000, max_streams=1, capture_seconds=1000.0, style=Style(rig=Rig(exposure=0.5))
        )
        self.renders: list[RenderRecord] = []
        self.hub = ViewHub(self.config, self.tree, renders=self.renders)
        self.renderer = RecordingRenderer()
        self.images = SceneImages(self.config, LiveScene(self.tree), self.renderer, WorkerPool(1))
        self.captures = 0
        sensor = SensorImages(self.capture, self.config.capture_seconds)
        self.app = app_of(router(self.hub), image_router(self.images, sensor, self.renders))
        self.http = httpx2.AsyncClient(transport=httpx2.ASGITransport(self.app), base_url="http://view")

    def looks(self) -> list[Look]:
        return [look for *_, look in self.renderer.calls]

    async def capture(self) -> StereoImages:
        self.captures += 1
        await asyncio.sleep(0)
        disparity = np.zeros((30, 40), np.uint16)
        disparity[:, 20:] = np.linspace(100, 900, 20).astype(np.uint16)
        left = np.full((60, 80, 3), (250, 10, 10), np.uint8)
        confidence = np.full((30, 40), 255, np.uint8)
        return StereoImages(left, left[:, :, 0].copy(), disparity, confidence, {"left": "5 ms"})


@pytest.fixture
async def world() -> AsyncIterator[World]:
    made = World()
    async with made.http:
        yield made


def decode(data: bytes) -> Any:
    return np.asarray(Pillow.open(io.BytesIO(data)).convert("RGB")).astype(int)


async def test_page_and_assets_are_served_with_caching_headers(world: World) -> None:
    page = await world.http.get("/view")
    assert page.status_code == 200
    names = [part.split('"')[0] for part in page.text.split('"view/assets/')[1:]]
    assert len(names) == 2
    for name in names:
        asset = await world.http.get(f"/view/assets/{name}")
        assert asset.status_code == 200
        assert "immutable" in asset.headers["cache-control"]
        assert asset.headers["content-encoding"] == "gzip"
        plain = await world.http.get(f"/view/assets/{name}", headers={"Accept-Encoding": "identity"})
        assert "content-encoding" not in plain.headers
        assert plain.content == asset.content
        assert plain.headers["etag"] != asset.headers["etag"]
        assert plain.headers["vary"] == asset.headers["vary"] == "Accept-Encoding"
    again = await world.http.get("/view", headers={"If-None-Match": page.headers["etag"]})
    assert again.status_code == 304
    for path in ("nothing.js", "..%2Findex.html", "%2e%2e"):
        assert (await world.http.get(f"/view/assets/{path}")).status_code == 404


async def test_images_of_an_earlier_time(world: World) -> None:
    past = States([Snapshot(Node(), revision, second * SECOND) for revision, second in ((77, 1000), (78, 1010))])
    images = SceneImages(world.config, LiveScene(world.tree, timeline=past), world.renderer, WorkerPool(1))
    async with served(image_router(images, None, world.renders)) as http:
        for time in ("1002.5", "-7.5"):
            response = await http.get(f"/view/frame.jpg?width=64&height=48&time={time}")
            assert (response.status_code, response.headers["x-scene-revision"]) == (200, "77")
        response = await http.get("/view/frame.jpg?time=-500")
        assert (response.status_code, response.text[:16]) == (404, "time=-500 is 510")
        assert (await http.get("/view/frame.jpg?time=1e11")).status_code == 422
        assert (await http.get("/view/frame.jpg?width=64&height=48")).headers["x-scene-revision"] != "77"


async def test_concurrent_requests_share_one_rendering_per_revision(world: World) -> None:
    responses = await asyncio.gather(*(world.http.get("/view/frame.jpg?width=64&height=48") for _ in range(5)))
    assert {response.status_code for response in responses} == {200}
    assert len(world.renderer.calls) == 1
    assert decode(responses[0].content).shape == (48, 64, 3)
    with world.tree.edit() as edit:
        edit.set_pose(("box",), (1, 0, 0, 1, 0, 0, 0))
    second = await world.http.get("/view/frame.jpg?width=64&height=48")
    assert int(second.headers["x-scene-revision"]) == world.tree.snapshot.revision
    assert len(world.renderer.calls) == 2
    assert world.looks() == [Look("studio", world.config.style.background, 4, Rig(exposure=0.5))] * 2


async def test_an_image_waits_for_its_kernels_without_a_worker_thread(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(world.renderer, "render", waits_for_studio(world.renderer.render))
    with pending.announced({"studio": lambda name: name.startswith("studio.")}):
        studio = asyncio.ensure_future(world.http.get("/view/frame.jpg?width=64&height=48"))
        for width in (64, 65):
            plain = await world.http.get(f"/view/frame.jpg?width={width}&height=48&look=plain")
            assert plain.status_code == 200
        assert [look.name for look in world.looks()] == ["plain", "plain"]
        pending.finish("studio")
        assert (await studio).status_code == 200


@pytest.mark.parametrize(
    ("query", "status", "word"),
    [
        ("camera=nowhere", 422, "nowhere"),
        ('camera=path:["missing"]', 404, "no such node"),
        ("camera=stereo", 404, "no stereo camera"),
        ("width=1025&height=8", 422, "1025x8 is too large"),
        ("width=8&height=1025", 422, "8x1025 is too large"),
        ("width=1024&height=782", 422, "800000 pixels in total"),
        ("hide=box", 422, "hide='box' is not a JSON list of paths"),
        ("show=[[1.5]]", 422, "show='[[1.5]]' is not a JSON list of paths"),
        ("background=white", 422, "background='white' is not a colour in six hexadecimal digits"),
    ],
)
async def test_invalid_requests_get_an_error_message(world: World, query: str, status: int, word: str) -> None:
    for path in ("/view/frame.jpg", "/view/stream.mjpg"):
        response = await world.http.get(f"{path}?{query}")
        assert response.status_code == status
        assert word in response.text
    assert world.images.streams == 0


async def test_images_have_the_visibility_and_background_of_the_query(world: World) -> None:
    for query in ("width=32&height=24", "width=32&height=24&hide=[[]]&background=0080ff"):
        assert (await world.http.get(f"/view/frame.jpg?{query}")).status_code == 200
    first, second = world.looks()
    assert second.background == (0, 128, 255) != first.background
    before, after = (len(scene.instances) for scene, *_ in world.renderer.calls)
    assert (before > 0, after) == (True, 0)


@pytest.mark.parametrize(
    ("query", "size"),
    [
        ("", (960, 640)),
        ("width=90", (90, 640)),
        ("height=60", (960, 60)),
        ("width=1024&height=1", (1024, 1)),
        ("width=1&height=1024", (1, 1024)),
        ("width=1000&height=800", (1000, 800)),
    ],
)
async def test_sizes_up_to_the_limits_and_their_defaults(world: World, query: str, size: tuple[int, int]) -> None:
    response = await world.http.get(f"/view/frame.jpg?{query}")
    ((_, camera, *_),) = world.renderer.calls
    assert (camera.width, camera.height) == size
    assert decode(response.content).shape == (size[1], size[0], 3)


async def test_stream_sends_an_image_per_change_until_shutdown(world: World) -> None:
    request = ImageRequest(parse_camera("fit"), 32, 24, 80, "plain")
    closing = False
    parts = world.images.stream(request, 1000.0, lambda: closing)
    async with asyncio.timeout(SECONDS):
        first = await anext(parts)
        with world.tree.edit() as edit:
            edit.set_pose(("box",), (2, 0, 0, 1, 0, 0, 0))
        second = await anext(parts)
        closing = True
        assert [part async for part in parts] == []
    for part in (first, second):
        head, _, body = part.partition(b"\r\n\r\n")
        assert b"image/jpeg" in head
        assert decode(body.removesuffix(b"\r\n")).shape == (24, 32, 3)
    assert world.images.streams == 0


async def test_browsers_share_captures_of_the_stereo_camera(world: World) -> None:
    states = await asyncio.gather(*(world.http.get("/view/sensor") for _ in range(4)))
    assert world.captures == 1
    assert states[0].json() == {"number": 1, "captions": {"left": "5 ms"}}
    left = decode((await world.http.get("/view/sensor/left.jpg?width=40")).content)
    assert left.shape == (30, 40, 3)
    np.testing.assert_allclose(left, np.broadcast_to((250, 10, 10), left.shape), atol=3)
    right = decode((await world.http.get("/view/sensor/right.jpg?width=4000")).content)
    assert right.shape == (60, 80, 3)
    np.testing.assert_allclose(right, 250, atol=3)  # grey
    confidence = decode((await world.http.get("/view/sensor/confidence.jpg")).content)
    np.testing.assert_allclose(confidence, np.broadcast_to((253, 231, 37), confidence.shape), atol=4)
    disparity = decode((await world.http.get("/view/sensor/disparity.jpg")).content)
    assert disparity[:, :16].max() < 40, "invalid is black"
    assert disparity[:, 24:].max() > 150
    assert world.captures == 1
    assert (await world.http.get("/view/sensor/up.jpg")).status_code == 404


async def test_renders_are_listed_with_previews(world: World) -> None:
    png = png_rgb(np.zeros((6, 8, 3), np.uint8))
    fields = ("color", "scene", "color", png, "image/png", "", ("no labels",))
    world.renders.append(RenderRecord(1, 5.0, 200, 0.0123456, 0.0034567, *fields))
    world.renders.append(RenderRecord(2, 0.0, 400, 0.01, 0.0, "not understood", "", "", b"", "", "width is missing"))
    failed, made = (await world.http.get("/view/renders")).json()
    assert [failed[name] for name in ("status", "error", "warnings")] == [400, "width is missing", []]
    names = ("id", "status", "when", "milliseconds", "queued", "warnings")
    assert [made[name] for name in names] == [1, 200, 5.0, 12.35, 3.46, ["no labels"]]
    assert (await world.http.get("/view/renders/1.png")).content == png
    assert decode((await world.http.get("/view/renders/1.png?width=4")).content).shape == (3, 4, 3)
    assert (await world.http.get("/view/renders/2.png")).status_code == 404


async def test_channel_has_values_of_finite_points_only(world: World) -> None:
    browser = world.hub.connect()
    numbers = []
    async for frame in browser.frames():
        header, _ = parse_frame(frame)
        if header["kind"] == "update":
            break
        if header["kind"] == "mesh" and header["topology"] == 1:
            numbers.append(header["id"])
    browser.close()
    response = await world.http.get(f"/view/channel/{numbers[0]}?name=intensity")
    assert np.frombuffer(response.content, "<f4").tolist() == [1.0, 3.0]
    assert (await world.http.get(f"/view/channel/{numbers[0]}?name=none")).status_code == 404
    assert (await world.http.get("/view/image/12345")).status_code == 404


def test_replaced_images_are_kept_for_pages_that_still_download_them() -> None:
    resources = Resources()
    numbers = [resources.image_id(Image(b"", lambda: np.zeros((1, 1, 4), np.uint8))) for _ in range(RECENT_IMAGES + 1)]
    assert [resources.image(number) is None for number in numbers] == [True, *(False,) * RECENT_IMAGES]


class EndlessWorld(World):
    """A renderer that never finishes."""

    def __init__(self, seconds: float | None) -> None:
        super().__init__()
        self.endless = EndlessRenderer()
        self.workers = WorkerPool(1, seconds=seconds, limit_name="--render-seconds")
        self.images = SceneImages(self.config, LiveScene(self.tree), self.endless, self.workers)


async def test_timed_out_rendering_is_not_reused() -> None:
    world = EndlessWorld(0.05)
    async with served(image_router(world.images, None, world.renders)) as http:
        for path in ("frame.jpg", "frame.jpg", "stream.mjpg"):
            response = await http.get(f"/view/{path}?width=64&height=48")
            assert (response.status_code, response.text) == (
                503,
                "rendering was stopped: it took longer than --render-seconds = 0.05 s",
            )
            assert "retry-after" not in response.headers
    assert world.endless.ended == 3
    assert await world.workers.close()


async def test_rendering_is_cancelled_with_its_last_caller() -> None:
    world = EndlessWorld(None)
    request = ImageRequest(parse_camera("fit"), 64, 48, 80, "plain")
    waiting = [asyncio.create_task(world.images.jpeg(request)) for _ in range(3)]
    await until(lambda: world.endless.begun == 1)
    for number, one in enumerate(waiting):
        assert world.endless.ended == 0, number
        one.cancel()
        await asyncio.gather(one, return_exceptions=True)
    await until(lambda: world.endless.ended == 1)
    again = asyncio.create_task(world.images.jpeg(request))  # starts a new rendering
    await until(lambda: world.endless.begun == 2)
    again.cancel()
    await until(lambda: world.endless.ended == 2)
    assert await world.workers.close()


async def test_without_a_stereo_camera_its_images_are_missing(world: World) -> None:
    async with served(image_router(world.images, None, world.renders)) as http:
        state = await http.get("/view/sensor")
        image = await http.get("/view/sensor/left.jpg")
    assert (state.status_code, state.content) == (204, b"")
    assert (image.status_code, image.text) == (404, "No stereo camera runs in this gateway.")


async def test_a_capture_is_used_until_it_is_too_old(world: World) -> None:
    fresh = SensorImages(world.capture, 1000.0)
    stale = SensorImages(world.capture, 0.0)
    assert [(await fresh.fresh_capture()).number for _ in range(3)] == [1, 1, 1]
    assert [(await stale.fresh_capture()).number for _ in range(3)] == [1, 2, 3]
    assert (await stale.last_capture()).number == 3
    assert world.captures == 4


async def test_streams_beyond_the_limit_are_asked_to_try_again(world: World) -> None:
    request = ImageRequest(parse_camera("fit"), 32, 24, 80, "plain")
    parts = world.images.stream(request, 15.0, lambda: False)
    response = await world.http.get("/view/stream.mjpg?width=32&height=24")
    assert (response.status_code, response.headers["retry-after"]) == (503, "10")
    assert response.text == "1 streams are open, which is the limit (max_streams)"
    await anext(parts)
    await parts.aclose()  # type: ignore[attr-defined]  # an async generator
    assert world.images.streams == 0


@pytest.mark.parametrize(("query", "rate"), [("", 15.0), ("&rate=4", 4.0), ("&rate=30", 30.0), ("&rate=31", 30.0)])
async def test_streams_have_the_requested_rate_up_to_the_limit(
    world: World, query: str, rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rates: list[float] = []
    stream = world.images.stream

    def recorded(request: ImageRequest, rate: float, closing: Callable[[], bool]) -> AsyncIterator[bytes]:
        rates.append(rate)
        return stream(request, rate, closing)

    monkeypatch.setattr(world.images, "stream", recorded)
    world.app.state.closing = lambda: True
    response = await world.http.get(f"/view/stream.mjpg?width=32&height=24{query}")
    assert response.headers["x-accel-buffering"] == "no", "nginx would keep the end of each image"
    assert (response.status_code, response.content) == (200, b"")
    assert response.headers["content-type"] == "multipart/x-mixed-replace; boundary=scenegate-frame"
    assert rates == [rate]
    assert world.looks() == [Look("plain", world.config.style.background, 1, world.config.style.rig)]
    assert world.images.streams == 0


async def test_an_unchanged_image_is_repeated(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.adapters.viewer.scene_images._REPEAT_SECONDS", 0.01)
    parts = world.images.stream(ImageRequest(parse_camera("fit"), 32, 24, 80, "plain"), 1000.0, lambda: False)
    async with asyncio.timeout(SECONDS):
        assert await anext(parts) == await anext(parts)
    assert len(world.renderer.calls) == 1
    await parts.aclose()  # type: ignore[attr-defined]  # an async generator


async def test_a_stream_ends_at_a_timed_out_rendering_and_outlives_a_full_queue(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    results: list[Exception | tuple[bytes, int]] = [
        QueueFull("the queue is full", 0),
        (b"image", 1),
        DeadlineExceeded("too slow"),
    ]

    async def jpeg(_: ImageRequest) -> tuple[bytes, int]:
        result = results.pop(0)
        if isinstance(result, Exception):
            raise result
        return result

    monkeypatch.setattr(world.images, "jpeg", jpeg)
    monkeypatch.setattr("gateway.adapters.viewer.scene_images._REPEAT_SECONDS", 0.0)
    parts = world.images.stream(ImageRequest(parse_camera("fit"), 32, 24, 80, "plain"), 1000.0, lambda: False)
    async with asyncio.timeout(SECONDS):
        images = [part async for part in parts]
    assert images == [b"--scenegate-frame\r\nContent-Type: image/jpeg\r\nContent-Length: 5\r\n\r\nimage\r\n"]
    assert results == []
    assert world.images.streams == 0


async def test_textures_that_cannot_be_decoded_fail_the_image(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    def render(*_: Any, **__: Any) -> Frame:
        raise ImageError("the texture is broken")

    monkeypatch.setattr(world.renderer, "render", render)
    response = await world.http.get("/view/frame.jpg?width=32&height=24")
    assert (response.status_code, response.text) == (422, "the texture is broken")


async def test_previews_that_are_not_images_and_those_that_were_dropped(world: World) -> None:
    for number, (kind, media_type) in enumerate((("color", "image/png"), ("depth", "image/tiff"))):
        fields = ("", "", kind, b"no image", media_type, "")
        world.renders.append(RenderRecord(number, 0.0, 200, 0.0, 0.0, *fields))
        assert (await world.http.get(f"/view/renders/{number}.png?width=4")).status_code == 415
    response = await world.http.get("/view/renders/2.png")
    assert (response.status_code, response.text) == (404, "the image of render 2 is no longer kept")


async def test_textures_of_the_scene_are_sent_as_png(world: World) -> None:
    pixels = np.array([[(255, 0, 10, 255), (0, 200, 0, 128)]], np.uint8)
    good, broken = Image(b"good", lambda: pixels), image_from_bytes(b"no image")
    numbers = {name: world.hub.resources.image_id(image) for name, image in (("good", good), ("broken", broken))}
    response = await world.http.get(f"/view/image/{numbers['good']}")
    assert response.headers["content-type"] == "image/png"
    np.testing.assert_array_equal(np.asarray(Pillow.open(io.BytesIO(response.content)).convert("RGBA")), pixels)
    response = await world.http.get(f"/view/image/{numbers['broken']}")
    assert response.status_code == 415
    assert response.text.startswith(f"image {numbers['broken']}: ")


@pytest.mark.parametrize(("path", "quality"), [("frame.jpg", 85), ("stream.mjpg", 80)])
async def test_default_and_requested_quality(
    world: World, path: str, quality: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    requests: list[ImageRequest] = []

    async def jpeg(request: ImageRequest, time: float | None = None) -> tuple[bytes, int]:
        requests.append(request)
        return b"", 1

    monkeypatch.setattr(world.images, "jpeg", jpeg)
    world.app.state.closing = lambda: True
    for query in ("", "?quality=1", "?quality=100"):
        assert (await world.http.get(f"/view/{path}{query}")).status_code == 200
    assert [request.quality for request in requests] == [quality, 1, 100]
    for value in (0, 101):
        assert (await world.http.get(f"/view/{path}?quality={value}")).status_code == 422


@pytest.mark.parametrize(("look", "samples"), [("studio", 4), ("phong", 1), ("pbr", 1), ("plain", 1)])
async def test_only_the_studio_look_has_several_samples(world: World, look: str, samples: int) -> None:
    await world.http.get(f"/view/frame.jpg?width=32&height=24&look={look}")
    (chosen,) = world.looks()
    assert (chosen.name, chosen.samples) == (look, samples)
