"""``GET /scene/motion.glb``."""

from __future__ import annotations

import httpx2
import pytest
from fastapi import FastAPI

from gateway.adapters.sceneapi.motion import motion_router
from gateway.files.gltf import AnimationTime, read_gltf
from gateway.scene.tree.live import LiveTree
from tests.adapters.viewer.test_recording import moving_scene


def client(max_bytes: int = 1 << 20) -> httpx2.AsyncClient:
    app = FastAPI()
    app.include_router(motion_router(LiveTree(), moving_scene(9), max_bytes))
    return httpx2.AsyncClient(transport=httpx2.ASGITransport(app), base_url="http://scene")


async def test_the_last_seconds() -> None:
    async with client() as http:
        response = await http.get("/scene/motion.glb?rate=1&seconds=3")
    assert response.status_code == 200
    assert response.headers["content-type"] == "model/gltf-binary"
    for seconds, x in ((0.0, 5.0), (2.5, 7.5), (3.0, 8.0)):
        scene = read_gltf(response.content, animation=AnimationTime("motion", seconds))
        [path] = [path for path, _ in scene.root.walk() if path and path[-1] == "box"]
        matrix = scene.root.world_matrix(path)
        assert matrix is not None
        assert matrix[0, 3] == pytest.approx(x)


async def test_what_is_refused() -> None:
    async with client() as http:
        for query in ("seconds=-1", "rate=0", "rate=241", "seconds=inf"):
            assert (await http.get(f"/scene/motion.glb?{query}")).status_code == 422, query
    async with client(max_bytes=1000) as http:
        response = await http.get("/scene/motion.glb")
    assert response.status_code == 413
    assert "1000 bytes" in response.text
