"""The application: start, failing rooms, offline docs. Rooms and kernels are stand-ins; tests/e2e has real ones."""

from __future__ import annotations

import asyncio
import re
import threading
from collections.abc import AsyncIterator, Callable, Collection, Mapping
from contextlib import asynccontextmanager
from typing import Any

import httpx2
import pytest
import structlog
from fastapi import FastAPI

import gateway.app
from gateway.runtime import kernel_cache
from gateway.runtime.kernel_progress import Progress
from gateway.settings import Settings
from gateway.wiring import warmup
from gateway.wiring.context import House
from gateway.wiring.interfaces import join_render, join_stereo
from tests.support.waiting import SECONDS, until


class FakeService:
    """Runs until cancelled, or fails when told to."""

    def __init__(self, error: Exception | None = None) -> None:
        self.error = error
        self.ready = True
        self.ended = asyncio.Event()

    async def run(self) -> None:
        if self.error is not None:
            raise self.error
        try:
            await asyncio.Event().wait()
        finally:
            self.ended.set()

    def status(self) -> Mapping[str, Any]:
        return {}


@pytest.fixture(autouse=True)
def _warm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "are_cached", lambda: True)
    monkeypatch.setattr(warmup, "run", lambda: None)


def rooms(monkeypatch: pytest.MonkeyPatch, **joins: Callable[[House], None]) -> None:
    monkeypatch.setattr(gateway.app, "JOINS", joins)


@asynccontextmanager
async def running(**settings: Any) -> AsyncIterator[httpx2.AsyncClient]:
    app = gateway.app.create_app(Settings(**settings))
    async with app.router.lifespan_context(app):
        transport = httpx2.ASGITransport(app=app)
        async with httpx2.AsyncClient(transport=transport, base_url="http://test") as client:
            yield client


def add_route(house: House) -> None:
    @house.app.get("/room")
    async def room() -> str:
        return "here"


async def test_a_request_that_comes_during_the_start_is_answered_by_the_room(monkeypatch: pytest.MonkeyPatch) -> None:
    rooms(monkeypatch, render=add_route)
    async with running() as client:
        assert (await client.get("/room")).json() == "here"
        assert (await client.get("/readyz")).json() == {
            "status": "ready",
            "interfaces": {"kernels": {"state": "ready"}, "render": {"state": "ready"}},
        }
        assert "/room" in (await client.get("/openapi.json")).json()["paths"]


async def test_a_room_that_cannot_be_joined_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(house: House) -> None:
        raise OSError("no multicast route")

    rooms(monkeypatch, treeviewer=broken, render=add_route)
    async with running() as client:
        assert (await client.get("/room")).status_code == 200
        ready = await client.get("/readyz")
        assert ready.status_code == 200
        assert ready.json()["status"] == "degraded"
        assert ready.json()["interfaces"]["treeviewer"] == {"state": "failed", "problem": "no multicast route"}


async def test_a_service_that_fails_leaves_the_others_and_all_end_with_the_lifespan(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    good, bad = FakeService(), FakeService(OSError("port taken"))
    rooms(
        monkeypatch,
        stereo=lambda house: house.serve("stereo", bad),
        treeviewer=lambda house: house.serve("treeviewer", good, where="udpm://"),
    )
    async with running() as client:
        assert (await client.get("/openapi.json")).status_code == 200
        states = (await client.get("/healthz")).json()["interfaces"]
        assert states["stereo"] == {"state": "failed", "problem": "port taken"}
        assert states["treeviewer"] == {"state": "ready", "where": "udpm://"}
        assert not good.ended.is_set()
    assert good.ended.is_set()


async def test_render_route_has_its_own_body_limit_and_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    rooms(monkeypatch, render=join_render)
    async with running(only=("render",), max_body_mb=1) as client:
        answer = await client.post("/render", content=b"x", headers={"Content-Type": "text/plain"})
        assert (answer.status_code, "multipart/form-data" in answer.text) == (400, True)
        answer = await client.post("/render", content=bytes(2 << 20))
        assert (answer.status_code, "max_body_bytes" in answer.text) == (413, True)  # not Starlette's own text
        assert (await client.get("/render")).status_code == 405
        metrics = (await client.get("/metrics")).text
        assert 'scenegate_http_requests_total{method="POST",route="/render",status="400"} 1.0' in metrics
        described = (await client.get("/openapi.json")).json()["paths"]["/render"]
        assert list(described) == ["post"]


async def test_only_starts_what_was_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    rooms(monkeypatch, render=add_route, stereo=lambda house: house.serve("stereo", FakeService()))
    async with running(only=("render",)) as client:
        assert (await client.get("/room")).status_code == 200
        assert "stereo" not in (await client.get("/healthz")).json()["interfaces"]


async def test_a_camera_at_a_missing_node_warns_before_anybody_streams(monkeypatch: pytest.MonkeyPatch) -> None:
    houses: list[House] = []

    def join(house: House) -> None:
        houses.append(house)
        join_stereo(house)

    rooms(monkeypatch, stereo=join)
    async with running(grpc_port=0, stereo_path='["hand"]') as client:
        assert (await client.get("/openapi.json")).status_code == 200
        states = (await client.get("/healthz")).json()["interfaces"]
        assert "there is no such node" in states["stereo"]["warning"]
        with houses[0].tree.edit() as edit:
            edit.set_pose(("hand",), (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0))
        states = (await client.get("/healthz")).json()["interfaces"]
        assert "warning" not in states["stereo"]


async def test_without_kernels_nothing_is_drawn_and_everybody_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise RuntimeError("no compiler backend")

    monkeypatch.setattr(warmup, "run", broken)
    rooms(monkeypatch, render=add_route)
    async with running() as client:
        answer = await client.get("/room")
        assert (answer.status_code, answer.text) == (503, "The gateway did not start: no compiler backend\n")
        assert (await client.get("/readyz")).status_code == 503
        assert (await client.get("/healthz")).status_code == 200


async def test_cold_kernels_are_compiled_by_a_child_before_they_are_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []

    async def compile_missing(parts: Collection[str], progress: Progress) -> None:
        order.append("compiled")

    monkeypatch.setattr(kernel_cache, "are_cached", lambda: False)
    monkeypatch.setattr(kernel_cache, "compile_missing", compile_missing)
    monkeypatch.setattr(warmup, "run", lambda: order.append("loaded"))
    rooms(monkeypatch, render=add_route)
    async with running() as client:
        await client.get("/room")
    assert order == ["compiled", "loaded"]


async def test_while_it_compiles_log_and_health_say_which_part(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, go_on = asyncio.Event(), asyncio.Event()

    async def compile_missing(parts: Collection[str], progress: Progress) -> None:
        assert progress.parts == len(parts) == len(warmup.PARTS)
        progress.begin("shading")
        progress.begin("setup")
        progress.end("shading")
        begun.set()
        await go_on.wait()

    monkeypatch.setattr(kernel_cache, "are_cached", lambda: False)
    monkeypatch.setattr(kernel_cache, "compile_missing", compile_missing)
    rooms(monkeypatch, render=add_route)
    with structlog.testing.capture_logs() as lines:
        async with running() as client:
            await begun.wait()
            for path in ("/readyz", "/healthz"):
                answer = await client.get(path)
                described = answer.json()["interfaces"]["kernels"]
                assert answer.status_code == (503 if path == "/readyz" else 200)
                assert described["state"] == "starting"
                compiling = described["compiling"]
                assert compiling.pop("seconds") >= 0.0
                assert compiling == {"part": 2, "of": len(warmup.PARTS), "done": 1, "now": ["setup"]}
            go_on.set()
            await client.get("/room")
            assert (await client.get("/readyz")).json()["interfaces"]["kernels"] == {"state": "ready"}
    said = [line for line in lines if "ompil" in line["event"]]
    assert [line["event"] for line in said] == [
        "Compiling the rendering kernels into the cache, once ...",
        "Compiling the rendering kernels",
        "Compiling the rendering kernels",
        "The rendering kernels are compiled",
    ]
    assert (said[2]["part"], said[2]["of"], said[2]["name"]) == (2, len(warmup.PARTS), "setup")
    assert all(line["seconds"] >= 0.0 for line in said[1:])


async def test_a_kernel_compiled_while_serving_is_an_error_in_the_log(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba import njit

    rooms(monkeypatch, render=add_route)
    with structlog.testing.capture_logs() as lines:
        async with running() as client:
            await client.get("/room")
            njit(lambda x: x + 1)(1)
        njit(lambda x: x + 2)(1)  # nobody serves any more
    (line,) = [line for line in lines if "compiled in the serving process" in line["event"]]
    assert line["log_level"] == "error"
    assert line["kernel"].startswith("tests.test_app.")


async def test_docs_and_landing_page_need_no_other_host(monkeypatch: pytest.MonkeyPatch) -> None:
    rooms(monkeypatch)
    async with running() as client:
        for path in ("/docs", "/"):
            page = await client.get(path)
            assert page.status_code == 200
            assert not re.search(r"(?:src|href)=[\"'](?:https?:)?//", page.text)
            for link in re.findall(r"(?:src|href)=[\"'](/[^\"']+)", page.text):
                assert (await client.get(link)).status_code == 200
        assert "validatorUrl" in (await client.get("/docs")).text


async def test_metrics_show_the_queue(monkeypatch: pytest.MonkeyPatch) -> None:
    rooms(monkeypatch)
    async with running() as client:
        assert "scenegate_render_waiting 0.0" in (await client.get("/metrics")).text


@pytest.mark.parametrize(("only", "expected"), [(("render",), 503), (("render", "scene"), 200)])
async def test_who_only_renders_is_not_ready_while_its_queue_is_full(
    monkeypatch: pytest.MonkeyPatch, only: tuple[str, ...], expected: int
) -> None:
    houses: list[House] = []
    rooms(monkeypatch, render=houses.append)
    async with running(only=only, threads=1, queue=1) as client:
        await until(lambda: houses)
        release = threading.Event()
        calls = [asyncio.create_task(houses[0].workers.run(release.wait)) for _ in range(2)]
        await until(lambda: houses[0].workers.stats.waiting == 1 and houses[0].workers.stats.running == 1)
        full = await client.get("/readyz")
        assert full.status_code == expected
        assert full.json()["status"] == ("busy" if expected == 503 else "ready")
        release.set()
        await asyncio.gather(*calls)
        assert (await client.get("/readyz")).status_code == 200


def test_the_module_level_app_is_made_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gateway.app.logs, "configure", lambda *_, **__: None)
    assert gateway.app.app.title == "Scenegate"
    with pytest.raises(AttributeError):
        _ = gateway.app.nothing


async def test_the_end_in_the_middle_of_the_start_is_told_to_those_who_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, go_on = threading.Event(), threading.Event()

    def compiling() -> None:
        asked.set()
        go_on.wait()

    monkeypatch.setattr(warmup, "run", compiling)
    rooms(monkeypatch, render=add_route)
    app = gateway.app.create_app(Settings())
    try:
        async with app.router.lifespan_context(app):
            transport = httpx2.ASGITransport(app=app)
            async with httpx2.AsyncClient(transport=transport, base_url="http://test") as client:
                waiting = asyncio.create_task(client.get("/room"))
                await asyncio.to_thread(asked.wait)
                app.state.leave()
                answer = await waiting
        assert (answer.status_code, answer.text) == (503, "The gateway did not start: it was told to stop\n")
    finally:
        go_on.set()


async def test_a_service_that_starts_after_the_end_began_ends_too(monkeypatch: pytest.MonkeyPatch) -> None:
    service = FakeService()

    def late(house: House) -> None:
        house.leave()
        house.serve("render", service)

    rooms(monkeypatch, render=late)
    async with asyncio.timeout(SECONDS), running() as client:
        await client.get("/room")  # waits until the rooms are joined
    assert service.ended.is_set()


async def test_requests_are_let_in_as_soon_as_the_rooms_are_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever saw a ready process and posted then was told at SIGTERM that it did not start: the gate was still shut,
    for as long as it took to describe the interface."""
    describing, go_on = threading.Event(), threading.Event()

    def openapi(_: FastAPI) -> dict[str, Any]:
        describing.set()
        assert go_on.wait(SECONDS)
        return {}

    monkeypatch.setattr(FastAPI, "openapi", openapi)
    rooms(monkeypatch, render=add_route)
    try:
        async with running() as client:
            assert await asyncio.to_thread(describing.wait, SECONDS)
            assert (await client.get("/readyz")).status_code == 200
            assert (await client.get("/room")).json() == "here"
            go_on.set()
    finally:
        go_on.set()


async def test_nothing_is_ready_before_requests_are_let_in(monkeypatch: pytest.MonkeyPatch) -> None:
    joining, go_on = asyncio.Event(), asyncio.Event()

    async def restored(_: House) -> bool:
        joining.set()
        await go_on.wait()
        return True

    monkeypatch.setattr(gateway.app, "_restored", restored)
    rooms(monkeypatch)  # none, so that the registry waits for the kernels only, which are there
    async with running() as client:
        await joining.wait()
        assert (await client.get("/readyz")).json()["status"] == "starting"
        go_on.set()
        async with asyncio.timeout(SECONDS):
            while (await client.get("/readyz")).status_code != 200:  # noqa: ASYNC110 - readiness has no event
                await asyncio.sleep(0)  # the request alone never lets the start go on


@pytest.mark.parametrize(("only", "expected"), [(("render",), 503), (("render", "scene"), 200)])
async def test_who_only_renders_is_not_ready_while_every_thread_is_past_half_of_its_time(
    monkeypatch: pytest.MonkeyPatch, only: tuple[str, ...], expected: int
) -> None:
    houses: list[House] = []
    rooms(monkeypatch, render=houses.append)
    async with running(only=only, threads=1, render_seconds=0.02) as client:
        await until(lambda: houses)
        release = threading.Event()
        call = asyncio.create_task(houses[0].workers.run(release.wait))
        await until(lambda: houses[0].workers.stuck)
        assert (await client.get("/readyz")).status_code == expected
        assert "scenegate_render_slow 1.0" in (await client.get("/metrics")).text
        release.set()
        await call
        assert (await client.get("/readyz")).status_code == 200
