"""HEAD behind the gateway's HTTP server."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import httpx2
import pytest
from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, StreamingResponse

from gateway.runtime.metrics_registry import Metrics
from gateway.server.error_handlers import HeadAsGet, not_allowed
from gateway.server.middleware import RequestContext
from tests.server.listening import listening
from tests.support.waiting import SECONDS


class World:
    def __init__(self) -> None:
        self.metrics = Metrics()
        self.stream_ended = asyncio.Event()
        self.methods: list[str] = []
        self.app = FastAPI()
        self.app.add_exception_handler(405, not_allowed)
        self.app.add_middleware(HeadAsGet)
        self.app.add_middleware(RequestContext, metrics=self.metrics)

        @self.app.get("/thing/{name}")
        async def thing(name: str, request: Request) -> JSONResponse:
            self.methods.append(request.method)
            return JSONResponse({"name": name}, headers={"ETag": '"1"'})

        @self.app.get("/refused")
        async def refused() -> PlainTextResponse:
            return PlainTextResponse("no such camera", 400)

        @self.app.get("/stream")
        async def stream() -> StreamingResponse:
            async def endless() -> AsyncIterator[bytes]:
                try:
                    while True:
                        yield b"x" * 1000
                        await asyncio.sleep(0)
                finally:
                    self.stream_ended.set()

            return StreamingResponse(endless(), media_type="multipart/x-mixed-replace")

        @self.app.post("/only-post")
        async def only_post() -> None: ...


@pytest.mark.parametrize("path", ["/thing/1", "/refused", "/nothing", "/only-post", "/openapi.json"])
async def test_head_has_the_status_and_headers_of_get_and_no_body(path: str) -> None:
    world = World()
    async with listening(world.app) as port, httpx2.AsyncClient(base_url=f"http://127.0.0.1:{port}") as http:
        get, head = await http.get(path), await http.head(path)
        assert head.status_code == get.status_code
        assert head.content == b""
        ours = {"date", "x-request-id"}
        assert {k: v for k, v in head.headers.items() if k not in ours} == {
            k: v for k, v in get.headers.items() if k not in ours
        }
        assert (await http.get("/thing/2")).json() == {"name": "2"}, "the connection goes on"


async def test_head_of_an_endless_stream_ends() -> None:
    world = World()
    async with (
        listening(world.app) as port,
        httpx2.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=SECONDS) as http,
        asyncio.timeout(SECONDS),
    ):
        head = await http.head("/stream")
        assert (head.status_code, head.content) == (200, b"")
        assert head.headers["content-type"] == "multipart/x-mixed-replace"
        await world.stream_ended.wait()
        assert (await http.get("/thing/1")).status_code == 200


async def test_head_is_counted_at_its_route() -> None:
    world = World()
    async with listening(world.app) as port, httpx2.AsyncClient(base_url=f"http://127.0.0.1:{port}") as http:
        await http.head("/thing/1")
        allowed = (await http.delete("/thing/1")).headers["allow"]
    assert world.methods == ["GET"]
    assert allowed == "GET, HEAD"
    text = world.metrics.exposition().decode()
    assert 'scenegate_http_requests_total{method="HEAD",route="/thing/{name}",status="200"} 1.0' in text
