"""Middleware of every HTTP request: ids, log lines, metrics, and the URL limit."""

import asyncio
import re
from typing import Any

import httpx2
import pytest
from fastapi import FastAPI, Request
from fastapi.responses import PlainTextResponse
from starlette.middleware.body_limit import RequestBodyLimitMiddleware
from starlette.types import ASGIApp
from structlog.testing import capture_logs

from gateway.runtime.http.access import Access
from gateway.runtime.http.edge import Edge
from gateway.runtime.http.protection import MAX_TARGET_BYTES, Protection
from gateway.runtime.http.start_gate import StartGate
from gateway.runtime.http.tokens import Tokens
from gateway.runtime.logs.metrics_registry import Metrics


def make(metrics: Metrics) -> FastAPI:
    app = FastAPI()
    app.add_middleware(Edge, metrics=metrics, quiet_paths={"/quiet"})

    @app.get("/things/{name}")
    async def thing(name: str) -> PlainTextResponse:
        return PlainTextResponse(name)

    @app.get("/broken")
    async def broken() -> None:
        raise KeyError("x")

    return app


def client(app: ASGIApp) -> httpx2.AsyncClient:
    transport = httpx2.ASGITransport(app=app, raise_app_exceptions=False)
    return httpx2.AsyncClient(transport=transport, base_url="http://test")


async def test_request_id_is_returned_or_replaced() -> None:
    async with client(make(Metrics())) as http:
        given = await http.get("/things/a", headers={"X-Request-ID": "drake-7"})
        assert given.headers["x-request-id"] == "drake-7"
        made = await http.get("/things/a")
        assert re.fullmatch("[0-9a-f]{32}", made.headers["x-request-id"])
        unfit = await http.get("/things/a", headers={"X-Request-ID": "a b{}"})
        assert re.fullmatch("[0-9a-f]{32}", unfit.headers["x-request-id"])


async def test_lifespans_pass() -> None:
    scopes: list[Any] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        scopes.append(scope)

    gate = StartGate(started=asyncio.Event(), problem=lambda: "broken", open_paths=frozenset())
    access, protection = Access(tokens=Tokens("0123456789abcdef")), Protection(hosts=("here",))
    never: Any = None
    edge = Edge(app, access=access, protection=protection, metrics=Metrics(), gate=gate)
    await edge({"type": "lifespan", "path": ""}, never, never)
    assert scopes == [{"type": "lifespan", "path": ""}]


async def test_one_log_line_per_request() -> None:
    async with client(make(Metrics())) as http:
        with capture_logs() as lines:
            await http.get("/things/a")
            await http.get("/quiet")
    assert [(line["log_level"], line["path"], line["status"]) for line in lines] == [
        ("info", "/things/a", 200),
        ("debug", "/quiet", 404),
    ]


async def test_requests_are_counted_by_route() -> None:
    metrics = Metrics()
    async with client(make(metrics)) as http:
        for path in ("/things/a", "/things/b", "/nothing/1", "/nothing/2", "/broken"):
            await http.get(path)
    text = metrics.exposition().decode()
    assert 'scenegate_http_requests_total{method="GET",route="/things/{name}",status="200"} 2.0' in text
    assert 'scenegate_http_requests_total{method="GET",route="(none)",status="404"} 2.0' in text
    assert 'route="/broken",status="500"} 1.0' in text
    assert 'scenegate_http_request_duration_seconds_count{route="/things/{name}"} 2.0' in text
    assert "scenegate_http_requests_in_flight 0.0" in text


async def test_unhandled_error_is_500_with_the_id_and_a_logged_traceback() -> None:
    async with client(make(Metrics())) as http:
        with capture_logs() as lines:
            answer = await http.get("/broken", headers={"X-Request-ID": "r1"})
    assert (answer.status_code, answer.text) == (500, "Internal error: KeyError: 'x' (request r1)\n")
    assert answer.headers["x-request-id"] == "r1"
    assert [line["event"] for line in lines] == ["unhandled", "request"]
    assert lines[0]["exc_info"]


@pytest.mark.parametrize(("host", "status"), [("localhost", 413), ("rebound.example", 421)])
async def test_too_large_body_is_not_logged_as_an_error(host: str, status: int) -> None:
    app = FastAPI()

    @app.post("/things")
    async def things(http: Request) -> PlainTextResponse:
        return PlainTextResponse(str(len(await http.body())))

    metrics = Metrics()
    app.add_middleware(RequestBodyLimitMiddleware, max_body_size=10)
    app.add_middleware(Edge, protection=Protection(hosts=("localhost",)), metrics=metrics)
    async with client(app) as http:
        with capture_logs() as lines:
            answer = await http.post("/things", content=b"x" * 100, headers={"Host": host})
    assert answer.status_code == status
    assert [(line["event"], line["status"]) for line in lines] == [("request", status)]
    assert f'status="{status}"}} 1.0' in metrics.exposition().decode()


async def test_long_target_is_refused() -> None:
    app = make(Metrics())
    app.add_middleware(Edge, protection=Protection())
    path = "/things/a?q="
    room = MAX_TARGET_BYTES - len(path) + len("?")
    async with client(app) as http:
        assert (await http.get(path + "x" * room)).status_code == 200
        answer = await http.get(path + "x" * (room + 1))
    assert (answer.status_code, answer.text) == (414, "The path with its query is longer than 8192 bytes.\n")
