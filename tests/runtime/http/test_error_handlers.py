"""HEAD, 405 and invalid parameters behind the gateway's HTTP server."""

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

import httpx2
import pytest
from fastapi import FastAPI, Query
from fastapi.exceptions import RequestValidationError
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, StreamingResponse

from gateway.runtime.http.edge import Edge
from gateway.runtime.http.error_handlers import invalid_parameters, not_allowed
from gateway.runtime.logs.metrics_registry import Metrics
from tests.runtime.http.listening import listening
from tests.support.waiting import SECONDS


class World:
    def __init__(self) -> None:
        self.metrics = Metrics()
        self.stream_ended = asyncio.Event()
        self.methods: list[str] = []
        self.app = FastAPI()
        self.app.add_exception_handler(405, not_allowed)
        self.app.add_exception_handler(RequestValidationError, invalid_parameters)
        self.app.add_middleware(Edge, metrics=self.metrics)

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

        @self.app.get("/api/v1/log")
        @self.app.get("/log")
        async def log(limit: Annotated[int, Query(ge=1)], rate: Annotated[float, Query(gt=0)] = 1.0) -> None: ...


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


async def test_invalid_parameters_are_one_sentence_with_name_limit_and_value() -> None:
    async with listening(World().app) as port, httpx2.AsyncClient(base_url=f"http://127.0.0.1:{port}") as http:
        one = await http.get("/log", params={"limit": "-1"})
        two = await http.get("/log", params={"limit": "x" * 1000, "rate": 0})
        camera = await http.get("/api/v1/log", params={"limit": "-1"})
    sentence = "limit: Input should be greater than or equal to 1, got '-1'."
    assert (one.status_code, one.text) == (422, sentence + "\n")
    assert one.headers["content-type"] == "text/plain; charset=utf-8"
    assert "rate: Input should be greater than 0, got '0'." in two.text
    assert len(two.text) < 400
    assert (camera.status_code, camera.json()["message"]) == (422, sentence)


async def test_error_responses_of_the_stereo_camera_are_json() -> None:
    async with listening(World().app) as port, httpx2.AsyncClient(base_url=f"http://127.0.0.1:{port}") as http:
        for refused in (await http.get("/api/v1/log", params={"limit": 0}), await http.post("/api/v1/log")):
            message = refused.json()["message"]
            assert refused.json()["return_code"] == {"value": -1, "message": message}
    assert (refused.status_code, refused.headers["allow"]) == (405, "GET, HEAD")
    assert "POST" in message
