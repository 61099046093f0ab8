"""Controls of the client with the service over TCPQ. ``change`` and ``deliver_values`` stand for a page."""

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.protocol import RESPONSE
from gateway.adapters.treeviewer.responses import ReadyMessage, encode
from gateway.adapters.treeviewer.service import TreeViewerService
from gateway.runtime.lcm.config import LcmConfig
from gateway.scene.page.control_store import ControlStore
from gateway.scene.tree.live import LiveTree
from scenegate import AsyncTreeViewer, Box, TreeViewer, TreeViewerError
from scenegate.messages.controls import Pose
from tests.adapters.treeviewer.transports import serving
from tests.client.conftest import connected, hub_of, in_thread, talk_to
from tests.support.ports import free_ports
from tests.support.waiting import SECONDS, until

pytestmark = [pytest.mark.lcm, pytest.mark.usefixtures("lcm")]

MOVED = {"translation": [1, 2, 3], "quaternion": [1, 0, 0, 0]}


def store_of(service: TreeViewerService) -> ControlStore:
    return service.protocol.page.controls


def shown(service: TreeViewerService) -> dict[str, Any]:
    """Return the values in the page, by path."""
    controls = store_of(service).controls_since(0) or ()
    return {"/".join(map(str, each["path"])): each["value"] for each in controls}


def change(service: TreeViewerService, path: str, *values: Any) -> None:
    """Change a value as a page does."""
    controls = store_of(service).controls_since(0) or ()
    (control_id,) = [each["id"] for each in controls if "/".join(map(str, each["path"])) == path]
    for value in values:
        store_of(service).change(control_id, value)
    store_of(service).deliver_values()


async def test_a_refused_value_is_not_kept() -> None:

    def talk(viewer: TreeViewer) -> None:
        slider = viewer.controls.add_slider("speed", 0, 10, value=2)
        slider.delete()
        with pytest.raises(TreeViewerError):
            slider.value = 5
        assert slider.value == 2

    async with serving() as service:
        await talk_to(service, talk)


async def test_all_controls_are_shown() -> None:
    async with serving() as service:

        def talk(viewer: TreeViewer) -> None:
            arm = viewer.controls["arm"]
            two: Any = np.float32(2)  # programs have NumPy's numbers
            arm.add_slider("speed", 0, 10, value=two, step=0.5, unit="m/s")
            arm.add_number("gains/p", 3, min=0)
            arm.add_text(("gains", "a/b"), "x")
            viewer.controls.add_checkbox("on", True)
            viewer.controls.add_dropdown("mode", ["a", "b"], "b")
            viewer.controls.add_color("paint", "red").value = (0, 0, 1)
            viewer.controls.add_button("go")
            plot = viewer.controls.add_plot("loads", "1", "2")
            viewer.controls.add_gizmo("target", "arm/hand")
            plot.add(1.0, float("nan"), time_s=5.0)
            plot.add_samples([6.0, 7.0], np.ones((2, 2)))
            with pytest.raises(ValueError, match="value is 11, it must be from 0 to 10"):
                arm.add_slider("speed", 0, 10, value=11)
            with pytest.raises(ValueError, match=r"values \(N, 2\), not \(1,\) and \(1, 1\)"):
                plot.add(1.0)
            assert shown(service) == {
                "arm/speed": 2.0,
                "arm/gains/p": 3.0,
                "arm/gains/a/b": "x",
                "on": True,
                "mode": "b",
                "paint": (0.0, 0.0, 1.0),
                "go": 0,
                "loads": None,
                "target": None,
            }
            ((_, samples),) = store_of(service).samples_since(0)
            np.testing.assert_array_equal(samples, [[5, 1, np.nan], [6, 1, 1], [7, 1, 1]])
            arm["gains"].delete()
            plot.delete()
            assert shown(service).keys() == {"arm/speed", "on", "mode", "paint", "go", "target"}

        await talk_to(service, talk)
        await until(lambda: not shown(service))  # the client has closed


def fail_in_batch(viewer: TreeViewer) -> None:
    with viewer.controls.batch():
        viewer.controls.add_button("other")
        with viewer.controls.batch():
            pass


async def test_a_batch_of_controls_is_one_request() -> None:
    async with serving() as service:

        def talk(viewer: TreeViewer) -> None:
            viewer.controls.add_button("go")
            before = store_of(service).revision
            with viewer.controls.batch():
                sliders = [viewer.controls["many"].add_slider(str(number), 0, 1) for number in range(500)]
                viewer.controls["many"]["7"].delete()
                assert store_of(service).revision == before  # nothing is sent
            assert shown(service).keys() == {"go", *(f"many/{number}" for number in range(500) if number != 7)}
            sliders[1].value = 0.5
            assert shown(service)["many/1"] == 0.5
            with pytest.raises(RuntimeError, match="a batch of controls is open already"):
                fail_in_batch(viewer)
            viewer.controls.add_checkbox("on")
            assert shown(service).keys() >= {"go", "on"}
            assert "other" not in shown(service)

        await talk_to(service, talk)


async def test_wrong_arguments_are_refused() -> None:
    async with serving() as service:

        def talk(viewer: TreeViewer) -> None:
            add: Any = viewer.controls
            cases: tuple[tuple[Callable[[], Any], str], ...] = (
                (lambda: add.add_dropdown("d", "abc"), 'options must be a list of texts, not "abc"'),
                (lambda: add.add_dropdown("d", 5), "options must be a list of texts, not 5"),
                (lambda: add.add_plot("p", ["a", "b"]), r'series must be a text, not \["a", "b"\]'),
                (lambda: add.add_plot("p", "a", seconds="1"), 'seconds must be a number .*, not "1"'),
                (lambda: add.add_button(None), "a path must be a text, an integer or a tuple of them, not None"),
                (lambda: add.add_gizmo("g", None), "a path must be a text, an integer or a tuple of them, not None"),
                (lambda: add.add_slider("s", None, 1), "min must be a number of at most 1e\\+15, not null"),
                (lambda: add.add_slider("s", 0, 1, step="x"), 'step must be a number of at most 1e\\+15, not "x"'),
                (lambda: add.add_slider("s", 0, 1, unit=5), "unit must be a text, not 5"),
                (lambda: add.add_joint_sliders(5), "robot must be the result of TreeViewer.robot, not 5"),
            )
            for call, sentence in cases:
                with pytest.raises(ValueError, match=sentence):
                    call()
            assert shown(service) == {}

        await talk_to(service, talk)


async def test_values_of_the_page_arrive() -> None:
    live = LiveTree()
    async with serving(live=live) as service, connected(service) as viewer:
        received: list[Any] = []
        speed = await in_thread(viewer.controls.add_slider, "speed", 0, 10)
        go = await in_thread(viewer.controls.add_button, "go")
        await in_thread(viewer["box"].set, Box((1, 1, 1)))
        gizmo = await in_thread(viewer.controls.add_gizmo, "target", "box")
        stop = speed.on_update(received.append)
        also: list[str] = []
        go.on_click(lambda: also.append("go"))
        go.on_click(lambda: received.append("go"))
        gizmo.on_update(lambda pose: received.append(pose[:3, 3].tolist()))
        assert gizmo.value is None
        change(service, "speed", 2.0, 3.0)
        await until(lambda: received == [3.0])
        change(service, "go", None, None)
        await until(lambda: received == [3.0, "go", "go"])
        assert also == ["go", "go"]
        change(service, "target", MOVED)
        await until(lambda: received[3:] == [[1, 2, 3]])
        assert (speed.value, go.value) == (3.0, 2)
        with pytest.raises(ValueError, match="set the node's transform"):
            gizmo.value = np.eye(4)
        stop()
        change(service, "speed", 4.0)
        await until(lambda: speed.value == 4.0)
        assert len(received) == 4
        assert service.status()["control_messages"] == 4


async def test_a_value_that_the_program_sets_is_shown_and_wins_over_earlier_ones() -> None:
    async with serving() as service, connected(service) as viewer:
        received: list[Any] = []
        speed = await in_thread(viewer.controls.add_slider, "speed", 0, 10)
        speed.on_update(received.append)
        change_is_late = store_of(service)
        change_is_late.change(1, 3.0)  # not delivered yet
        await in_thread(speed.set, 5)
        assert shown(service) == {"speed": 5.0}
        change_is_late.deliver_values()
        change(service, "speed", 6.0)
        await until(lambda: received == [6.0])
        with pytest.raises(ValueError, match="value is 11, it must be from 0 to 10"):
            await in_thread(speed.set, 11)
        assert speed.value == 6.0


async def test_outdated_and_invalid_messages_are_ignored() -> None:
    async with serving() as service, connected(service) as viewer:
        speed = await in_thread(lambda: viewer.controls.add_slider("speed", 0, 10, value=5))
        panel = viewer.controls.panel
        value = {"path": ["speed"], "value": 7}
        for body in (
            {"controls": [value], "after": speed.set_time - 1},
            {"controls": [{"path": ["speed"], "value": 70}], "after": 2**60},
            {"controls": [{"path": ["other"], "value": 7}], "after": 2**60},
            {"controls": [value]},
            {"controls": 3, "after": 2**60},
        ):
            panel.receive(body)
        assert speed.value == 5.0
        panel.receive({"controls": [value], "after": speed.set_time})
        assert speed.value == 7.0


async def test_slow_callbacks_miss_values_in_between_only() -> None:
    received: list[float] = []
    async with serving() as service, connected(service) as viewer:
        speed = await in_thread(viewer.controls.add_slider, "speed", 0, 10)

        def slow(value: float) -> None:
            received.append(value)
            if value == 1.0:
                change_all.result(SECONDS)

        speed.on_update(slow)
        loop = asyncio.get_running_loop()
        change_all: Any = asyncio.run_coroutine_threadsafe(wait_for(received), loop)
        change(service, "speed", 1.0)
        await until(lambda: received == [1.0])
        for value in (2.0, 3.0, 4.0):
            change(service, "speed", value)
            await until(lambda: speed.value == value)  # noqa: B023 - awaited in the same iteration
        received.append(0.0)
        await until(lambda: received == [1.0, 0.0, 4.0])


async def wait_for(received: list[float]) -> None:
    await until(lambda: 0.0 in received)


async def test_async_client() -> None:
    received: list[Any] = []
    async with serving() as service, AsyncTreeViewer(hub_of(service), timeout=SECONDS) as viewer:
        folder = viewer.controls["arm"]
        speed = await folder.add_slider("speed", 0, 10)
        go = await folder.add_button("go")
        plot = await folder.add_plot("loads", "a")
        await plot.add(1.0)
        gizmo = await viewer.controls.add_gizmo("target", "arm/hand")
        with pytest.raises(ValueError, match="set the node's transform"):
            await gizmo.set(np.eye(4))
        await gizmo.delete()

        async def stop(value: float) -> None:
            received.append(value)
            await speed.set(0.0)

        speed.on_update(stop)
        go.on_click(lambda: received.append("go"))
        change(service, "arm/speed", 5.0)
        await until(lambda: shown(service)["arm/speed"] == 0.0)
        change(service, "arm/go", None)
        await until(lambda: received == [5.0, "go"])
        assert (speed.value, speed.path) == (0.0, ("arm", "speed"))
        await speed.delete()
        await folder.delete()
        assert shown(service) == {}


async def test_controls_that_are_added_while_a_viewer_starts_are_kept() -> None:
    async with serving() as service, connected(service) as viewer:
        hub = service.hub
        assert hub is not None

        def add() -> None:
            for number in range(30):
                viewer.controls.add_button(str(number))

        adding = asyncio.create_task(in_thread(add))
        while not adding.done():
            hub.publish(RESPONSE, encode(ReadyMessage()))
            await asyncio.sleep(0)
        await adding
        await in_thread(viewer["box"].set, Box((1, 1, 1)))  # after all requests so far
        assert len(shown(service)) == 30


async def test_a_restarted_viewer_gets_controls_with_their_values() -> None:
    (port,) = free_ports(1)
    config = TreeViewerConfig(lcm=LcmConfig(url="off", tcpq_port=port))
    async with serving(config) as service:
        viewer: Any = await in_thread(TreeViewer, f"tcpq://127.0.0.1:{port}", SECONDS)
        await in_thread(viewer["box"].set, Box((1, 1, 1)))
        speed = await in_thread(viewer.controls.add_slider, "speed", 0, 10)
        gizmo = await in_thread(viewer.controls.add_gizmo, "target", "box")
        change(service, "speed", 7.0)
        change(service, "target", MOVED)
        await until(lambda: speed.value == 7.0 and gizmo.value is not None)
        assert gizmo.raw_value == Pose((1, 2, 3), (1, 0, 0, 0))
    live = LiveTree()
    try:
        async with serving(config, live=live) as service:
            await until(lambda: shown(service) == {"speed": 7.0, "target": None})
            await until(lambda: live.snapshot.root.find(("box",)) is not None)
            assert live.snapshot.root.children["box"].pose == (1, 2, 3, 1, 0, 0, 0)
    finally:
        await in_thread(viewer.close)


async def test_controls_of_a_program_that_dies_are_removed() -> None:
    async with serving() as service:
        url = hub_of(service)
        alive, dying = [await in_thread(lambda: TreeViewer(url, timeout=SECONDS)) for _ in range(2)]
        for viewer, name in ((alive, "here"), (dying, "gone")):
            await in_thread(viewer.controls.add_button, name)
            await in_thread(viewer.on_click, name, print)
        dying.requests.connection.close()  # without a last message
        await until(lambda: shown(service).keys() == {"here"})
        assert service.protocol.page.clicks.paths() == (("here",),)
        await in_thread(alive.close)
