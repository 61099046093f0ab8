"""The time of a page: paused while the scene goes on, at a moment of the history, playing, live again; and of a log."""

import asyncio
from collections.abc import AsyncIterator
from math import nan
from typing import Any

import pytest

from gateway.adapters.viewer.browser import Browser
from gateway.adapters.viewer.hub import ViewHub
from gateway.adapters.viewer.messages import PlacedRig, TimeCommand
from gateway.replay.history import TreeHistory
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.nodes import Node, TreeEdit
from gateway.scene.tree.timeline import state_at
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.adapters.viewer.model import Model, running, tree_of
from tests.adapters.viewer.recordings import SECOND, States
from tests.adapters.viewer.test_hub import QUICK, StereoOnBox, move
from tests.support.view_frames import parse_frame
from tests.support.waiting import SECONDS


class Page:
    """A page that acknowledges each update at once."""

    def __init__(self, browser: Browser, name: str = "box") -> None:
        self.browser = browser
        self.name = name
        self.model = Model()
        self.time: dict[str, Any] = {}
        self.kinds: list[str] = []
        self._frames = browser.frames()

    @property
    def x(self) -> float:
        """Position of the node with the name; nan if there is none."""
        box = next((node for node in self.model.nodes.values() if node.name == self.name), None)
        return nan if box is None else box.pose[12 if len(box.pose) == 16 else 0]

    def send(self, time: Any, **fields: Any) -> None:
        self.browser.execute(TimeCommand(time, **fields))

    async def until(self, condition: Any) -> None:
        async with asyncio.timeout(SECONDS):
            while not condition():
                frame = await anext(self._frames)
                header = parse_frame(frame)[0]
                self.kinds.append(header["kind"])
                if header["kind"] == "time":
                    self.time = header
                elif header["kind"] in ("update", "mesh", "forget"):
                    self.model.receive(frame)
                    self.browser.acknowledge()


def moved_box(x: float) -> Snapshot:
    """Return a state with a box at x, ``x`` seconds after the log's begin."""
    edit = TreeEdit(Node())
    edit.set_parts(("box",), (Part(Box((1, 1, 1)), Material()),))
    edit.set_pose(("box",), (x, 0, 0, 1, 0, 0, 0))
    return Snapshot(edit.commit(), round(x) + 1, round((1000 + x) * SECOND))


class Log(States):
    """A timeline without a live end, which can be slow or fail."""

    def __init__(self, snapshots: list[Snapshot]) -> None:
        super().__init__(snapshots)
        self.looked_for: list[int] = []
        self.gate = asyncio.Event()
        self.gate.set()
        self.problem: Exception | None = None

    async def snapshot_at(self, time: int) -> Snapshot:
        if self.problem is not None:
            raise self.problem
        found = await super().snapshot_at(time)
        self.looked_for.append(found.revision - 1)
        await self.gate.wait()
        return found


class Stereo(StereoOnBox):
    """A stereo camera on the box, if there is one."""

    def rig(self, snapshot: Snapshot) -> PlacedRig | None:
        return super().rig(snapshot) if snapshot.root.find(("box",)) is not None else None


class Scene:
    """A live tree with a history."""

    def __init__(self) -> None:
        self.now = 500 * SECOND
        self.tree = LiveTree(lambda: self.now)
        self.history = TreeHistory(self.tree, 60.0, 1 << 28, asyncio.to_thread, lambda: self.now)
        self.hub = ViewHub(QUICK, self.tree, timeline=self.history, stereo=Stereo())
        with self.tree.edit() as edit:
            edit.set_parts(("box",), (Part(Box((1, 1, 1)), Material()),))
        self.history.record()

    def move(self, x: float, seconds: float = 1.0) -> None:
        self.now += round(seconds * SECOND)
        move(self.tree, x)
        self.history.record()

    def seconds(self, before: float = 0.0) -> float:
        return self.now / SECOND - before


@pytest.fixture
async def scene() -> AsyncIterator[Scene]:
    scene = Scene()
    async with running(scene.hub):
        yield scene


@pytest.fixture
async def log() -> Log:
    return Log([moved_box(x) for x in range(11)])


@pytest.fixture
async def log_page(log: Log) -> AsyncIterator[Page]:
    async with running(ViewHub(QUICK, LiveTree(), timeline=log, has_live=False)) as hub:
        yield Page(hub.connect())


async def test_a_paused_page_stays_while_the_scene_goes_on(scene: Scene) -> None:
    page, other = Page(scene.hub.connect()), Page(scene.hub.connect())
    scene.move(1.0)
    await page.until(lambda: page.x == 1.0)
    page.send("pause")
    await page.until(lambda: page.time["mode"] == "paused")
    for x in (2.0, 3.0, 4.0):
        scene.move(x)
    await other.until(lambda: other.x == 4.0)
    await page.until(lambda: page.time["last"] == scene.seconds())
    assert (page.x, page.time["position"]) == (1.0, scene.seconds(3.0))
    page.send("live")
    await page.until(lambda: page.x == 4.0 and page.time["mode"] == "live")
    assert page.model.tree() == tree_of(scene.tree.snapshot.root)
    scene.move(5.0)
    await page.until(lambda: page.x == 5.0)


async def test_seeking_shows_each_moment_with_its_camera(scene: Scene) -> None:
    page = await page_of(scene)
    for before, expected in ((3.5, 4.0), (7.2, 0.0), (0.1, 7.0), (400.0, 0.0)):
        del page.kinds[:]
        page.send("seek", at=scene.seconds(before))
        await page.until(lambda x=expected: page.x == x)
        assert "rig" in page.kinds, "the stereo camera is on the box"
    assert page.time["mode"] == "paused"


async def page_of(scene: Scene, moves: int = 8) -> Page:
    """Return a page of a box that has moved by 1 m a second."""
    for x in range(1, moves + 1):
        scene.move(float(x))
    page = Page(scene.hub.connect())
    await page.until(lambda: "update" in page.kinds)
    return page


async def test_a_time_before_the_history_shows_the_oldest_state_and_a_sentence(scene: Scene) -> None:
    """As of an address that was shared long ago."""
    page = await page_of(scene)
    page.send("seek", at=scene.seconds(400.0))
    await page.until(lambda: page.x == 0.0 and page.time.get("mode") == "paused")
    assert page.time["problem"] == "That time is older than what is kept: this is the oldest state"
    page.send("seek", at=scene.seconds(2.5))
    await page.until(lambda: page.x == 5.0 and not page.time["problem"])


async def test_seeks_by_seconds_add_up(scene: Scene) -> None:
    page = await page_of(scene)
    for _ in range(3):
        page.send("seek", by=-1.0)
    await page.until(lambda: page.time["mode"] == "paused" and page.x == 5.0)
    assert page.time["position"] == scene.seconds(3.0)
    page.send("seek", by=2.0)
    await page.until(lambda: page.x == 7.0)
    page.send("seek", by=1.0)
    await page.until(lambda: page.time["mode"] == "live" and page.x == 8.0)
    page.send("seek", by=-1e10)
    await page.until(lambda: page.x == 0.0 and page.time["position"] == page.time["first"])


async def test_steps_stop_at_each_change(scene: Scene) -> None:
    for x in range(1, 6):
        scene.move(float(x), seconds=0.004 * x)
    page = Page(scene.hub.connect())
    await page.until(lambda: "update" in page.kinds)
    for steps, expected in ((-1, 4.0), (-1, 3.0), (-1, 2.0), (1, 3.0), (1, 4.0), (1, 5.0)):
        page.send("step", steps=steps)
        await page.until(lambda x=expected: page.x == x)
    page.send("step", steps=1)
    scene.move(6.0)
    await page.until(lambda: page.x == 6.0 or page.time["last"] == scene.seconds())
    assert page.time["mode"] == "paused"


async def test_playing_catches_up_with_the_live_scene(scene: Scene) -> None:
    scene.move(1.0)
    page = Page(scene.hub.connect())
    page.send("seek", at=scene.seconds(0.05))
    await page.until(lambda: page.time.get("mode") == "paused" and page.x == 0.0)
    page.send("play", rate=10.0)
    await page.until(lambda: page.time["mode"] == "live" and page.x == 1.0)
    assert page.time["rate"] == 10.0


async def test_a_page_keeps_a_moment_that_the_history_has_dropped(scene: Scene) -> None:
    scene.move(1.0)
    page = Page(scene.hub.connect())
    await page.until(lambda: page.model.tree() and page.x == 1.0)
    page.send("pause")
    await page.until(lambda: page.time["mode"] == "paused")
    scene.now += 120 * SECOND
    with scene.tree.edit() as edit:
        edit.delete(("box",))
        edit.set_parts(("ball",), (Part(Box((2, 2, 2)), Material()),))
    scene.history.record()
    await page.until(lambda: page.time["position"] < page.time["first"] - 50.0)
    del page.kinds[:]
    await page.until(lambda: page.time["position"] < page.time["first"] - 50.0 and page.kinds.count("time") > 2)
    assert page.x == 1.0
    assert not {"update", "forget"} & set(page.kinds)
    rendered = await state_at(scene.history, page.time["position"])
    assert tree_of(rendered.root) == page.model.tree()
    page.send("live")
    await page.until(lambda: page.model.tree() == tree_of(scene.tree.snapshot.root))


async def test_a_page_without_timeline_has_no_time() -> None:
    async with running(ViewHub(QUICK, LiveTree())) as hub:
        page = Page(hub.connect())
        page.send("pause")
        await page.until(lambda: page.kinds.count("status") > 2)
    assert "time" not in page.kinds


async def test_a_log_plays_from_its_start_to_its_end(log: Log, log_page: Page) -> None:
    log_page.send("set", rate=10.0)
    await log_page.until(lambda: log_page.time.get("mode") == "paused" and log_page.x == 10.0)
    assert (log_page.time["live"], log_page.time["position"]) == (False, 1010.0)
    assert log.looked_for[0] == 0
    log_page.send("live")
    log_page.send("play")
    await log_page.until(lambda: log_page.x < 10.0 and log_page.time["mode"] == "playing")


async def test_a_loop_starts_again(log: Log, log_page: Page) -> None:
    log_page.send("seek", at=1009.9)
    log_page.send("set", rate=10.0, loop=True)
    await log_page.until(lambda: log.looked_for and log.looked_for[-1] == 9)
    await log_page.until(lambda: log.looked_for[-1] < 9)
    assert log_page.time["loop"]


async def test_only_the_last_seek_counts_while_one_takes_time(log: Log, log_page: Page) -> None:
    log_page.send("seek", at=1001.5)
    log_page.send("pause")
    await log_page.until(lambda: log_page.time.get("mode") == "paused" and log_page.model.tree() and log_page.x == 1.0)
    log.gate.clear()
    del log.looked_for[:]
    log_page.send("seek", at=1003.5)
    await log_page.until(lambda: log_page.time["working"])
    for second in (4, 5, 6, 7):
        log_page.send("seek", at=1000.5 + second)
    log.gate.set()
    await log_page.until(lambda: log_page.x == 7.0 and not log_page.time["working"])
    assert log.looked_for == [3, 7]


async def test_a_log_that_cannot_be_read_pauses_with_a_sentence(log: Log, log_page: Page) -> None:
    await log_page.until(lambda: log_page.model.tree())
    log.problem = OSError("run.lcm: the disk has gone")
    await log_page.until(lambda: log_page.time.get("problem") == "run.lcm: the disk has gone")
    assert log_page.time["mode"] == "paused"
    log.problem = None
    log_page.send("seek", at=1005.0)
    await log_page.until(lambda: log_page.x == 5.0 and not log_page.time["problem"])
