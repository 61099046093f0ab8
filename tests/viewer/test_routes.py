"""Pictures and files of the view over HTTP, drawn by a renderer that only counts."""

from __future__ import annotations

import asyncio
import io
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

import httpx2
import numpy as np
import pytest
from fastapi import FastAPI
from PIL import Image as Pillow

from gateway.runtime.worker_pool import WorkerPool
from gateway.scene.cameras import parse_camera
from gateway.scene.flatten import Flattener
from gateway.scene.geometry import Box, Part, PointCloud
from gateway.scene.labels import LabelTable
from gateway.scene.live import LiveTree
from gateway.viewer.config import ViewerConfig
from gateway.viewer.frames import parse
from gateway.viewer.hub import ViewHub
from gateway.viewer.image_routes import picture_router
from gateway.viewer.routes import router
from gateway.viewer.scene_images import Pictures, View
from gateway.viewer.sensor import SensorView
from gateway.viewer.sources import RenderNote, SensorPictures
from renderers.camera import Camera
from renderers.drawlist import DrawList, Material
from renderers.encode import png_gray16, png_rgb, tiff_float32
from renderers.interface import Frame, Look, Output
from renderers.light_rig import Rig
from tests.support.endless import EndlessRenderer
from tests.support.waiting import SECONDS, until


@dataclass
class CountingRenderer:
    """Grey pictures."""

    cameras: list[Camera] = field(default_factory=list)
    looks: list[Look | None] = field(default_factory=list)

    def render(self, scene: DrawList, camera: Camera, outputs: Output, look: Look | None = None) -> Frame:
        self.cameras.append(camera)
        self.looks.append(look)
        return Frame(color=np.full((camera.height, camera.width, 3), 90, np.uint8))


class World:
    """The routes of the view over a tree of one box and a cloud."""

    def __init__(self) -> None:
        self.tree = LiveTree()
        points = np.array([[0, 0, 0], [1, 1, np.nan], [2, 2, 2]], np.float32)
        self.cloud = PointCloud(points, {"intensity": np.array([1, 2, 3], np.float32)})
        with self.tree.edit() as edit:
            edit.set_parts(("box",), (Part(Box((1, 1, 1)), Material()),))
            edit.set_parts(("cloud",), (Part(self.cloud, Material()),))
        self.config = ViewerConfig(max_side=1024, max_streams=1, sensor_seconds=1000.0, rig=Rig(exposure=0.5))
        self.hub = ViewHub(self.config, self.tree)
        self.renderer = CountingRenderer()
        flattener = Flattener(LabelTable())
        self.pictures = Pictures(self.config, self.tree, flattener, self.renderer, WorkerPool(1))
        self.takes = 0
        self.app = FastAPI()
        self.app.include_router(router(self.hub))
        sensor = SensorView(self.take, self.config.sensor_seconds)
        self.app.include_router(picture_router(self.pictures, sensor, self.hub.renders))
        self.http = httpx2.AsyncClient(transport=httpx2.ASGITransport(self.app), base_url="http://view")

    async def take(self) -> SensorPictures:
        self.takes += 1
        await asyncio.sleep(0)
        disparity = np.zeros((30, 40), np.uint16)
        disparity[:, 20:] = np.linspace(100, 900, 20).astype(np.uint16)
        left = np.full((60, 80, 3), (250, 10, 10), np.uint8)
        confidence = np.full((30, 40), 255, np.uint8)
        return SensorPictures(left, left[:, :, 0].copy(), disparity, confidence, {"left": "5 ms"})


@pytest.fixture
async def world() -> AsyncIterator[World]:
    made = World()
    async with made.http:
        yield made


def picture(data: bytes) -> Any:
    return np.asarray(Pillow.open(io.BytesIO(data)).convert("RGB")).astype(int)


async def test_the_page_and_its_files_are_served_and_named_by_content(world: World) -> None:
    page = await world.http.get("/view")
    assert page.status_code == 200
    names = [part.split('"')[0] for part in page.text.split('"/view/assets/')[1:]]
    assert len(names) == 2
    for name in names:
        asset = await world.http.get(f"/view/assets/{name}")
        assert asset.status_code == 200
        assert "immutable" in asset.headers["cache-control"]
    again = await world.http.get("/view", headers={"If-None-Match": page.headers["etag"]})
    assert again.status_code == 304
    for path in ("nothing.js", "..%2Findex.html", "%2e%2e"):
        assert (await world.http.get(f"/view/assets/{path}")).status_code == 404


async def test_frame_is_drawn_once_per_revision(world: World) -> None:
    answers = await asyncio.gather(*(world.http.get("/view/frame.jpg?width=64&height=48") for _ in range(5)))
    assert {answer.status_code for answer in answers} == {200}
    assert len(world.renderer.cameras) == 1
    assert picture(answers[0].content).shape == (48, 64, 3)
    with world.tree.edit() as edit:
        edit.set_pose(("box",), (1, 0, 0, 1, 0, 0, 0))
    second = await world.http.get("/view/frame.jpg?width=64&height=48")
    assert int(second.headers["x-scene-revision"]) == world.tree.snapshot.revision
    assert len(world.renderer.cameras) == 2
    assert world.renderer.looks == [Look("studio", world.config.background, 4, Rig(exposure=0.5))] * 2


@pytest.mark.parametrize(
    ("query", "status", "word"),
    [
        ("camera=nowhere", 400, "nowhere"),
        ('camera=path:["missing"]', 404, "no such node"),
        ("camera=stereo", 404, "no stereo camera"),
        ("width=1025", 400, "1025"),
    ],
)
async def test_bad_views_get_a_sentence(world: World, query: str, status: int, word: str) -> None:
    for path in ("/view/frame.jpg", "/view/stream.mjpg"):
        answer = await world.http.get(f"{path}?{query}")
        assert answer.status_code == status
        assert word in answer.text
    assert world.pictures.streams == 0


async def test_stream_sends_a_picture_per_change_and_ends(world: World) -> None:
    from gateway.scene.cameras import parse_camera
    from gateway.viewer.scene_images import StreamsFull, View

    view = View(parse_camera("fit"), 32, 24, 80, "plain")
    closing = False
    parts = world.pictures.stream(view, 1000.0, lambda: closing)
    with pytest.raises(StreamsFull, match="max_streams"):
        world.pictures.stream(view, 1.0, lambda: False)
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
        assert picture(body.removesuffix(b"\r\n")).shape == (24, 32, 3)
    assert world.pictures.streams == 0


async def test_sensor_pictures_are_taken_once_for_all(world: World) -> None:
    states = await asyncio.gather(*(world.http.get("/view/sensor") for _ in range(4)))
    assert world.takes == 1
    assert states[0].json() == {"number": 1, "captions": {"left": "5 ms"}}
    left = picture((await world.http.get("/view/sensor/left.jpg?width=40")).content)
    assert left.shape == (30, 40, 3)
    assert left[:, :, 0].mean() > 200
    disparity = picture((await world.http.get("/view/sensor/disparity.jpg")).content)
    assert disparity[:, :16].max() < 40, "invalid is black"
    assert disparity[:, 24:].max() > 150
    assert world.takes == 1
    assert (await world.http.get("/view/sensor/up.jpg")).status_code == 404


async def test_renders_are_listed_and_shown(world: World) -> None:
    rgb = np.zeros((6, 8, 3), np.uint8)
    rgb[:, :, 0] = 200
    depth = np.full((6, 8), np.inf, np.float32)
    depth[:, 4:] = np.linspace(1, 2, 24).reshape(6, 4)
    notes = [
        ("color", png_rgb(rgb), "image/png"),
        ("depth", tiff_float32(depth), "image/tiff"),
        ("depth", png_gray16(np.full((6, 8), 1500, np.uint16)), "image/png"),
    ]
    for kind, body, media_type in notes:
        world.hub.renders.add(RenderNote(200, 0.01, 0.002, kind, "scene", kind, body, media_type, ""))
    world.hub.renders.add(RenderNote(400, 0.01, 0.0, "not understood", "", "", b"", "", "width is missing"))
    listing = (await world.http.get("/view/renders")).json()
    assert [entry["status"] for entry in listing] == [400, 200, 200, 200]
    assert listing[0]["error"] == "width is missing"
    assert (await world.http.get(f"/view/renders/{listing[3]['id']}.png")).content == notes[0][1]
    shown = picture((await world.http.get(f"/view/renders/{listing[2]['id']}.png")).content)
    assert shown[:, :4].max() == 0
    assert shown[0, 4, 0] > shown[0, 4, 2], "near is red"
    assert shown[5, 7, 2] >= shown[5, 7, 0], "far is blue"
    assert (await world.http.get(f"/view/renders/{listing[1]['id']}.png?width=4")).status_code == 200
    assert (await world.http.get(f"/view/renders/{listing[0]['id']}.png")).status_code == 404


def test_kept_renders_are_bounded() -> None:
    from gateway.viewer.renders import RecentRenders

    recent = RecentRenders(most=3, most_bytes=10)
    for _ in range(5):
        recent.add(RenderNote(200, 0.0, 0.0, "", "", "color", b"123456", "image/png", ""))
    listing = recent.listing()
    assert [entry["id"] for entry in listing] == [5, 4, 3]
    assert [entry["picture"] for entry in listing] == [True, False, False]
    assert recent.count == 5


async def test_channels_of_clouds_are_served_for_the_points_that_are_drawn(world: World) -> None:
    browser = world.hub.connect()
    numbers = []
    async for frame in browser.frames():
        header, _ = parse(frame)
        if header["kind"] == "update":
            break
        if header["kind"] == "mesh" and header["topology"] == 1:
            numbers.append(header["id"])
    browser.close()
    answer = await world.http.get(f"/view/channel/{numbers[0]}?name=intensity")
    assert np.frombuffer(answer.content, "<f4").tolist() == [1.0, 3.0]
    assert (await world.http.get(f"/view/channel/{numbers[0]}?name=none")).status_code == 404
    assert (await world.http.get("/view/image/12345")).status_code == 404


def test_pictures_that_cannot_be_read_are_refused() -> None:
    from gateway.viewer.renders import shown

    with pytest.raises(ValueError, match="image/tiff"):
        shown(RenderNote(200, 0, 0, "", "", "depth", b"", "image/tiff", ""), b"no picture", None)


class EndlessWorld(World):
    """Nothing that it draws is ever finished."""

    def __init__(self, seconds: float | None) -> None:
        super().__init__()
        self.endless = EndlessRenderer()
        self.workers = WorkerPool(1, seconds=seconds, limit_name="--render-seconds")
        flattener = Flattener(LabelTable())
        self.pictures = Pictures(self.config, self.tree, flattener, self.endless, self.workers)


async def test_a_picture_that_takes_too_long_is_given_up_and_drawn_anew_for_the_next() -> None:
    world = EndlessWorld(0.05)
    app = FastAPI()
    app.include_router(picture_router(world.pictures, None, world.hub.renders))
    async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app), base_url="http://view") as http:
        for path in ("frame.jpg", "frame.jpg", "stream.mjpg"):
            answer = await http.get(f"/view/{path}?width=64&height=48")
            assert (answer.status_code, answer.text) == (
                503,
                "the picture was given up: it took longer than --render-seconds = 0.05 s",
            )
            assert "retry-after" not in answer.headers
    assert world.endless.ended == 3
    assert await world.workers.close()


async def test_a_picture_is_given_up_when_the_last_of_those_who_wait_for_it_has_left() -> None:
    world = EndlessWorld(None)
    view = View(parse_camera("fit"), 64, 48, 80, "plain")
    waiting = [asyncio.create_task(world.pictures.jpeg(view)) for _ in range(3)]
    await until(lambda: world.endless.begun == 1)
    for number, one in enumerate(waiting):
        assert world.endless.ended == 0, number
        one.cancel()
        await asyncio.gather(one, return_exceptions=True)
    await until(lambda: world.endless.ended == 1)
    again = asyncio.create_task(world.pictures.jpeg(view))  # the old one is not waited for
    await until(lambda: world.endless.begun == 2)
    again.cancel()
    await until(lambda: world.endless.ended == 2)
    assert await world.workers.close()
