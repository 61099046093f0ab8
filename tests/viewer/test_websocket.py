"""The view's WebSocket: updates and acknowledgements, origins, limits on messages and browsers."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Any

import pytest
from fastapi import FastAPI

from gateway.scene.clicks import Click
from gateway.scene.geometry import Box, Part
from gateway.scene.live import LiveTree
from gateway.scene.live_page import LivePage
from gateway.viewer.config import ViewerConfig
from gateway.viewer.frames import parse_frame
from gateway.viewer.hub import ViewHub
from gateway.viewer.routes import ACKNOWLEDGE, MAX_MESSAGE_CHARS, router
from renderers.drawlist import Material
from tests.support.waiting import SECONDS, until

CONFIG = ViewerConfig(max_update_rate=1000.0, max_browsers=1)


class Socket:
    """A browser's side of an ASGI WebSocket."""

    def __init__(self, app: FastAPI, origin: str | None = None) -> None:
        headers = [(b"host", b"gateway.example:8000")]
        headers += [(b"origin", origin.encode())] if origin else []
        scope = {"type": "websocket", "path": "/view/ws", "headers": headers, "query_string": b"", "scheme": "ws"}
        self._to_app: asyncio.Queue[Any] = asyncio.Queue()
        self._from_app: asyncio.Queue[Any] = asyncio.Queue()
        self._to_app.put_nowait({"type": "websocket.connect"})
        self.task = asyncio.create_task(app(scope, self._to_app.get, self._from_app.put))

    def send(self, message: str | bytes) -> None:
        kind = "text" if isinstance(message, str) else "bytes"
        self._to_app.put_nowait({"type": "websocket.receive", kind: message})

    def disconnect(self) -> None:
        self._to_app.put_nowait({"type": "websocket.disconnect", "code": 1001})

    async def receive(self) -> dict[str, Any]:
        async with asyncio.timeout(SECONDS):
            return dict(await self._from_app.get())

    async def update(self) -> dict[str, Any]:
        """Return the header of the next update."""
        while True:
            message = await self.receive()
            assert message["type"] in ("websocket.accept", "websocket.send"), message
            if "bytes" in message:
                header, _ = parse_frame(message["bytes"])
                if header["kind"] == "update":
                    return header

    async def closed(self) -> tuple[int, str]:
        """Return code and reason of the close message."""
        while (message := await self.receive())["type"] != "websocket.close":
            pass
        return message["code"], message["reason"]


class View:
    def __init__(self, config: ViewerConfig = CONFIG) -> None:
        self.tree = LiveTree()
        self.page = LivePage()
        self.hub = ViewHub(config, self.tree, page=self.page)
        self.app = FastAPI()
        self.app.include_router(router(self.hub))
        self.updates = asyncio.create_task(self.hub.run())

    def edit(self, name: str) -> None:
        with self.tree.edit() as edit:
            edit.set_parts((name,), (Part(Box((1, 1, 1)), Material()),))

    @property
    def browsers(self) -> int:
        return int(self.hub.status()["browsers"])


@pytest.fixture
async def view() -> AsyncIterator[View]:
    view = View()
    yield view
    view.updates.cancel()
    with suppress(asyncio.CancelledError):
        await view.updates


async def test_the_next_update_follows_the_acknowledgement(view: View) -> None:
    view.edit("box")
    socket = Socket(view.app)
    assert (await socket.update())["revision"] == 1
    socket.send("x")  # not an acknowledgement
    view.edit("second")
    view.edit("third")
    socket.send(ACKNOWLEDGE)
    update = await socket.update()
    assert (update["from"], update["revision"]) == (1, 3)
    assert [node["name"] for node in update["nodes"]] == ["second", "third"]
    assert view.browsers == 1
    socket.disconnect()
    await socket.task
    assert view.browsers == 0


@pytest.mark.parametrize("origin", ["http://gateway.example:8000", None])
async def test_pages_of_the_gateway_and_other_clients_are_accepted(view: View, origin: str | None) -> None:
    socket = Socket(view.app, origin)
    assert (await socket.receive())["type"] == "websocket.accept"
    socket.disconnect()
    await socket.task


@pytest.mark.parametrize("origin", ["https://evil.example", "http://gateway.example", "http://gateway.example:8001"])
async def test_pages_of_other_origins_are_refused_before_the_handshake(view: View, origin: str) -> None:
    first = await Socket(view.app, origin).receive()
    assert (first["type"], first["code"]) == ("websocket.close", 1008)
    assert view.browsers == 0


async def test_clicks_are_passed_to_the_clients_that_want_them(view: View) -> None:
    clicks: list[Click] = []
    view.page.clicks.subscribe("client", [("box",)], clicks.append)
    view.edit("box")
    socket = Socket(view.app)
    (node,) = (await socket.update())["nodes"]
    for invalid in ('{"node": -1', '{"node": "x"}', '{"node": 1e99, "point": [0, 0, 0], "button": "left"}', "[]"):
        socket.send(invalid)
    for number in (-1, 0, 99):
        socket.send(f'{{"node": {number}, "point": [1, 2, 3], "button": "left"}}')
    socket.send(f'{{"node": {node["id"]}, "point": [null, 2, 3], "button": "left"}}')
    socket.send(f'{{"node": {node["id"]}, "point": [1, 2, 3], "button": "none"}}')
    socket.send(f'{{"node": {node["id"]}, "point": [1, 2, 3], "button": "middle"}}')
    await until(lambda: clicks)
    with view.tree.edit() as edit:
        edit.delete(("box",))
    socket.send(f'{{"node": {node["id"]}, "point": [1, 2, 3], "button": "left"}}')
    socket.disconnect()
    await socket.task
    assert clicks == [Click(("box",), (1.0, 2.0, 3.0), "middle")]


async def test_clicks_that_are_too_fast_are_dropped(view: View, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.viewer.routes.MAX_CLICKS", 0)
    clicks: list[Click] = []
    view.page.clicks.subscribe("client", [()], clicks.append)
    socket = Socket(view.app)
    await socket.update()
    for _ in range(3):
        socket.send('{"node": 0, "point": [1, 2, 3], "button": "left"}')
    socket.disconnect()
    await socket.task
    assert clicks == []


async def test_a_message_beyond_the_limit_closes_the_connection(view: View) -> None:
    socket = Socket(view.app)
    await socket.update()
    socket.send("x" * MAX_MESSAGE_CHARS)
    socket.send("x" * (MAX_MESSAGE_CHARS + 1))
    assert await socket.closed() == (1009, f"messages have at most {MAX_MESSAGE_CHARS} characters")
    await socket.task
    assert view.browsers == 0


async def test_a_binary_message_ends_the_connection(view: View) -> None:
    socket = Socket(view.app)
    await socket.update()
    socket.send(b"k")
    async with asyncio.timeout(SECONDS):
        await socket.task
    assert view.browsers == 0


async def test_browsers_beyond_the_limit_are_told_to_try_again(view: View) -> None:
    first = Socket(view.app)
    await first.update()
    second = Socket(view.app)
    assert await second.closed() == (1013, "1 browsers are connected, which is the limit (max_browsers)")
    assert view.browsers == 1
    first.disconnect()
    await first.task
    third = Socket(view.app)
    await third.update()
    third.disconnect()
    await third.task


async def test_browsers_are_closed_when_the_gateway_stops(view: View) -> None:
    socket = Socket(view.app)
    await socket.update()
    view.updates.cancel()
    assert await socket.closed() == (1001, "the gateway is shutting down")
    socket.disconnect()
    await socket.task
