"""An application with the scene's routes only, and a renderer that records its calls."""

from collections.abc import AsyncIterator
from dataclasses import dataclass

import httpx2
import numpy as np
import pytest
from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError

from gateway.adapters.sceneapi.config import SceneApiConfig
from gateway.adapters.sceneapi.routes import router
from gateway.adapters.sceneapi.service import SceneApi
from gateway.runtime.http.error_handlers import invalid_parameters
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.live_scene import LiveScene
from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from renderers.camera import Camera
from renderers.drawlist import LABEL_NONE, DrawList, Material
from renderers.interface import Frame, Look, Output
from renderers.stereo.depth.matching import in_turn
from scenegate.messages.geometry import Box, Sphere
from tests.adapters.render.conftest import WatchedRenderer

SPOT = (20, 30)
"""Row and column."""


@dataclass
class RecordingRenderer(WatchedRenderer):
    """All pixels show the first instance, 2 m away, except the top left one, which is background."""

    spot: tuple[int, int, int] | None = None
    """Colour of the pixel ``SPOT``, which shows the first instance."""

    parallel = staticmethod(in_turn)

    def render(self, scene: DrawList, camera: Camera, outputs: Output, look: Look = Look()) -> Frame:
        frame = super().render(scene, camera, outputs, look)
        if frame.color is not None and self.spot is not None:
            frame.color[SPOT] = self.spot
        if Output.INSTANCE in outputs:
            frame.instance = np.full((camera.height, camera.width), -1, np.int32)
            frame.instance[SPOT] = 0
        if frame.depth is not None:
            frame.depth[0, 0] = np.inf
        if frame.label is not None:
            frame.label[0, 0] = LABEL_NONE
        return frame


@dataclass
class World:
    tree: LiveTree
    renderer: RecordingRenderer
    workers: WorkerPool
    service: SceneApi
    client: httpx2.AsyncClient


def client_of(service: SceneApi) -> httpx2.AsyncClient:
    app = FastAPI(exception_handlers={RequestValidationError: invalid_parameters})
    app.include_router(router(service))
    return httpx2.AsyncClient(transport=httpx2.ASGITransport(app=app), base_url="http://test")


@pytest.fixture
async def world() -> AsyncIterator[World]:
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_parts(("robot", "base"), (Part(Box((2, 2, 1)), Material(), kind="box"),))
        edit.set_parts(("robot", "head"), (Part(Sphere(0.5), Material()),))
        edit.set_matrix(("robot", "head"), tf.translation(0, 0, 2))
        edit.set_pose(("frame",), (1, 2, 3, 1, 0, 0, 0))
    renderer, workers = RecordingRenderer(), WorkerPool(2, max_waiting=1)
    config = SceneApiConfig(width=320, height=240, max_pixels=100_000, max_side=1000)
    service = SceneApi(LiveScene(tree), renderer, workers, config)
    async with client_of(service) as client:
        yield World(tree, renderer, workers, service, client)
    await workers.close(5.0)
