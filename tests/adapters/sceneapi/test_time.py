"""``time`` of ``GET /scene``, ``/scene.glb`` and ``/scene/render``."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import numpy as np
import pytest

from gateway.adapters.sceneapi.config import SceneApiConfig
from gateway.adapters.sceneapi.service import SceneApi
from gateway.files.gltf import read_gltf
from gateway.replay.history import TreeHistory
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.live_scene import LiveScene
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree, Snapshot
from renderers.camera import Camera
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.adapters.sceneapi.conftest import RecordingRenderer, client_of

SECOND = 1_000_000_000


class World:
    """A box that is at x = 0, 1, 2, 3 at 1000, 1001, 1002, 1003 seconds since the epoch; now it is 1003.5."""

    def __init__(self) -> None:
        self.now = 1000 * SECOND
        self.tree = LiveTree(lambda: self.now)
        self.history = TreeHistory(self.tree, 60.0, 1 << 26, asyncio.to_thread, lambda: self.now)
        for x in range(4):
            self.now = (1000 + x) * SECOND
            with self.tree.edit() as edit:
                if x == 0:
                    edit.set_parts(("box",), (Part(Box((1, 1, 1)), Material()),))
                edit.set_pose(("box",), (x, 0, 0, 1, 0, 0, 0))
            self.history.record()
        self.now = 1003 * SECOND + SECOND // 2
        self.renderer = RecordingRenderer()
        self.workers = WorkerPool(2)
        config = SceneApiConfig(width=64, height=48)
        scene = LiveScene(self.tree, timeline=self.history, stereo_camera=self.stereo_camera)
        self.client = client_of(SceneApi(scene, self.renderer, self.workers, config))

    def stereo_camera(self, snapshot: Snapshot) -> Camera:
        box: Any = snapshot.root.find(("box",))
        return Camera(64, 48, 50, 50, 32, 24, 0.1, 10, box.matrix)

    async def box(self, time: str) -> float:
        listing = (await self.client.get(f"/scene?time={time}")).json()
        return float(next(node for node in listing["nodes"] if node["path"] == ["box"])["transform"][0][3])


@pytest.fixture
async def world() -> AsyncIterator[World]:
    world = World()
    async with world.client:
        yield world
    await world.workers.close(5.0)


async def test_a_time_is_absolute_or_before_now(world: World) -> None:
    found = [await world.box(time) for time in ("1000", "1001.999", "1002.5", "-3.4", "-1.6", "-0.1", "-0", "1003.5")]
    assert found == [0, 1, 2, 0, 1, 3, 3, 3]


async def test_images_and_files_show_the_scene_of_the_time(world: World) -> None:
    for time, x in (("1000.5", 0.0), ("1002", 2.0)):
        response = await world.client.get(f"/scene/render?camera=stereo&time={time}")
        assert (response.status_code, response.headers["x-scene-revision"]) == (200, str(int(x) + 1))
        draw_list, camera, *_ = world.renderer.calls[-1]
        assert draw_list.instances[0].X_world_mesh[0, 3] == camera.X_world_camera[0, 3] == x
        file = await world.client.get(f"/scene.glb?time={time}")
        scene = read_gltf(file.content)
        (placed,) = [draw.X_world_mesh[0, 3] for draw in flatten(scene.root).instances]
        np.testing.assert_allclose(placed, x)
        assert not scene.cameras, "no camera was asked for"
        assert file.headers["etag"] == (await world.client.get(f"/scene.glb?time={time}")).headers["etag"]
        cached = await world.client.get(f"/scene?time={time}", headers={"If-None-Match": file.headers["etag"]})
        assert cached.status_code == 304


async def test_the_newest_listing_is_that_of_now(world: World) -> None:
    await world.box("1001")
    assert (await world.client.get("/scene")).json()["revision"] == 4
    assert (await world.client.get("/scene?time=-0.2")).json()["revision"] == 4


@pytest.mark.parametrize("route", ["/scene", "/scene.glb", "/scene/render"])
@pytest.mark.parametrize(
    ("time", "status", "text"),
    [
        ("999", 404, "time=999 is 999.000 (00:16:39 UTC); the history has 1000.000"),
        ("-3.6", 404, "the last 3.5 seconds"),
        ("1004", 404, "1003.500 (00:16:43 UTC)"),
        ("-1e10", 404, "time=-10000000000 is"),
        ("now", 422, "time: Input should be a valid number"),
        ("nan", 422, "time: Input should be"),
        ("1e11", 422, "time: Input should be less than or equal to 10000000000, got '1e11'"),
    ],
)
async def test_other_times_are_errors_with_the_span(
    world: World, route: str, time: str, status: int, text: str
) -> None:
    response = await world.client.get(route, params={"time": time})
    assert response.status_code == status
    assert text in response.text


async def test_without_a_history_there_is_only_now() -> None:
    workers = WorkerPool(1)
    async with client_of(SceneApi(LiveScene(LiveTree()), RecordingRenderer(), workers)) as client:
        response = await client.get("/scene?time=-1")
    assert (response.status_code, "--history-seconds 0" in response.text) == (404, True)
    await workers.close(5.0)
