"""The IMU over HTTP and WebSocket, with the camera's clock and its images."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any

import httpx2 as httpx
import numpy as np
import pytest
from fastapi import FastAPI
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Origin

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.imaging.recorded_pairs import PairImaging
from gateway.adapters.stereo.imaging.scene_view import SceneView
from gateway.adapters.stereo.imu.imu_service import Imu, PoseLog
from gateway.adapters.stereo.routes.imu_routes import imu_router
from gateway.adapters.stereo.service import StereoService
from gateway.runtime.http.http_server import PortService
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.mount import Mount
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from renderers.raster import CpuRenderer
from renderers.stereo.imu.imu_model import GRAVITY
from tests.adapters.stereo.conftest import SMALL, Camera, Start
from tests.adapters.stereo.imu_motion import matrices, rest
from tests.support.waiting import SECONDS, until

websocket = partial(connect, open_timeout=SECONDS, ping_interval=None)


@asynccontextmanager
async def served(*services: StereoService) -> AsyncIterator[httpx.AsyncClient]:
    """Serve the routes and yield a client."""
    app = FastAPI()
    app.include_router(imu_router(*services))
    http = PortService(app, "127.0.0.1", 0)
    serving = asyncio.create_task(http.run())
    await until(lambda: http.ready)
    base_url = f"http://127.0.0.1:{http.status()['port']}"
    async with httpx.AsyncClient(base_url=base_url, timeout=SECONDS) as client:
        yield client
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)


@asynccontextmanager
async def moving(renderer: CpuRenderer, tree: LiveTree, **fields: Any) -> AsyncIterator[StereoService]:
    """Run a camera on the node ``camera`` of a live tree with the system clock."""
    view = SceneView(tree, Flattener(LabelTable()), Mount(np.eye(4), ("camera",)))
    poses = PoseLog(tree, view.pose_in)
    workers = WorkerPool(1, seconds=None, limit_name="--render-seconds")
    config = StereoConfig(port=0, model=SMALL, look="phong", **fields)
    service = StereoService(config, view.state, renderer, workers, poses)
    task = asyncio.create_task(service.run())
    await until(lambda: service.ready or task.done())
    yield service
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert await workers.close(10.0)


async def read(client: httpx.AsyncClient, count: int, path: str = "/stereo/imu") -> list[Any]:
    """Return the first lines of a stream."""
    lines: list[Any] = []
    async with client.stream("GET", path) as response:
        assert response.status_code == 200
        assert response.headers["content-type"] == "application/x-ndjson"
        async for line in response.aiter_lines():
            lines.append(json.loads(line))
            if len(lines) >= count:
                break
    return lines


def timestamps(lines: list[Any]) -> list[int]:
    return [line["timestamp"]["sec"] * 10**9 + line["timestamp"]["nsec"] for line in lines]


def set_pose(tree: LiveTree, matrix: Any) -> None:
    with tree.edit() as edit:
        edit.set_matrix(("camera",), matrix)


async def test_a_resting_camera_and_the_systems_clock(renderer: CpuRenderer) -> None:
    import time

    tree = LiveTree()
    set_pose(tree, matrices(rest, np.zeros(1))[0])
    async with moving(renderer, tree, noise=False) as service, served(service) as client:
        before = time.time_ns()
        lines = await read(client, 60)
        stamps = timestamps(lines)
        assert before < stamps[0] < stamps[-1] < time.time_ns()
        assert set(np.diff(stamps).tolist()) == {5_000_000}
        for line in lines:
            assert line["linear_acceleration"] == pytest.approx({"x": 0.0, "y": -GRAVITY, "z": 0.0}, abs=1e-6)
        assert service.status()["imu_clients"] == 1
        await until(lambda: len(service.imu.hub) == 0)


async def test_nothing_runs_without_clients() -> None:
    tree = LiveTree()
    set_pose(tree, np.eye(4))
    stopped = asyncio.Event()

    class Log(PoseLog):
        def stop(self) -> None:
            super().stop()
            stopped.set()

    log = Log(tree, lambda _: np.eye(4))
    imu = Imu(StereoConfig(), log)
    running = asyncio.create_task(imu.run())
    set_pose(tree, np.eye(4))
    assert not log.take()
    with imu.hub.subscribe() as queue:
        assert await queue.get()
    await stopped.wait()
    set_pose(tree, np.eye(4))
    assert not log.take()
    running.cancel()


async def test_a_moving_node_is_felt(renderer: CpuRenderer) -> None:
    tree = LiveTree()
    set_pose(tree, np.eye(4))
    async with moving(renderer, tree, noise=False) as service, served(service) as client:
        turning = True

        async def turn() -> None:
            loop = asyncio.get_running_loop()
            while turning:
                angle = loop.time()
                pose = np.eye(4)
                pose[:2, :2] = ((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle)))
                set_pose(tree, pose)
                await asyncio.sleep(0.02)

        task = asyncio.create_task(turn())
        rates = [line["angular_velocity"]["z"] for line in await read(client, 300)]
        turning = False
        await task
    assert np.median(rates) == pytest.approx(1.0, abs=0.1)


async def sets_and_samples(camera: Camera, client: httpx.AsyncClient) -> tuple[list[int], list[Any]]:
    """Return the timestamps of 40 image sets and the samples made meanwhile; the IMU is connected first."""
    async with client.stream("GET", "/stereo/imu") as response:
        await until(lambda: len(camera.service.imu.hub) == 1)
        sets = await camera.take(40, left_enabled=True)
        stamps = [image_set.timestamp.sec * 10**9 + image_set.timestamp.nsec for image_set in sets]
        lines = []
        async for line in response.aiter_lines():
            lines.append(json.loads(line))
            if timestamps(lines[-1:])[0] >= stamps[-1] - 400_000_000:
                break
    await until(lambda: len(camera.service.imu.hub) == 0)
    return stamps, lines


async def test_simulated_time_is_that_of_the_images_and_repeats(start: Start) -> None:
    runs = []
    for _ in range(2):
        camera = await start(rate="max", simulated_clock=True)
        async with served(camera.service) as client:
            runs.append(await sets_and_samples(camera, client))
    (stamps, lines), other = runs
    assert (stamps[0], stamps[1]) == (1_000_000_000, 1_040_000_000)
    assert (stamps, lines) == other
    assert timestamps(lines) == list(range(1_240_000_000, timestamps(lines)[-1] + 1, 5_000_000))
    assert stamps[-1] > timestamps(lines)[-1]
    force = np.array([[line["linear_acceleration"][axis] for axis in "xyz"] for line in lines])
    assert np.linalg.norm(force.mean(axis=0)) == pytest.approx(GRAVITY, abs=0.15)
    assert np.std(force, axis=0).max() > 0.01, "noise is on"


async def test_two_pipelines(start: Start) -> None:
    first = await start(rate="max", simulated_clock=True)
    second = await start(rate="max", simulated_clock=True, noise=False)
    async with served(first.service, second.service) as client, AsyncExitStack() as stack:
        task = asyncio.create_task(read(client, 20, "/stereo/imu?pipeline=1"))
        await until(lambda: len(second.service.imu.hub) == 1)
        assert len(first.service.imu.hub) == 0
        streaming = second.stream(left_enabled=True)
        stack.callback(streaming.cancel)
        while not task.done():
            await streaming.read()
        norms = [np.linalg.norm(list(line["linear_acceleration"].values())) for line in await task]
        np.testing.assert_allclose(norms, GRAVITY, atol=1e-6)
        response = await client.get("/stereo/imu?pipeline=2")
        assert (response.status_code, response.json()["message"]) == (404, "there is no pipeline 2")


async def test_the_websocket_sends_the_same_lines(renderer: CpuRenderer) -> None:
    tree = LiveTree()
    set_pose(tree, matrices(rest, np.zeros(1))[0])
    async with moving(renderer, tree, max_clients=1) as service, served(service) as client:
        address = str(client.base_url).replace("http", "ws").rstrip("/") + "/stereo/imu/ws"
        async with websocket(address) as socket:
            await socket.send("clients may send what they like")
            lines = [json.loads(line) for line in str(await socket.recv()).splitlines()]
            assert set(lines[0]) == {"timestamp", "linear_acceleration", "angular_velocity"}
            await refused(address, 1013, "1 IMU streams are open already")
            assert (await client.get("/stereo/imu")).status_code == 503
        await until(lambda: len(service.imu.hub) == 0)
        await refused(address + "?pipeline=7", 1008, "there is no pipeline 7")
        await refused(address + "?pipeline=x", 1008, "pipeline='x' is not a number")
        with pytest.raises(InvalidStatus, match="403"):
            async with websocket(address, origin=Origin("http://elsewhere.example")):
                pass


async def refused(address: str, code: int, reason: str) -> None:
    async with websocket(address) as socket:
        with pytest.raises(ConnectionClosed) as closed:
            await socket.recv()
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == code
    assert closed.value.rcvd.reason.startswith(reason)


async def test_streams_end_at_shutdown(renderer: CpuRenderer) -> None:
    tree = LiveTree()
    set_pose(tree, np.eye(4))
    async with AsyncExitStack() as stack:
        camera = AsyncExitStack()
        service = await camera.enter_async_context(moving(renderer, tree))
        client = await stack.enter_async_context(served(service))
        address = str(client.base_url).replace("http", "ws").rstrip("/") + "/stereo/imu/ws"
        response = await stack.enter_async_context(client.stream("GET", "/stereo/imu"))
        socket = await stack.enter_async_context(websocket(address))
        await socket.recv()
        await camera.aclose()
        assert [line async for line in response.aiter_lines()], "it ends, and not with an error"
        async for _ in socket:
            pass
        assert (socket.close_code, socket.close_reason) == (1001, "the stereo camera is shutting down")
        assert (await client.get("/stereo/imu")).status_code == 503


async def test_head_and_recorded_pairs(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    camera = await start()
    async with served(camera.service) as client:
        pairs: Callable[..., Any] = PairImaging.__new__
        monkeypatch.setattr(type(camera.service), "imaging", pairs(PairImaging))
        response = await client.get("/stereo/imu")
        assert (response.status_code, response.json()["message"]) == (404, "recorded pairs have no IMU")
