"""The client's visibility, opacity, page view and clicks, with the service over TCPQ and UDP."""

import asyncio
import logging
from functools import partial
from typing import Any

import numpy as np
import pytest

from gateway.adapters.treeviewer import request_reader
from gateway.adapters.treeviewer.commands import COMMANDS
from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.runtime.lcm.config import LcmConfig
from gateway.scene.draw.cameras import LookAtCamera
from gateway.scene.page.control_store import ControlStore
from gateway.scene.page.live_page import ClickSubscriptions, PageView
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node
from scenegate import AsyncTreeViewer, Box, Click, TreeViewer, TreeViewerError
from scenegate.tree import callbacks
from tests.adapters.treeviewer.transports import free_url, join, serving
from tests.client.conftest import connected, hub_of, in_thread, talk_to
from tests.support.ports import free_ports
from tests.support.waiting import SECONDS, until

pytestmark = [pytest.mark.lcm, pytest.mark.usefixtures("lcm")]

ON_ARM = Click(("robot", "arm"), (1.0, 2.0, 3.0), "left")


def node(live: LiveTree, *path: str) -> Node:
    found = live.snapshot.root.find(path)
    assert found is not None
    return found


async def test_visibility_and_opacity() -> None:
    live = LiveTree()

    def talk(viewer: TreeViewer) -> None:
        viewer["robot"]["arm"].set(Box((1, 1, 1)))
        assert viewer["robot"].set_visible(False).status == 0
        with viewer.batch() as batch:
            batch["robot/arm"].set_opacity(0.25)
            batch["robot/arm"].set_visible(True)
        with pytest.raises(ValueError, match="opacity must be from 0 to 1, not 2"):
            viewer["robot"].set_opacity(2)

    async with serving(live=live) as service:
        await talk_to(service, talk)
        robot, arm = node(live, "robot"), node(live, "robot", "arm")
        assert (robot.visible, robot.opacity, arm.visible, arm.opacity) == (False, 1.0, True, 0.25)


async def test_many_transforms() -> None:
    live = LiveTree()

    def talk(viewer: TreeViewer) -> None:
        for name in ("a/b", "c"):
            viewer[name].set(Box((1, 1, 1)))
        answer = viewer.set_transforms(["a/b", ("c",)], [[1, 2, 3, 1, 0, 0, 0], [4, 5, 6, 0, 1, 0, 0]])
        assert (answer.status, answer.transformed) == (0, (("a", "b"), ("c",)))
        assert viewer.set_transforms([], []).transformed == ()
        with viewer.batch() as batch:
            batch.set_transforms(["c"], np.full((1, 7), 0.5))
        with pytest.raises(ValueError, match=r"poses .*\(1, 7\).*\(7,\)"):
            viewer.set_transforms(["c"], np.zeros(7))
        with pytest.raises(TypeError, match="paths must be a list of paths, not 'c'"):
            viewer.set_transforms("c", np.zeros((1, 7)))
        with pytest.raises(ValueError, match="pose 0 has a quaternion of zeros"):
            viewer.set_transforms(["c"], np.zeros((1, 7)))
        with pytest.raises(ValueError, match="pose 1 is not finite"):
            viewer.set_transforms(["a/b", "c"], np.array([[0.0] * 7, [np.inf] * 7]))

    async with serving(live=live) as service:
        await talk_to(service, talk)
    assert node(live, "a", "b").pose == (1, 2, 3, 1, 0, 0, 0)
    assert node(live, "c").pose == (0.5,) * 7


async def test_settings_of_the_page() -> None:

    def talk(viewer: TreeViewer) -> None:
        viewer.set_view(background="#ff0000", grid=False)
        viewer.set_view(home=((1, 2, 3), (0, 0, 0)), grid=None)
        with pytest.raises(TypeError, match="grid must be True, False or None, not 'no'"):
            viewer.set_view(grid="no")  # type: ignore[arg-type]  # wrong on purpose
        with pytest.raises(ValueError, match=r"home .*eye, target"):
            viewer.set_view(home=((1, 2, 3),))
        with pytest.raises(ValueError, match=r"eye of home .*\[nan, 0.0, 0.0\]"):
            viewer.set_view(home=((float("nan"), 0, 0), (0, 0, 0)))
        with pytest.raises(TreeViewerError, match=r"setview\[0\]: home.eye and home.target"):
            viewer.set_view(home=((0, 0, 0), (0, 0, 0)))

    async with serving() as service:
        await talk_to(service, talk)
        home = LookAtCamera((1, 2, 3), (0, 0, 0), (0, 0, 1))
        assert service.protocol.page.view == PageView((1.0, 0.0, 0.0), None, home)


@pytest.mark.parametrize("transport", ["tcpq", "udp"])
@pytest.mark.parametrize("binary", [True, False])
async def test_clicks(transport: str, binary: bool) -> None:
    url = free_url()
    if transport == "udp":
        join(url)
    lcm = LcmConfig(url="off", tcpq_port=0) if transport == "tcpq" else LcmConfig(url=url, tcpq_port=None)
    received: asyncio.Queue[Click] = asyncio.Queue()
    loop = asyncio.get_running_loop()
    async with serving(TreeViewerConfig(lcm=lcm)) as service:
        page = service.protocol.page
        viewer = await in_thread(
            lambda: TreeViewer(hub_of(service) if transport == "tcpq" else url, timeout=SECONDS, binary=binary)
        )

        def on_click(click: Click) -> None:
            viewer[click.path].set(Box((1, 1, 1)))  # callbacks may use the client
            loop.call_soon_threadsafe(received.put_nowait, click)

        stop = await in_thread(viewer.on_click, "robot", on_click)
        assert page.clicks.paths() == (("robot",),)
        page.clicks.click(ON_ARM)
        async with asyncio.timeout(SECONDS):
            assert await received.get() == Click(("robot", "arm"), (1.0, 2.0, 3.0), "left")
        assert service.status()["clicks"] == 1
        await in_thread(stop)
        assert page.clicks.paths() == ()
        await in_thread(viewer.on_click, (), on_click)
        await in_thread(viewer.close)
        await until(lambda: page.clicks.paths() == ())


async def test_a_callback_that_fails_does_not_end_the_others(caplog: pytest.LogCaptureFixture) -> None:
    received: list[Click] = []
    async with serving() as service, connected(service) as viewer:
        await in_thread(viewer.on_click, "robot", lambda click: [][0])
        await in_thread(viewer.on_click, "robot/arm", received.append)
        with caplog.at_level(logging.ERROR, "scenegate.tree.callbacks"):
            service.protocol.page.clicks.click(ON_ARM)
            await until(lambda: received)
    assert "A callback of the tree viewer has failed" in caplog.text
    assert [click.path for click in received] == [("robot", "arm")]


async def test_callbacks_that_cannot_be_called_are_refused() -> None:
    async def coroutine(argument: object) -> None:
        raise AssertionError(argument)

    def talk(viewer: Any) -> None:
        button = viewer.controls.add_button("go")
        for listen in (partial(viewer.on_click, "robot"), button.on_update, button.on_click):
            with pytest.raises(TypeError, match=r"coroutine.* AsyncTreeViewer"):
                listen(coroutine)
            with pytest.raises(TypeError, match="must be a function, not None"):
                listen(None)

    async with serving() as service:
        await talk_to(service, talk)
        assert service.protocol.page.clicks.paths() == ()


async def test_async_client() -> None:
    received: list[Click] = []
    live = LiveTree()
    async with serving(live=live) as service:
        page = service.protocol.page
        async with AsyncTreeViewer(hub_of(service), timeout=SECONDS) as viewer:
            await viewer["robot"]["arm"].set(Box((1, 1, 1)))
            await viewer["robot"].set_visible(False)
            await viewer["robot"].set_opacity(0.5)
            await viewer.set_view(grid=True)
            stop = await viewer.on_click("robot/arm", received.append)
            page.clicks.click(ON_ARM)
            await until(lambda: received)
            await stop()

            async def hide(click: Click) -> None:
                await viewer[click.path].set_visible(False)

            stop = await viewer.on_click("robot/arm", hide)
            page.clicks.click(ON_ARM)
            await until(lambda: not node(live, "robot", "arm").visible)
            await stop()
            with pytest.raises(TypeError, match="must be a function, not 'hide'"):
                await viewer.on_click("robot/arm", "hide")  # type: ignore[arg-type]  # refused at run time
            assert page.clicks.paths() == ()
        assert (node(live, "robot").visible, node(live, "robot").opacity) == (False, 0.5)
        assert page.view == PageView(grid=True)


async def test_subscriptions_and_controls_are_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(callbacks, "RESEND_SECONDS", 0.01)
    async with serving() as service:
        page = service.protocol.page
        viewer: Any = await in_thread(lambda: TreeViewer(hub_of(service), timeout=SECONDS))
        await in_thread(viewer.on_click, "robot", print)
        await in_thread(viewer.controls.add_button, "go")
        page.clicks, page.controls = ClickSubscriptions(), ControlStore()  # as if the leases had ended
        await until(lambda: page.clicks.paths() == (("robot",),) and page.controls.controls_since(0))
        await in_thread(viewer.close)
        await until(lambda: not page.clicks.paths() and not page.controls.controls_since(0))
        assert not viewer.requests.pending


async def test_a_restarted_viewer_gets_all_again() -> None:
    (port,) = free_ports(1)
    config = TreeViewerConfig(lcm=LcmConfig(url="off", tcpq_port=port))
    async with serving(config):
        viewer: Any = await in_thread(TreeViewer, f"tcpq://127.0.0.1:{port}", SECONDS)
        await in_thread(viewer["robot"].set, Box((1, 1, 1)))
        await in_thread(viewer["robot"].set_visible, False)
        await in_thread(viewer["robot"].set_opacity, 0.5)
        await in_thread(lambda: viewer.set_view(grid=False))
        await in_thread(viewer.on_click, "robot", print)
    live = LiveTree()
    try:
        async with serving(config, live=live) as service:
            page = service.protocol.page
            await until(lambda: page.clicks.paths() == (("robot",),))
            await until(lambda: page.view == PageView(grid=False) and live.snapshot.root.find(("robot",)) is not None)
            robot = node(live, "robot")
            assert (robot.visible, robot.opacity, robot.nodes_with_parts) == (False, 0.5, 1)
            assert (await in_thread(viewer["robot"].transform, (1, 2, 3))).status == 0
    finally:
        await in_thread(viewer.close)


async def test_an_older_viewer_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    known = {name: command for name, command in COMMANDS.items() if not command.is_newer}
    monkeypatch.setattr(request_reader, "COMMANDS", known)
    live = LiveTree()

    def talk(viewer: TreeViewer) -> None:
        viewer["robot"].set(Box((1, 1, 1)))
        with pytest.raises(TreeViewerError, match="this viewer does not know setproperty"):
            viewer["robot"].set_visible(False)
        with pytest.raises(TreeViewerError, match="this viewer does not know setclicks"):
            viewer.on_click("robot", print)
        with pytest.raises(TreeViewerError, match="this viewer does not know setcontrols"):
            viewer.controls.add_button("go")
        assert viewer.controls.panel.definitions() == []

    async with serving(live=live) as service:
        await talk_to(service, talk)
        assert node(live, "robot").visible
