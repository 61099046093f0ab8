"""Paths below a prefix that a proxy keeps (``--root-path``), and redirects that do without knowing the prefix."""

from urllib.parse import quote, urljoin

import httpx2
import pytest
from fastapi import FastAPI, Request, WebSocket
from starlette.testclient import TestClient

from gateway.runtime.http.error_handlers import not_found
from gateway.runtime.http.path_prefix import PathPrefix

PREFIX = "/user/änn/8000"


def make_app() -> FastAPI:
    app = FastAPI(redirect_slashes=False, exception_handlers={404: not_found})

    @app.get("/view")
    async def view(request: Request) -> str:
        return f"{request.url.path} {request.scope['raw_path'].decode()}"

    @app.websocket("/view/ws")
    async def socket(socket: WebSocket) -> None:
        await socket.accept()
        await socket.send_text(socket.scope["path"])
        await socket.close()

    app.add_middleware(PathPrefix, prefix=PREFIX)
    return app


def client() -> httpx2.AsyncClient:
    return httpx2.AsyncClient(transport=httpx2.ASGITransport(make_app()), base_url="http://here")


@pytest.mark.parametrize("prefix", ["", PREFIX])
async def test_routes_are_found_with_and_without_the_prefix(prefix: str) -> None:
    async with client() as http:
        assert (await http.get(f"{prefix}/view")).json() == "/view /view"


@pytest.mark.parametrize("path", [f"{PREFIX}/views", f"{PREFIX}view", f"/x{PREFIX}/view"])
async def test_other_paths_are_not_found(path: str) -> None:
    async with client() as http:
        assert (await http.get(path)).status_code == 404


def test_websockets_have_the_prefix_too() -> None:
    with TestClient(make_app()).websocket_connect(f"{PREFIX}/view/ws") as socket:
        assert socket.receive_text() == "/view/ws"


@pytest.mark.parametrize(
    ("path", "target"), [("/view/", "/view"), (f"{PREFIX}/view/", f"{PREFIX}/view"), (PREFIX, f"{PREFIX}/")]
)
async def test_redirects_are_relative(path: str, target: str) -> None:
    """So that they lead to the right place below a prefix that is not known, too."""
    async with client() as http:
        response = await http.get(path)
        assert response.status_code == 307
        location = response.headers["location"]
        assert location.startswith(".")
        assert urljoin(f"http://proxy/unknown{quote(path)}", location) == f"http://proxy/unknown{quote(target)}"


@pytest.mark.parametrize("path", ["//evil.example/", "/x//evil.example//", "/\\evil.example/"])
async def test_redirects_stay_on_the_host(path: str) -> None:
    async with client() as http:
        location = (await http.get(httpx2.URL(f"http://here{path}"))).headers["location"]
    assert urljoin(f"http://here{path}", location).startswith("http://here/")
