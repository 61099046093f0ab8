"""Requests that go past the router."""

from __future__ import annotations

from starlette.types import ASGIApp, Receive, Scope, Send

from gateway.server.straight import Straight


async def reached(scope: dict[str, object]) -> str:
    seen: list[str] = []

    def app(name: str) -> ASGIApp:
        async def note(scope: Scope, receive: Receive, send: Send) -> None:
            seen.append(name)

        return note

    async def nothing(*_: object) -> None:
        raise AssertionError

    routes: dict[tuple[str, str], ASGIApp] = {}
    middleware = Straight(app("router"), routes=routes)
    routes["POST", "/render"] = app("route")  # rooms are joined after the application was made
    await middleware(scope, nothing, nothing)  # type: ignore[arg-type]  # nobody receives or sends
    (name,) = seen
    return name


def scope(**changes: object) -> dict[str, object]:
    return {"type": "http", "method": "POST", "path": "/render", "root_path": "", **changes}


async def test_method_and_path_lead_to_the_route() -> None:
    assert await reached(scope()) == "route"


async def test_all_else_is_the_routers() -> None:
    assert await reached(scope(method="GET")) == "router"
    assert await reached(scope(path="/render/")) == "router"
    assert await reached(scope(path="/prefix/render", root_path="/prefix")) == "router"
    assert await reached(scope(root_path="/render")) == "router"
    assert await reached({"type": "websocket", "path": "/render"}) == "router"
    assert await reached({"type": "lifespan"}) == "router"
