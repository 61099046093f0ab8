"""Fixtures: a running stereo camera with a small scene, and a client."""

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Any

import grpc
import httpx2 as httpx
import numpy as np
import pytest
import structlog
from fastapi import APIRouter, FastAPI
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import StreamSettings, read_settings
from gateway.adapters.stereo.imaging.recorded_pairs import RecordedPairs
from gateway.adapters.stereo.imaging.scene_view import SceneSource, SceneState
from gateway.adapters.stereo.routes.fault_routes import fault_router
from gateway.adapters.stereo.routes.node_routes import node_router
from gateway.adapters.stereo.routes.system_routes import system_router
from gateway.adapters.stereo.routes.truth_routes import truth_router
from gateway.adapters.stereo.service import StereoService
from gateway.runtime.kernels.parts import PARTS
from gateway.runtime.logs import log_setup
from gateway.runtime.workers.worker_pool import WorkerPool
from renderers.drawlist import DrawList
from renderers.interface import Renderer
from renderers.raster import CpuRenderer
from renderers.raster.warmup import warmup
from renderers.stereo.model import StereoModel
from scenegate.camera import image_interface_pb2 as pb
from tests.adapters.stereo.scenes import pose, table
from tests.support.waiting import SECONDS, until

SMALL = StereoModel("small", 320, 240, 0.8449, 0.160)
"""The device's geometry at a quarter of its resolution."""

EVERYTHING: dict[str, bool] = {
    "left_enabled": True,
    "right_enabled": True,
    "disparity_enabled": True,
    "disparity_error_enabled": True,
    "confidence_enabled": True,
    "mesh_enabled": True,
}
"""Request for everything that the camera has."""

Start = Callable[..., Awaitable["Camera"]]


@dataclass(frozen=True, slots=True)
class Camera:
    """A running service and a gRPC channel to it."""

    service: StereoService
    channel: grpc.aio.Channel
    task: asyncio.Task[None]

    def stream(
        self, timeout: float = SECONDS, **request: Any
    ) -> grpc.aio.UnaryStreamCall[pb.ImageSetRequest, pb.ImageSet]:
        call = self.channel.unary_stream(
            "/ImageInterface/StreamImageSets",
            request_serializer=pb.ImageSetRequest.SerializeToString,
            response_deserializer=pb.ImageSet.FromString,
        )
        return call(pb.ImageSetRequest(**request), timeout=timeout)

    async def take(self, count: int = 1, **request: Any) -> list[pb.ImageSet]:
        call = self.stream(**request)
        sets = [await call.read() for _ in range(count)]
        call.cancel()
        return sets


@pytest.fixture(scope="session")
def renderer() -> CpuRenderer:
    PARTS["stereo"].compile_or_load()
    warmup()
    return CpuRenderer(2)


def seen(scene: Callable[[], tuple[DrawList, int]]) -> SceneSource:
    """Return a source of a scene and its revision, seen from ``pose``."""

    def state(timestamp: int | None) -> SceneState:
        draw_list, revision = scene()
        return SceneState(timestamp or 0, draw_list, pose(), revision, timestamp or 0)

    return state


@asynccontextmanager
async def running(
    renderer: Renderer,
    config: StereoConfig,
    state: SceneSource,
    seconds: float | None = None,
    pairs: RecordedPairs | None = None,
) -> AsyncIterator[Camera]:
    workers = WorkerPool(2, seconds=seconds, limit_name="--render-seconds")

    service = StereoService(config, state, renderer, workers, pairs=pairs)
    task = asyncio.create_task(service.run())
    await until(lambda: service.ready or task.done())
    if task.done():
        task.result()
    options = [("grpc.max_receive_message_length", -1), ("grpc.use_local_subchannel_pool", 1)]
    async with grpc.aio.insecure_channel(f"127.0.0.1:{service.port}", options=options) as channel:
        yield Camera(service, channel, task)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert await workers.close(10.0), "a worker thread was left behind"


@pytest.fixture
async def start(renderer: CpuRenderer) -> AsyncIterator[Start]:
    """Return a function that starts a camera; arguments are ``scene`` or ``state``, ``pairs``, and fields of config."""
    async with AsyncExitStack() as stack:

        async def begin(
            scene: Callable[[], tuple[DrawList, int]] | None = None,
            state: SceneSource | None = None,
            pairs: RecordedPairs | None = None,
            **fields: Any,
        ) -> Camera:
            drawn = table()
            config = StereoConfig(**{"port": 0, "model": SMALL, "look": "phong", **fields})
            return await stack.enter_async_context(
                running(renderer, config, state or seen(scene or (lambda: (drawn, 1))), pairs=pairs)
            )

        yield begin


@pytest.fixture
async def camera(start: Start) -> Camera:
    return await start()


def http_client(*routers: APIRouter) -> httpx.AsyncClient:
    app = FastAPI()
    for router in routers:
        app.include_router(router)
    return httpx.AsyncClient(transport=httpx.ASGITransport(app=app), base_url="http://device")


@pytest.fixture
async def rest_client(camera: Camera) -> AsyncIterator[httpx.AsyncClient]:
    routers = (node_router, system_router, truth_router, fault_router)
    async with http_client(*(router(camera.service) for router in routers)) as client:
        yield client


@pytest.fixture
def logs() -> Iterator[None]:
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    log_setup.configure("json", "info")
    yield
    root.handlers[:], root.level = handlers, level
    structlog.reset_defaults()


def settings(node: str = "rc_camera", **values: object) -> StreamSettings:
    """Return the settings of a stream with some parameters of a node."""
    parameters = Parameters()
    parameters.set(node, values.items())
    return read_settings(parameters)


def nanoseconds(time: pb.Time) -> int:
    return time.sec * 10**9 + time.nsec


def pixels(image: pb.Image) -> NDArray[Any]:
    dtype, channels = {"mono8": ("u1", 1), "rgb8": ("u1", 3), "mono16": ("<u2", 1)}[image.encoding]
    assert not image.is_bigendian
    assert image.step == image.width * channels * np.dtype(dtype).itemsize
    assert len(image.data) == image.step * image.height
    array: NDArray[Any] = np.frombuffer(image.data, dtype)
    return array.reshape((image.height, image.width, 3) if channels == 3 else (image.height, image.width))
