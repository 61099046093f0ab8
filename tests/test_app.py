"""Start and shutdown of the application, failing interfaces, offline docs. Interfaces and kernels are fakes."""

import asyncio
import json
import re
import threading
from collections.abc import AsyncIterator, Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import httpx2
import pytest
import structlog
from fastapi import FastAPI
from fastapi.routing import APIRoute

import gateway.app
import gateway.wiring.render
import gateway.wiring.stereo
from gateway.runtime.kernels import cache, loading, parts
from gateway.runtime.kernels.progress import KernelProgress
from gateway.runtime.logs import log_setup
from gateway.runtime.service_registry import ServiceRegistry
from gateway.runtime.settings import Settings
from gateway.wiring import startup
from gateway.wiring.context import Context, Provided
from renderers.compiler import pending
from tests.support.forms import CONTENT_TYPE, body, drake_fields, gltf
from tests.support.waiting import SECONDS, until


class FakeService:
    """Runs until cancelled, or raises ``error``."""

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
    monkeypatch.setattr(cache, "are_cached", lambda parts: True)
    monkeypatch.setattr(parts, "load_needed", lambda: None)
    monkeypatch.setattr(parts, "load_background", pending.finish)


def use_interfaces(monkeypatch: pytest.MonkeyPatch, **setups: Callable[[Context], None]) -> None:
    def awaited(setup: Callable[[Context], None]) -> startup.Setup:
        async def set_up(context: Context, provided: Provided) -> Provided:
            setup(context)
            return provided

        return set_up

    monkeypatch.setattr(startup, "INTERFACES", {name: awaited(setup) for name, setup in setups.items()})


@asynccontextmanager
async def running(**settings: Any) -> AsyncIterator[httpx2.AsyncClient]:
    app = gateway.app.create_app(Settings(**settings))
    async with app.router.lifespan_context(app):
        transport = httpx2.ASGITransport(app=app)
        async with httpx2.AsyncClient(transport=transport, base_url="http://test") as client:
            yield client


def add_route(context: Context) -> None:
    @context.app.get("/example")
    async def example() -> str:
        return "here"


async def test_a_request_during_the_start_waits_for_the_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    use_interfaces(monkeypatch, render=add_route)
    async with running() as client:
        assert (await client.get("/example")).json() == "here"
        assert (await client.get("/readyz")).json() == {
            "status": "ready",
            "interfaces": {"kernels": {"state": "ready"}, "render": {"state": "ready"}},
        }
        assert "/example" in (await client.get("/openapi.json")).json()["paths"]


def api_routes(routes: Iterable[Any]) -> Iterator[APIRoute]:
    """Yield the routes, those of routers that are included, too."""
    for route in routes:
        if isinstance(route, APIRoute):
            yield route
        elif (router := getattr(route, "original_router", None)) is not None:
            yield from api_routes(router.routes)


async def test_no_route_lets_fastapi_read_a_body_of_any_size() -> None:
    app = gateway.app.create_app(Settings(grpc_port=0, tcpq_port=0, lcm_url="off"))
    async with (
        app.router.lifespan_context(app),
        httpx2.AsyncClient(transport=httpx2.ASGITransport(app=app), base_url="http://test") as client,
    ):
        assert (await client.get("/openapi.json")).status_code == 200  # waits for all interfaces
        routes = list(api_routes(app.router.routes))
    assert {"/render", "/scene", "/stereo/faults", "/api/v2/nodes"} <= {route.path for route in routes}
    assert [route.path for route in routes if route.body_field is not None] == []


async def test_an_interface_that_fails_to_start_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(context: Context) -> None:
        raise OSError("no multicast route")

    use_interfaces(monkeypatch, treeviewer=broken, render=add_route)
    async with running() as client:
        assert (await client.get("/example")).status_code == 200
        ready = await client.get("/readyz")
        assert ready.status_code == 200
        assert ready.json()["status"] == "degraded"
        assert ready.json()["interfaces"]["treeviewer"] == {"state": "failed", "problem": "no multicast route"}


async def test_a_service_that_fails_leaves_the_others_and_all_end_with_the_lifespan(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    good, bad = FakeService(), FakeService(OSError("port taken"))
    use_interfaces(
        monkeypatch,
        stereo=lambda context: context.run_service("stereo", bad),
        treeviewer=lambda context: context.run_service("treeviewer", good, where="udpm://"),
    )
    async with running() as client:
        assert (await client.get("/openapi.json")).status_code == 200
        states: dict[str, Any] = {}
        async with asyncio.timeout(SECONDS):
            while states.get("stereo", {}).get("state") != "failed":
                await asyncio.sleep(0)
                states = (await client.get("/healthz")).json()["interfaces"]
        assert states["stereo"] == {"state": "failed", "problem": "port taken"}
        assert states["treeviewer"] == {"state": "ready", "where": "udpm://"}
        assert not good.ended.is_set()
    assert good.ended.is_set()


async def test_render_route_has_its_own_body_limit_and_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(startup, "INTERFACES", {"render": gateway.wiring.render.setup})
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


async def test_health_has_the_warnings_of_the_last_image(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(startup, "INTERFACES", {"render": gateway.wiring.render.setup})
    async with running(only=("render",)) as client:
        for fields, warnings in (({"tint": "red"}, ["the field 'tint' is unknown and ignored"]), ({}, None)):
            data = body(gltf(), drake_fields("depth", **fields))
            answer = await client.post("/render", content=data, headers={"Content-Type": CONTENT_TYPE})
            assert answer.status_code == 200
            states = (await client.get("/healthz")).json()["interfaces"]
            assert states["render"].get("warnings") == warnings


async def test_only_starts_the_named_interfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    use_interfaces(monkeypatch, render=add_route, stereo=lambda context: context.run_service("stereo", FakeService()))
    async with running(only=("render",)) as client:
        assert (await client.get("/example")).status_code == 200
        assert "stereo" not in (await client.get("/healthz")).json()["interfaces"]


async def test_a_camera_at_a_missing_node_warns_before_the_first_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    contexts: list[Context] = []

    async def set_up(context: Context, provided: Provided) -> Provided:
        contexts.append(context)
        return await gateway.wiring.stereo.setup(context, provided)

    monkeypatch.setattr(startup, "INTERFACES", {"stereo": set_up})
    async with running(grpc_port=0, stereo_path='["hand"]') as client:
        assert (await client.get("/openapi.json")).status_code == 200
        states = (await client.get("/healthz")).json()["interfaces"]
        assert "there is no such node" in states["stereo"]["warnings"][0]
        with contexts[0].tree.edit() as edit:
            edit.set_pose(("hand",), (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0))
        states = (await client.get("/healthz")).json()["interfaces"]
        assert "warnings" not in states["stereo"]


async def test_without_kernels_requests_get_503_and_the_process_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise cache.KernelError("no compiler in /home/robot")

    monkeypatch.setattr(parts, "load_needed", broken)
    use_interfaces(monkeypatch, render=add_route)
    ended = asyncio.Event()
    app = gateway.app.create_app(Settings(), on_fatal=ended.set)
    with structlog.testing.capture_logs() as lines:
        async with app.router.lifespan_context(app):
            async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app=app), base_url="http://test") as client:
                answer = await client.get("/example")
                assert (answer.status_code, "/home" in answer.text, "log" in answer.text) == (503, False, True)
                assert (await client.get("/readyz")).status_code == 503
                assert (await client.get("/healthz")).json()["status"] == "failed"
            await ended.wait()
    assert any("no compiler in /home/robot" in line["event"] for line in lines)
    assert not any("started" in line["event"] for line in lines)


async def test_kernels_are_loaded_again_after_an_error_that_may_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = [OSError(24, "Too many open files", "/home/robot/kernels"), MemoryError("no memory")]
    loaded: list[bool] = []

    def load() -> None:
        if errors:
            raise errors.pop()
        loaded.append(True)

    monkeypatch.setattr(loading, "START_RETRIES", (0.0,) * 4)
    monkeypatch.setattr(parts, "load_needed", load)
    use_interfaces(monkeypatch, render=add_route)
    async with running() as client:
        assert (await client.get("/example")).status_code == 200
        assert (await client.get("/readyz")).json()["interfaces"]["kernels"] == {"state": "ready"}
    assert loaded == [True]


async def test_further_kernels_are_loaded_again_after_any_error(monkeypatch: pytest.MonkeyPatch) -> None:
    error: list[Exception] = [OSError(24, "Too many open files", "/home/robot/kernels")]
    tried = asyncio.Event()
    go_on = asyncio.Event()

    def load(part: str) -> None:
        if error:
            raise error[0]
        pending.finish(part)

    async def wait(seconds: float) -> None:
        tried.set()
        await go_on.wait()

    monkeypatch.setattr(parts, "load_background", load)
    monkeypatch.setattr(loading, "wait_before_retry", wait)
    use_interfaces(monkeypatch, render=add_route)
    async with running() as client:
        assert (await client.get("/example")).status_code == 200
        await tried.wait()
        response = await client.get("/readyz")
        assert response.status_code == 503
        described = response.json()
        assert described["status"] == "failed"
        assert "Too many open files" in described["interfaces"]["further_kernels"]["problem"]
        with pytest.raises(pending.KernelsDelayed) as raised:
            pending.wait_for_kernel("renderers.shading.mikktspace.first")
        assert "/home" not in str(raised.value)
        error.clear()
        go_on.set()
        await until(lambda: not pending.any_pending())
        async with asyncio.timeout(SECONDS):
            while (await client.get("/readyz")).json()["status"] != "ready":  # noqa: ASYNC110 - no event
                await asyncio.sleep(0)


async def test_further_kernels_in_the_cache_are_loaded_though_others_cannot_be_compiled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    failed = asyncio.Event()

    async def compile_missing(names: Collection[str], *_: object) -> None:
        assert list(names) == ["stereo"]
        raise cache.KernelError("the cache cannot be written")

    async def wait(seconds: float) -> None:
        failed.set()
        await asyncio.Event().wait()

    monkeypatch.setattr(cache, "are_cached", lambda names: "stereo" not in names)
    monkeypatch.setattr(cache, "compile_missing", compile_missing)
    monkeypatch.setattr(loading, "wait_before_retry", wait)
    registry = ServiceRegistry()
    with pending.announced({name: part.has_kernel for name, part in parts.BACKGROUND.items()}), ExitStack() as stack:
        task = asyncio.create_task(loading.KernelLoader(registry, stack).load_background())
        await failed.wait()
        assert [name for name in parts.BACKGROUND if pending.is_pending(name)] == ["stereo"]
        task.cancel()


async def test_cold_kernels_are_compiled_by_a_child_before_they_are_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []

    async def compile_missing(parts: Collection[str], progress: KernelProgress) -> None:
        order.append("compiled")

    monkeypatch.setattr(cache, "are_cached", lambda parts: False)
    monkeypatch.setattr(cache, "compile_missing", compile_missing)
    monkeypatch.setattr(parts, "load_needed", lambda: order.append("loaded"))
    use_interfaces(monkeypatch, render=add_route)
    async with running() as client:
        await client.get("/example")
    assert order == ["compiled", "loaded"]


async def test_while_it_compiles_log_health_and_responses_have_the_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, go_on = asyncio.Event(), asyncio.Event()
    needed = parts.NEEDED
    percent = 100 * needed["shading"].function_count // sum(part.function_count for part in needed.values())

    async def compile_missing(names: Collection[str], progress: KernelProgress) -> None:
        assert set(progress.expected) == set(names) == set(needed)
        progress.add("shading", complete=True)
        begun.set()
        await go_on.wait()

    monkeypatch.setattr(cache, "are_cached", lambda parts: False)
    monkeypatch.setattr(cache, "compile_missing", compile_missing)
    use_interfaces(monkeypatch, render=add_route)
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
                assert compiling == {"percent": percent}
            answer = await client.get("/example", headers={"Accept": "text/html"})
            assert (answer.status_code, answer.headers["retry-after"]) == (503, "1")
            assert f"{percent} %" in answer.text
            go_on.set()
            async with asyncio.timeout(SECONDS):
                while (await client.get("/readyz")).status_code != 200:
                    await asyncio.to_thread(lambda: None)  # the kernels are loaded in a thread
            assert (await client.get("/readyz")).json()["interfaces"]["kernels"] == {"state": "ready"}
    said = [line for line in lines if "ompil" in line["event"] and "further" not in line["event"]]
    assert [line["event"] for line in said] == [
        "Compiling the rendering kernels into the cache, once: 15 seconds on two idle cores ...",
        "Compiling the rendering kernels",
        "The rendering kernels are compiled",
    ]
    assert said[1]["percent"] == percent // 20 * 20
    assert all(line["seconds"] >= 0.0 for line in said[1:])


async def test_a_kernel_compiled_while_serving_is_an_error_in_the_log(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba import njit

    use_interfaces(monkeypatch, render=add_route)
    with structlog.testing.capture_logs() as lines:
        async with running() as client:
            await client.get("/example")
            njit(lambda x: x + 1)(1)
        njit(lambda x: x + 2)(1)  # the application has ended
    (line,) = [line for line in lines if "compiled in the serving process" in line["event"]]
    assert line["log_level"] == "error"
    assert line["kernel"].startswith("tests.test_app.")


async def test_docs_and_landing_page_need_no_other_host(monkeypatch: pytest.MonkeyPatch) -> None:
    use_interfaces(monkeypatch)
    async with running() as client:
        for path in ("/docs", "/"):
            page = await client.get(path)
            assert page.status_code == 200
            assert not re.search(r"(?:src|href)=[\"'](?:https?:)?//", page.text)
            for link in re.findall(r"(?:src|href)=[\"'](/[^\"']+)", page.text):
                assert (await client.get(link)).status_code == 200
        assert "validatorUrl" in (await client.get("/docs")).text


@pytest.mark.parametrize(("only", "has_view"), [((), True), (("render",), False)])
async def test_landing_page_links_the_view_where_there_is_one(
    monkeypatch: pytest.MonkeyPatch, only: tuple[str, ...], has_view: bool
) -> None:
    use_interfaces(monkeypatch, render=add_route, view=lambda context: None)
    async with running(only=only) as client:
        links = re.findall(r"href=[\"']([^\"']+)", (await client.get("/")).text)
    assert ("view" in links) == has_view


async def test_metrics_show_the_queue(monkeypatch: pytest.MonkeyPatch) -> None:
    use_interfaces(monkeypatch)
    async with running() as client:
        text = (await client.get("/metrics")).text
        assert "scenegate_render_waiting 0.0" in text
        assert "scenegate_render_slow 0.0" in text


@pytest.mark.parametrize(("only", "expected"), [(("render",), 503), (("render", "scene"), 200)])
async def test_a_render_only_gateway_is_not_ready_while_its_queue_is_full(
    monkeypatch: pytest.MonkeyPatch, only: tuple[str, ...], expected: int
) -> None:
    contexts: list[Context] = []
    use_interfaces(monkeypatch, render=contexts.append)
    async with running(only=only, threads=1, queue=1) as client:
        await until(lambda: contexts)
        release = threading.Event()
        calls = [asyncio.create_task(contexts[0].workers.run(release.wait)) for _ in range(2)]
        await until(lambda: contexts[0].workers.stats.waiting == 1 and contexts[0].workers.stats.running == 1)
        full = await client.get("/readyz")
        assert full.status_code == expected
        assert full.json()["status"] == ("busy" if expected == 503 else "ready")
        release.set()
        await asyncio.gather(*calls)
        assert (await client.get("/readyz")).status_code == 200


def test_the_module_level_app_is_made_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_setup, "configure", lambda *_, **__: None)
    assert gateway.app.app.title == "Scenegate"
    with pytest.raises(AttributeError):
        _ = gateway.app.nothing


@pytest.mark.parametrize("settings", [{"backdrop": "FILE"}, {"stereo_scene": "FILE", "grpc_port": 0}])
async def test_a_scene_file_of_the_settings_may_need_background_kernels(
    settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    scene = tmp_path / "triangle.gltf"
    scene.write_text(json.dumps(gltf()))  # without normals
    name = "stereo" if "stereo_scene" in settings else "render"
    setup = getattr(gateway.wiring, name).setup
    monkeypatch.setattr(startup, "INTERFACES", {name: setup})
    async with asyncio.timeout(SECONDS):
        async with running(
            **{key: str(scene) if value == "FILE" else value for key, value in settings.items()}
        ) as client:
            assert (await client.get("/openapi.json")).status_code == 200  # waits for the interface
            assert (await client.get("/healthz")).json()["interfaces"][name]["state"] != "failed"


async def test_shutdown_during_the_start_answers_waiting_requests(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, go_on = threading.Event(), threading.Event()

    def compiling() -> None:
        asked.set()
        go_on.wait()

    monkeypatch.setattr(parts, "load_needed", compiling)
    use_interfaces(monkeypatch, render=add_route)
    app = gateway.app.create_app(Settings())
    try:
        async with app.router.lifespan_context(app):
            transport = httpx2.ASGITransport(app=app)
            async with httpx2.AsyncClient(transport=transport, base_url="http://test") as client:
                waiting = asyncio.create_task(client.get("/example"))
                await asyncio.to_thread(asked.wait)
                app.state.context.begin_shutdown()
                answer = await waiting
        assert (answer.status_code, answer.text) == (503, "The gateway did not start: it was told to stop\n")
    finally:
        go_on.set()


async def test_a_service_started_after_shutdown_began_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    service = FakeService()

    def late(context: Context) -> None:
        context.begin_shutdown()
        context.run_service("render", service)

    use_interfaces(monkeypatch, render=late)
    async with asyncio.timeout(SECONDS), running() as client:
        await client.get("/example")  # waits until the interfaces have started
    assert service.ended.is_set()


async def test_openapi_is_generated_by_the_event_loop_before_requests_are_let_in(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """FastAPI prepares the routes for the first request; a thread that describes them at that moment fails."""
    threads: list[int] = []

    def openapi(app: FastAPI) -> dict[str, Any]:
        threads.append(threading.get_ident())
        assert not app.state.context.started.is_set()
        return {"paths": {}}

    monkeypatch.setattr(FastAPI, "openapi", openapi)
    use_interfaces(monkeypatch, render=add_route)
    async with running() as client:
        assert (await client.get("/example")).json() == "here"
    assert set(threads) == {threading.get_ident()}


async def test_is_not_ready_before_requests_are_let_in(monkeypatch: pytest.MonkeyPatch) -> None:
    joining, go_on = asyncio.Event(), asyncio.Event()

    async def restore_state(_: Context) -> None:
        joining.set()
        await go_on.wait()

    monkeypatch.setattr(startup, "restore_state", restore_state)
    use_interfaces(monkeypatch)  # none: readiness depends on the kernels alone
    async with running() as client:
        await joining.wait()
        assert (await client.get("/readyz")).json()["status"] == "starting"
        go_on.set()
        async with asyncio.timeout(SECONDS):
            while (await client.get("/readyz")).status_code != 200:  # noqa: ASYNC110 - readiness has no event
                await asyncio.sleep(0)  # the request alone never lets the start go on
