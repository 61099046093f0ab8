"""Limits of the render endpoint: bodies, queue, deadlines, disconnected clients."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import httpx2

from gateway.adapters.render.config import RenderConfig
from tests.adapters.render.conftest import SCENE, Start, WatchedRenderer, assert_refused
from tests.support.endless import EndlessRenderer
from tests.support.forms import CONTENT_TYPE, body, part
from tests.support.waiting import SECONDS, until


async def test_body_limit_by_length_or_by_received_bytes(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched, RenderConfig(max_body_bytes=10_000)) as server:
        sent = 0

        async def chunks() -> AsyncIterator[bytes]:
            nonlocal sent
            for _ in range(1000):
                sent += 1000
                yield b"x" * 1000 if sent > 1000 else part("scene", b"x" * 900)[:1000]

        headers = {"Content-Type": CONTENT_TYPE}
        announced = await server.client.post(
            "/render", content=chunks(), headers={**headers, "Content-Length": "1000000"}
        )
        assert_refused(announced, 413, "1000000 bytes", "10000", "max_body_bytes")
        assert sent == 0
        counted = await server.client.post("/render", content=chunks(), headers=headers)
        assert_refused(counted, 413, "10000", "max_body_bytes")
        assert 10_000 < sent <= 12_000
        assert server.service.status()["inflight_bytes"] == 0


async def test_full_queue_is_503_with_retry_after(start: Start, watched: WatchedRenderer) -> None:
    watched.go_on.clear()
    async with start(watched, threads=1, max_waiting=3) as server:
        posts = [asyncio.create_task(server.post(body(SCENE), CONTENT_TYPE)) for _ in range(4)]
        assert await asyncio.to_thread(watched.started.wait, SECONDS)
        await until(lambda: server.workers.stats.waiting == 3)
        refused = await server.post(body(SCENE), CONTENT_TYPE)
        assert_refused(refused, 503, "busy", "3 requests are waiting")
        assert int(refused.headers["retry-after"]) >= 1
        watched.go_on.set()
        assert [response.status_code for response in await asyncio.gather(*posts)] == [200] * 4
        assert server.service.status()["inflight_bytes"] == 0


async def test_arriving_bodies_reserve_places_and_a_full_queue_rejects_before_the_body(
    start: Start, watched: WatchedRenderer
) -> None:
    watched.go_on.clear()
    read, come = 0, asyncio.Event()

    async def late() -> AsyncIterator[bytes]:
        nonlocal read
        read += 1
        await come.wait()
        yield body(SCENE)

    async def post() -> httpx2.Response:
        return await server.client.post("/render", content=late(), headers={"Content-Type": CONTENT_TYPE})

    async with start(watched, threads=1, max_waiting=2) as server:
        posts = [asyncio.create_task(post()) for _ in range(3)]
        await until(lambda: server.arriving == 3)
        assert_refused(await post(), 503, "2 requests are waiting already (3 of them still arriving)")
        assert read == 3
        come.set()
        watched.go_on.set()
        assert [response.status_code for response in await asyncio.gather(*posts)] == [200] * 3
        assert server.arriving == 0


async def test_slow_upload_loses_its_place(start: Start, watched: WatchedRenderer) -> None:
    come = asyncio.Event()

    async def trickling() -> AsyncIterator[bytes]:
        yield body(SCENE)[:100]
        await come.wait()
        yield body(SCENE)[100:]

    async with start(watched, RenderConfig(arrival_seconds=0.01), threads=1, max_waiting=0) as server:
        headers = {"Content-Type": CONTENT_TYPE}
        slow = asyncio.create_task(server.client.post("/render", content=trickling(), headers=headers))
        await until(lambda: server.arriving == 1)
        await until(lambda: server.arriving == 0)
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
        come.set()
        assert (await slow).status_code == 200


async def test_bytes_of_all_bodies_are_limited(start: Start, watched: WatchedRenderer) -> None:
    watched.go_on.clear()
    size = len(body(SCENE))
    async with start(watched, RenderConfig(max_inflight_bytes=size + 10), threads=2) as server:
        first = asyncio.create_task(server.post(body(SCENE), CONTENT_TYPE))
        assert await asyncio.to_thread(watched.started.wait, SECONDS)
        assert server.service.status()["inflight_bytes"] == size
        refused = await server.post(body(SCENE), CONTENT_TYPE)
        assert_refused(refused, 503, "max_inflight_bytes")
        assert int(refused.headers["retry-after"]) >= 1
        watched.go_on.set()
        assert (await first).status_code == 200
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200


async def test_render_deadline_is_503_and_the_request_is_stored(start: Start, tmp_path: Path) -> None:
    renderer = EndlessRenderer()
    async with start(renderer, RenderConfig(keep_failures=tmp_path), threads=1, seconds=0.05) as server:
        for _ in range(2):
            response = await server.post(body(SCENE), CONTENT_TYPE)
            assert_refused(response, 503, "--render-seconds = 0.05 s")
            assert "retry-after" not in response.headers  # the same request would take as long
        assert renderer.begun == renderer.ended  # the time of the first may be over before it is read
        assert server.outcomes() == {"slow": 2}
    assert len(await asyncio.to_thread(lambda: [*tmp_path.iterdir()])) == 4  # the bodies, and what is said of each


async def test_render_stops_when_the_client_disconnects(start: Start) -> None:
    renderer = EndlessRenderer()
    async with start(renderer, threads=1) as server:
        leaver = asyncio.create_task(server.post(body(SCENE), CONTENT_TYPE))
        await until(lambda: renderer.begun == 1)
        leaver.cancel()
        await asyncio.gather(leaver, return_exceptions=True)
        await until(lambda: renderer.ended == 1)
