"""An application with the render endpoint only, and a renderer that tests can watch, hold and break."""

import json
import os
import threading
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import cv2
import httpx2
import numpy as np
import pytest
from fastapi import FastAPI
from numpy.typing import NDArray

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.pipeline import Backdrop
from gateway.adapters.render.routes import render_router
from gateway.adapters.render.service import RenderService
from gateway.runtime.logs.metrics_registry import Metrics
from gateway.runtime.logs.render_record import RenderRecord
from gateway.runtime.workers.worker_pool import WorkerPool
from renderers.camera import Camera
from renderers.drawlist import LABEL_NONE, DrawList
from renderers.interface import Frame, Look, Output, Renderer
from renderers.raster import CpuRenderer
from tests.support.forms import gltf
from tests.support.waiting import SECONDS


@dataclass
class WatchedRenderer:
    """Paints everything with the first instance's label and colour, 2 m away; notes what it was asked for."""

    calls: list[tuple[DrawList, Camera, Output, Look]] = field(default_factory=list)
    error: Exception | None = None
    started: threading.Event = field(default_factory=threading.Event)
    go_on: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.go_on.set()

    def render(self, scene: DrawList, camera: Camera, outputs: Output, look: Look = Look()) -> Frame:
        self.calls.append((scene, camera, outputs, look))
        self.started.set()
        assert self.go_on.wait(SECONDS)
        if self.error is not None:
            raise self.error
        size = (camera.height, camera.width)
        frame = Frame()
        if Output.COLOR in outputs:
            frame.color = np.full((*size, 3), look.background, np.uint8)
        if Output.DEPTH in outputs:
            frame.depth = np.full(size, 2.0 if scene.instances else np.inf, np.float32)
        if Output.LABEL in outputs:
            frame.label = np.full(size, scene.instances[0].label if scene.instances else LABEL_NONE, np.uint32)
        return frame


@dataclass
class Running:
    client: httpx2.AsyncClient
    service: RenderService
    workers: WorkerPool
    metrics: Metrics
    app: FastAPI

    @property
    def records(self) -> list[RenderRecord]:
        return list(self.service.recent)

    @property
    def arriving(self) -> int:
        """Number of requests that have a place in the queue before their body is complete."""
        arriving: int = self.service.status()["arriving"]
        return arriving

    def outcomes(self) -> Counter[str]:
        samples = [sample for metric in self.metrics.renders.collect() for sample in metric.samples]
        counts: Counter[str] = Counter()
        for sample in samples:
            counts[sample.labels["outcome"]] += int(sample.value)
        return counts

    async def post(self, body: bytes, content_type: str) -> httpx2.Response:
        return await self.client.post("/render", content=body, headers={"Content-Type": content_type})


SCENE = json.dumps(gltf()).encode()


def decoded(response: httpx2.Response) -> NDArray[np.generic]:
    """The picture of an answer, channels as RGB."""
    image: Any = cv2.imdecode(np.frombuffer(response.content, np.uint8), cv2.IMREAD_UNCHANGED)
    return image[..., ::-1] if image.ndim == 3 else image


def assert_refused(response: httpx2.Response, status: int, *words: str) -> None:
    """The answer is one of plain text that has all the words."""
    assert response.status_code == status
    assert response.headers["content-type"] == "text/plain; charset=utf-8"
    assert 0 < len(response.content) < 8192
    assert int(response.headers["content-length"]) == len(response.content)
    text = response.content.decode()
    assert all(word in text for word in words), text


Start = Callable[..., AbstractAsyncContextManager[Running]]


@asynccontextmanager
async def running(
    renderer: Renderer,
    config: RenderConfig | None = None,
    *,
    threads: int = 2,
    max_waiting: int = 16,
    max_waiting_bytes: int = 1 << 30,
    backdrop: Backdrop | None = None,
    seconds: float | None = None,
) -> AsyncIterator[Running]:
    workers = WorkerPool(threads, max_waiting, max_waiting_bytes, seconds=seconds, limit_name="--render-seconds")
    metrics = Metrics()
    service = RenderService(renderer, workers, config, backdrop=backdrop, metrics=metrics)
    app = FastAPI()
    app.include_router(render_router(service))
    transport = httpx2.ASGITransport(app=app)
    async with httpx2.AsyncClient(transport=transport, base_url="http://test") as client:
        try:
            yield Running(client, service, workers, metrics, app)
        finally:
            assert await workers.close(SECONDS)


@pytest.fixture
def start() -> Start:
    """``async with start(renderer, config, …) as server:``."""
    return running


@pytest.fixture(scope="module")
def renderer() -> Iterator[CpuRenderer]:
    renderer = CpuRenderer(os.cpu_count() or 1)
    yield renderer
    renderer.close()


@pytest.fixture
def watched() -> WatchedRenderer:
    return WatchedRenderer()
