"""Requests that arrive before the gateway has started."""

import asyncio

import httpx2
import pytest
from fastapi import FastAPI
from fastapi.responses import PlainTextResponse

from gateway.runtime.http.edge import Edge
from gateway.runtime.http.start_gate import StartGate
from gateway.runtime.kernels.progress import KernelProgress

BROWSER = {"Accept": "text/html,application/xhtml+xml,*/*;q=0.8"}


def gate(started: asyncio.Event, problem: str = "", compiling: KernelProgress | None = None) -> httpx2.AsyncClient:
    app = FastAPI()

    @app.get("/things/{name}")
    async def thing(name: str) -> PlainTextResponse:
        return PlainTextResponse(name)

    start = StartGate(started=started, problem=lambda: problem, open_paths={"/things/open"}, progress=lambda: compiling)
    layer = Edge(app, gate=start)
    return httpx2.AsyncClient(transport=httpx2.ASGITransport(app=layer), base_url="http://test")


def half() -> KernelProgress:
    progress = KernelProgress({"shading": 1, "raster": 1})
    progress.add("shading", complete=True)
    return progress


@pytest.mark.parametrize("compiling", [False, True])
async def test_requests_wait_for_the_start_except_open_paths(compiling: bool) -> None:
    started = asyncio.Event()
    async with gate(started, compiling=half() if compiling else None) as http:
        assert (await http.get("/things/open")).text == "open"
        waiting = asyncio.create_task(http.get("/things/a"))
        for _ in range(10):
            await http.get("/things/open")
        assert not waiting.done()
        started.set()
        assert (await waiting).text == "a"


async def test_a_browser_gets_a_page_with_the_progress() -> None:
    started = asyncio.Event()
    async with gate(started, compiling=half()) as http:
        answer = await http.get("/things/a", headers=BROWSER)
        assert (answer.status_code, answer.headers["content-type"]) == (503, "text/html; charset=utf-8")
        assert '<progress value="0.500">' in answer.text
        assert "50 %" in answer.text
        started.set()
        assert (await http.get("/things/a", headers=BROWSER)).text == "a"
    async with gate(asyncio.Event()) as http:
        assert "Loading" in (await http.get("/things/a", headers=BROWSER)).text


async def test_failed_start_is_503_with_the_reason() -> None:
    started = asyncio.Event()
    started.set()
    async with gate(started, "no kernels") as http:
        answer = await http.get("/things/a")
    assert (answer.status_code, answer.text) == (503, "The gateway did not start: no kernels\n")
