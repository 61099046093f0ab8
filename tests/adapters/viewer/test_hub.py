"""Acknowledgements, status frames and limits."""

import asyncio
import gc
import threading
import weakref
from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gateway.adapters.viewer.browser import Browser, BrowserState
from gateway.adapters.viewer.config import ViewerConfig
from gateway.adapters.viewer.hub import ViewHub
from gateway.adapters.viewer.messages import Fact, PlacedRig, Status
from gateway.adapters.viewer.sources import StereoImages
from gateway.runtime.logs.render_record import RenderRecord
from gateway.scene.draw.cameras import LookAtCamera
from gateway.scene.page.live_page import ClickSubscriptions, LivePage
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.live import LiveTree, Snapshot
from renderers.drawlist import Material, Mesh
from tests.adapters.viewer.model import Model, add_box, box_tree, running, tree_of
from tests.support.view_frames import parse_frame
from tests.support.waiting import SECONDS, until

QUICK = ViewerConfig(max_update_rate=1000.0, status_seconds=0.01)


def move(tree: LiveTree, x: float) -> None:
    with tree.edit() as edit:
        edit.set_pose(("box",), (x, 0, 0, 1, 0, 0, 0))


class Client:
    """A page: receives frames, and acknowledges when the test says so."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser
        self.frames = browser.frames()
        self.model = Model()
        self.latest: dict[str, Any] = {}

    async def update(self) -> dict[str, Any]:
        """Receive up to the next update; return its header."""
        async with asyncio.timeout(SECONDS):
            async for frame in self.frames:
                header, _ = parse_frame(frame)
                if header["kind"] in ("status", "rig", "page", "light", "controls", "received"):
                    self.latest[header["kind"]] = header
                    continue
                self.model.receive(frame)
                if header["kind"] == "update":
                    return header
        raise AssertionError("the frames ended")

    async def next_frame(self, kind: str) -> dict[str, Any]:
        """Skip to the next frame of a kind; return its header."""
        async with asyncio.timeout(SECONDS):
            async for frame in self.frames:
                header, _ = parse_frame(frame)
                if header["kind"] == kind:
                    return header
        raise AssertionError("the frames ended")


class StereoOnBox:
    """A stereo camera at the pose of the node ``box``."""

    def rig(self, snapshot: Snapshot) -> PlacedRig | None:
        box = snapshot.root.find(("box",))
        assert box is not None
        pose = box.matrix.T.ravel().tolist()
        return PlacedRig(pose=pose, width=4, height=3, fx=2.0, fy=2.0, cx=2.0, cy=1.5, baseline=0.1)

    async def capture(self) -> StereoImages:
        raise NotImplementedError


@pytest.fixture
async def hub() -> AsyncIterator[tuple[ViewHub, LiveTree]]:
    tree = box_tree()
    hub = ViewHub(QUICK, tree, status=lambda: Status(facts=[Fact(name="queue", value=3)]), stereo=StereoOnBox())
    async with running(hub):
        await asyncio.sleep(0)
        yield hub, tree


async def test_browser_gets_only_the_newest_update_after_its_acknowledgement(hub: Any) -> None:
    view, tree = hub
    client, other = Client(view.connect()), Client(view.connect())
    assert (await client.update())["from"] == 0
    await other.update()
    for x in range(1, 6):
        move(tree, float(x))
        other.browser.acknowledge()
        await other.update()  # each is an update of its own
    client.browser.acknowledge()
    header = await client.update()
    assert header["revision"] == tree.snapshot.revision
    assert client.model.tree() == tree_of(tree.snapshot.root)
    client.browser.close()
    other.browser.close()
    assert view.status()["browsers"] == 0


async def test_stalled_browser_does_not_keep_its_snapshot_alive() -> None:
    tree = box_tree()
    async with running(ViewHub(replace(QUICK, ack_timeout_seconds=0.0), tree)) as view:
        client = Client(view.connect())
        assert (await client.update())["from"] == 0
        held = weakref.ref(tree.snapshot.root)
        with tree.edit() as edit:
            edit.delete(("box",))
        add_box(tree, "ball")

        def freed() -> bool:
            gc.collect()
            return held() is None

        await until(freed)
        client.browser.acknowledge()
        assert (await client.update())["from"] == 0, "the update is the whole scene"
        assert client.model.tree() == tree_of(tree.snapshot.root)


async def test_status_and_stereo_rig_are_sent_and_the_rig_again_only_if_it_moved(hub: Any) -> None:
    view, tree = hub
    client = Client(view.connect())
    await client.update()
    assert client.latest.pop("rig")["pose"][12] == 0.0
    assert {"name": "queue", "value": 3} in client.latest["status"]["facts"]
    assert {"name": "viewers", "value": 0} in client.latest["status"]["facts"]
    client.browser.acknowledge()
    add_box(tree, "ball")
    await client.update()
    assert "rig" not in client.latest
    client.browser.acknowledge()
    await asyncio.to_thread(move, tree, 2.5)  # edits of other threads are sent, too
    assert (await client.next_frame("rig"))["pose"][12] == 2.5
    await client.update()
    assert client.model.tree()["box",][2][0] == 2.5


async def test_the_status_counts_render_requests() -> None:
    renders: list[RenderRecord] = []
    async with running(ViewHub(QUICK, LiveTree(), renders=renders)) as view:
        client = Client(view.connect())
        assert "renders" not in await client.next_frame("status")
        renders.append(RenderRecord(7, 0.0, 200, 0.1, 0.0, "color", "", "color", b"x", "image/png", ""))
        while (await client.next_frame("status")).get("renders") != 7:
            pass


async def test_updates_between_two_status_frames_send_none() -> None:
    asked: list[None] = []

    def status() -> Status:
        asked.append(None)
        return Status()

    tree = box_tree()
    hub = ViewHub(replace(QUICK, status_seconds=3600.0), tree, status=status)
    async with running(hub):
        client = Client(hub.connect())
        counts = []
        for x in (1.0, 2.0, 3.0):  # the first may come before the status of the start
            await client.update()
            client.browser.acknowledge()
            counts.append(len(asked))
            move(tree, x)
    assert counts[2] == counts[1]


async def test_frames_end_when_the_hub_is_cancelled() -> None:
    async with running(ViewHub(QUICK, LiveTree())) as view:
        await asyncio.sleep(0)
        assert view.ready
        browser = view.connect()
    assert [parse_frame(frame)[0]["kind"] async for frame in browser.frames()] == []
    assert not view.ready


async def test_pages_drop_meshes_that_were_deleted(hub: Any) -> None:
    view, tree = hub
    client = Client(view.connect())
    await client.update()
    client.browser.acknowledge()
    meshes = set(client.model.meshes)
    mesh = Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.uint32))
    with tree.edit() as edit:
        edit.set_parts(("triangle",), (Part(Surface(mesh), Material()),))
    await client.update()
    client.browser.acknowledge()
    (number,) = client.model.meshes - meshes
    del mesh
    with tree.edit() as edit:
        edit.delete(("triangle",))
    await client.update()
    client.browser.acknowledge()
    gc.collect()
    assert (await client.next_frame("forget"))["meshes"] == [number]


async def test_settings_of_the_page_are_sent_when_they_change_and_to_later_pages() -> None:
    page, now = LivePage(), [0.0]
    page.clicks = ClickSubscriptions(clock=lambda: now[0])
    async with running(ViewHub(QUICK, LiveTree(), live_page=page)) as hub:
        client = Client(hub.connect())
        unset: dict[str, Any] = {"background": None, "grid": None, "home": None, "clickable": []}
        assert await client.next_frame("page") == {"kind": "page", **unset}
        page.change_view({"background": (1.0, 0.5, 0.0), "grid": False, "home": LookAtCamera((1, 2, 3), (0, 0, 0))})
        frame = await client.next_frame("page")
        assert (frame["background"], frame["grid"]) == ([1.0, 0.5, 0.0], False)
        assert frame["home"] == {"eye": [1, 2, 3], "target": [0, 0, 0], "up": [0, 0, 1]}
        page.clicks.subscribe("client", [("a", 1)], print)
        page.notify()
        frame = await client.next_frame("page")
        assert (frame["clickable"], frame["grid"]) == ([["a", 1]], False)
        assert await Client(hub.connect()).next_frame("page") == frame
        now[0] = 1e6  # the client has vanished
        assert (await client.next_frame("page"))["clickable"] == []


@pytest.mark.parametrize(("limit", "threads"), [(0, 1), (1 << 40, 0)])
async def test_large_meshes_are_encoded_in_a_thread(
    hub: Any, limit: int, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.adapters.viewer.browser.LARGE_MESH_BYTES", limit)
    view, _ = hub
    used: list[object] = []
    encode = view.resources.mesh_frame

    def mesh_frame(mesh_id: int) -> Any:
        used.append(threading.current_thread())
        return encode(mesh_id)

    monkeypatch.setattr(view.resources, "mesh_frame", mesh_frame)
    client = Client(view.connect())
    await client.update()
    client.browser.close()
    assert len([thread for thread in used if thread is not threading.current_thread()]) == threads
    assert len(used) == 1


async def test_an_error_in_the_status_ends_the_hub() -> None:
    problems: list[str] = []

    def status() -> Status:
        if problems:
            raise RuntimeError(problems[0])
        return Status()

    hub = ViewHub(QUICK, LiveTree(), status=status)
    browser = hub.connect()
    problems.append("no status")
    with pytest.raises(RuntimeError, match="no status"):
        async with asyncio.timeout(SECONDS):
            await hub.run()
    assert not hub.ready
    assert browser.state is BrowserState.CLOSED
