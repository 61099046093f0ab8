"""Credit, notes, limits: what a browser gets and when."""

from __future__ import annotations

import asyncio
import gc
import weakref
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gateway.scene.geometry import Box, Part, Sphere
from gateway.scene.live import LiveTree, Snapshot
from gateway.viewer.config import ViewerConfig
from gateway.viewer.frames import parse
from gateway.viewer.hub import Browser, ViewHub
from gateway.viewer.sources import RenderNote, Rig, ViewPorts
from renderers.drawlist import Material
from tests.support.waiting import SECONDS, until
from tests.viewer.model import Model, tree_of

QUICK = ViewerConfig(rate=1000.0, status_seconds=0.01)


def move(tree: LiveTree, x: float) -> None:
    with tree.edit() as edit:
        edit.set_pose(("box",), (x, 0, 0, 1, 0, 0, 0))


class Client:
    """Takes frames in; says that it is ready when told to."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser
        self.frames = browser.frames()
        self.model = Model()
        self.notes: dict[str, Any] = {}

    async def update(self) -> dict[str, Any]:
        """Everything up to the next update, its header."""
        async with asyncio.timeout(SECONDS):
            async for frame in self.frames:
                header, _ = parse(frame)
                if header["kind"] in ("status", "rig"):
                    self.notes[header["kind"]] = header
                    continue
                self.model.take(frame)
                if header["kind"] == "update":
                    return header
        raise AssertionError("the frames ended")

    async def note(self, kind: str) -> dict[str, Any]:
        """The next note of this kind."""
        async with asyncio.timeout(SECONDS):
            async for frame in self.frames:
                header, _ = parse(frame)
                if header["kind"] == kind:
                    return header
        raise AssertionError("the frames ended")


@pytest.fixture
async def hub() -> Any:
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_parts(("box",), (Part(Box((1, 1, 1)), Material()),))

    def rig(snapshot: Snapshot) -> Rig:
        box = snapshot.root.find(("box",))
        assert box is not None
        return Rig(box.matrix, 4, 3, 2.0, 2.0, 2.0, 1.5, 0.1)

    hub = ViewHub(QUICK, tree, ViewPorts(status=lambda: {"facts": [{"name": "queue", "value": 3}]}, rig=rig))
    running = asyncio.create_task(hub.run())
    await asyncio.sleep(0)
    yield hub, tree
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def test_without_credit_a_browser_gets_no_update_and_then_the_newest(hub: Any) -> None:
    view, tree = hub
    client, other = Client(view.connect()), Client(view.connect())
    assert (await client.update())["from"] == 0
    await other.update()
    for x in range(1, 6):
        move(tree, float(x))
        other.browser.ready()
        await other.update()  # each is an update of its own
    client.browser.ready()
    header = await client.update()
    assert header["revision"] == tree.snapshot.revision
    assert client.model.tree() == tree_of(tree.snapshot.root)
    client.browser.close()
    other.browser.close()
    assert view.status()["browsers"] == 0


async def test_an_empty_scene_is_told_too() -> None:
    view = ViewHub(QUICK, LiveTree())
    running = asyncio.create_task(view.run())
    client = Client(view.connect())
    assert "nodes" not in await client.update()
    client.browser.close()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def test_a_browser_that_hangs_keeps_no_scene_alive() -> None:
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_parts(("box",), (Part(Box((1, 1, 1)), Material()),))
    view = ViewHub(replace(QUICK, patience_seconds=0.0), tree)
    running = asyncio.create_task(view.run())
    client = Client(view.connect())
    assert (await client.update())["from"] == 0
    held = weakref.ref(tree.snapshot.root)
    with tree.edit() as edit:
        edit.delete(("box",))
        edit.set_parts(("ball",), (Part(Sphere(1.0), Material()),))

    def freed() -> bool:
        gc.collect()
        return held() is None

    await until(freed)
    client.browser.ready()
    assert (await client.update())["from"] == 0, "it starts over"
    assert client.model.tree() == tree_of(tree.snapshot.root)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def test_notes_tell_state_and_camera(hub: Any) -> None:
    view, tree = hub
    client = Client(view.connect())
    await client.update()
    assert client.notes["rig"]["pose"][12] == 0.0
    assert {"name": "queue", "value": 3} in client.notes["status"]["facts"]
    assert {"name": "viewers", "value": 0} in client.notes["status"]["facts"]
    move(tree, 2.5)
    assert (await client.note("rig"))["pose"][12] == 2.5
    view.renders.add(RenderNote(200, 0.1, 0.0, "color", "", "color", b"x", "image/png", ""))
    while (await client.note("status"))["renders"] != 1:
        pass
    client.browser.close()


async def test_browsers_are_bounded(hub: Any) -> None:
    view, _ = hub
    browsers = [view.connect() for _ in range(QUICK.max_browsers)]
    with pytest.raises(ConnectionRefusedError, match="max_browsers"):
        view.connect()
    browsers[0].close()
    view.connect()


async def test_frames_end_when_the_gateway_does() -> None:
    tree = LiveTree()
    view = ViewHub(QUICK, tree)
    running = asyncio.create_task(view.run())
    await asyncio.sleep(0)
    assert view.ready
    browser = view.connect()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert [parse(frame)[0]["kind"] async for frame in browser.frames()] == []
    assert not view.ready


async def test_a_client_that_edits_from_a_thread_is_seen(hub: Any) -> None:
    view, tree = hub
    client = Client(view.connect())
    await client.update()
    client.browser.ready()
    await asyncio.to_thread(move, tree, 7.0)
    await client.update()
    assert np.isclose(client.model.tree()["box",][2][0], 7.0)
    client.browser.close()
