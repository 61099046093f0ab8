"""The view's WebSocket: updates and acknowledgements, origins, limits on messages and browsers."""

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any

import numpy as np
import pytest
from fastapi import FastAPI

from gateway.adapters.viewer.config import ViewerConfig
from gateway.adapters.viewer.hub import ViewHub
from gateway.adapters.viewer.routes import ACKNOWLEDGE, ACKNOWLEDGE_CONTROLS, MAX_MESSAGE_CHARS, router
from gateway.scene.page.control_store import ControlLimits, ControlStore
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.live import LiveTree
from scenegate.messages.clicks import Click
from scenegate.messages.controls import AnyControl, Button, Gizmo, Plot, Slider, TextInput
from tests.adapters.viewer.model import add_box, running
from tests.support.view_frames import parse_frame
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
        self.is_lost = False
        self.has_failed = False
        self.task = asyncio.create_task(app(scope, self._to_app.get, self._deliver))

    async def _deliver(self, message: Any) -> None:
        self.has_failed |= self.is_lost
        if self.is_lost:
            raise OSError("the connection is lost")
        await self._from_app.put(message)

    def send(self, message: str | bytes) -> None:
        kind = "text" if isinstance(message, str) else "bytes"
        self._to_app.put_nowait({"type": "websocket.receive", kind: message})

    async def leave(self) -> None:
        """Disconnect, and wait until the gateway has finished."""
        self._to_app.put_nowait({"type": "websocket.disconnect", "code": 1001})
        await self.task

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

    async def frame(self, kind: str) -> tuple[dict[str, Any], memoryview]:
        """Return header and body of the next frame of a kind."""
        while True:
            message = await self.receive()
            if "bytes" in message:
                header, body = parse_frame(message["bytes"])
                if header["kind"] == "controls":
                    self.send(ACKNOWLEDGE_CONTROLS)
                if header["kind"] == kind:
                    return header, body

    async def closed(self) -> tuple[int, str]:
        """Return code and reason of the close message."""
        while (message := await self.receive())["type"] != "websocket.close":
            pass
        return message["code"], message["reason"]


class View:
    def __init__(self, config: ViewerConfig = CONFIG) -> None:
        self.tree = LiveTree()
        self.page = LivePage()
        self.hub = ViewHub(config, self.tree, live_page=self.page)
        self.app = FastAPI()
        self.app.include_router(router(self.hub))

    def edit(self, name: str) -> None:
        add_box(self.tree, name)

    @property
    def browsers(self) -> int:
        return int(self.hub.status()["browsers"])


@pytest.fixture
async def view() -> AsyncIterator[View]:
    view = View()
    async with running(view.hub):
        yield view


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
    await socket.leave()
    assert view.browsers == 0


async def test_meshes_that_a_page_has_dropped_are_sent_again(view: View) -> None:
    view.edit("box")
    socket = Socket(view.app)
    header, _ = await socket.frame("mesh")
    socket.send(f'{{"forgot": [{header["id"]}, 99]}}')
    socket.send('{"forgot": ["x"]}')
    await socket.update()
    socket.send(ACKNOWLEDGE)
    with view.tree.edit() as edit:
        edit.set_parts(("other",), view.tree.snapshot.root.children["box"].parts or ())
    again, _ = await socket.frame("mesh")
    assert again["id"] == header["id"]
    await socket.leave()


@pytest.mark.parametrize(
    ("origin", "accepted"),
    [
        ("http://gateway.example:8000", True),
        (None, True),
        ("https://evil.example", False),
        ("http://gateway.example", False),
        ("http://gateway.example:8001", False),
    ],
)
async def test_pages_of_other_origins_are_refused_before_the_handshake(
    view: View, origin: str | None, accepted: bool
) -> None:
    socket = Socket(view.app, origin)
    first = await socket.receive()
    assert (first["type"], first.get("code")) == (("websocket.accept", None) if accepted else ("websocket.close", 1008))
    assert view.browsers == accepted
    await socket.leave()


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
    await socket.leave()
    assert clicks == [Click(("box",), (1.0, 2.0, 3.0), "middle")]


async def test_clicks_that_are_too_fast_are_dropped(view: View, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.adapters.viewer.routes.MAX_CLICKS", 0)
    clicks: list[Click] = []
    view.page.clicks.subscribe("client", [()], clicks.append)
    socket = Socket(view.app)
    await socket.update()
    for _ in range(3):
        socket.send('{"node": 0, "point": [1, 2, 3], "button": "left"}')
    await socket.leave()
    assert clicks == []


async def test_changes_of_controls_reach_the_client_and_other_pages(view: View) -> None:
    received: list[tuple[list[Any], int]] = []
    controls: list[AnyControl] = [Slider(("speed",), 0, 10), TextInput(("name",)), Gizmo(("target",), ("box",))]
    view.page.controls.set_controls("client", controls, lambda values, after: received.append((list(values), after)), 5)
    view.edit("box")
    socket = Socket(view.app)
    header, _ = await socket.frame("controls")
    assert [(each["id"], each["value"]) for each in header["controls"]] == [(1, 0.0), (2, ""), (3, None)]
    for invalid in ('{"control": "a"}', '{"control": 1}', '{"control": 9, "number": 1}'):
        socket.send(invalid)
    socket.send('{"control": 1, "number": 2, "value": 3}')
    while (await socket.frame("received"))[0]["number"] != 2:
        pass
    header, _ = await socket.frame("controls")
    assert (header["controls"], header["values"]) == (None, [[1, 3.0]])
    await until(lambda: received == [([(("speed",), 3.0)], 5)])
    socket.send(json.dumps({"control": 2, "number": 3, "value": "\x01" * 1000}))  # 6000 characters
    await until(lambda: received[1:] == [([(("name",), "\x01" * 1000)], 5)])
    socket.send('{"control": 3, "number": 4, "value": {"translation": [1, 2, 3], "quaternion": [1, 0, 0, 0]}}')
    await until(lambda: view.tree.snapshot.root.children["box"].pose == (1, 2, 3, 1, 0, 0, 0))
    await until(lambda: len(received) == 3)
    with view.tree.edit() as edit:
        edit.delete(("box",))
    socket.send('{"control": 3, "number": 5, "value": {"translation": [0, 0, 0], "quaternion": [1, 0, 0, 0]}}')
    await until(lambda: len(received) == 4)
    assert not view.tree.snapshot.root.children
    await socket.leave()


async def test_a_slow_page_misses_values_in_between(view: View) -> None:
    view.page.controls.set_controls("client", [Slider(("speed",), 0, 10)], lambda values, after: None, 1)
    view.edit("box")
    socket = Socket(view.app)
    while (message := await socket.receive()).get("bytes") is None or b'"controls"' not in message["bytes"]:
        pass
    for value in (1, 2, 3):
        view.page.controls.set_value("client", ("speed",), value, 1)
        view.edit(f"box {value}")
        socket.send(ACKNOWLEDGE)
        await socket.update()  # the values wait, the scene does not
    socket.send(ACKNOWLEDGE_CONTROLS)
    header, _ = await socket.frame("controls")
    assert header["values"] == [[1, 3.0]]
    await socket.leave()


async def test_samples_of_plots_are_sent_once(view: View) -> None:
    view.page.controls.set_controls("client", [Plot(("loads",), ("a",))], lambda values, after: None, 1)
    view.page.controls.add_samples("client", ("loads",), np.array([[1.0, 2.0]]), 1)
    socket = Socket(view.app)
    for rows in ([[1.0, 2.0]], [[2.0, np.nan], [3.0, 4.0]]):
        header, body = await socket.frame("controls")
        ((control_id, (offset, count)),) = header["samples"]
        np.testing.assert_array_equal(np.frombuffer(body, "<f8", count, offset).reshape(-1, 2), rows)
        assert control_id == 1
        view.page.controls.add_samples("client", ("loads",), np.array([[2.0, np.nan], [3.0, 4.0]]), 1)
    await socket.leave()


async def test_changes_that_are_too_fast_wait(view: View, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.adapters.viewer.routes.MAX_CHANGES", 2)
    received: list[Any] = []
    view.page.controls.set_controls("client", [Button(("go",))], lambda values, after: received.extend(values), 1)
    socket = Socket(view.app)
    for number in range(3):
        socket.send(f'{{"control": 1, "number": {number}}}')
    await until(lambda: received and received[-1] == (("go",), 3))
    await socket.leave()


async def test_controls_of_a_client_that_vanishes_are_removed() -> None:
    page = LivePage()
    page.controls = store = ControlStore(ControlLimits(lease_seconds=0.0))
    async with running(ViewHub(ViewerConfig(status_seconds=0.01), LiveTree(), live_page=page)):
        store.set_controls("client", [Button(("go",))], lambda values, after: None, 1)
        await until(lambda: store.controls_since(0) == [])


@pytest.mark.parametrize(
    ("message", "code", "reason"),
    [
        ("x" * (MAX_MESSAGE_CHARS + 1), 1009, f"messages have at most {MAX_MESSAGE_CHARS} characters"),
        (b"k", 1003, "messages of the page are text"),
    ],
    ids=["long", "binary"],
)
async def test_other_messages_close_the_connection(view: View, message: str | bytes, code: int, reason: str) -> None:
    socket = Socket(view.app)
    await socket.update()
    socket.send("x" * MAX_MESSAGE_CHARS)
    socket.send(message)
    assert await socket.closed() == (code, reason)
    async with asyncio.timeout(SECONDS):
        await socket.task
    assert view.browsers == 0


async def test_a_connection_that_sending_has_lost_ends_without_an_error(view: View) -> None:
    """Sending finds the loss first, while messages of the page still wait."""
    view.edit("box")
    socket = Socket(view.app)
    await socket.update()
    socket.is_lost = True
    view.edit("second")
    socket.send(ACKNOWLEDGE)
    await until(lambda: socket.has_failed)
    socket.send(ACKNOWLEDGE)
    async with asyncio.timeout(SECONDS):
        await socket.task
    assert view.browsers == 0


async def test_browsers_beyond_the_limit_are_told_to_try_again(view: View) -> None:
    first = Socket(view.app)
    await first.update()
    second = Socket(view.app)
    assert await second.closed() == (1013, "1 browsers are connected, which is the limit (max_browsers)")
    assert view.browsers == 1
    await first.leave()
    third = Socket(view.app)
    await third.update()
    await third.leave()


async def test_browsers_are_closed_when_the_gateway_stops() -> None:
    view = View()
    async with running(view.hub):
        socket = Socket(view.app)
        await socket.update()
    assert await socket.closed() == (1001, "the gateway is shutting down")
    await socket.leave()
