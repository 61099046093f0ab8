"""A page that seeks in a log: after each update it has the meshes of all its nodes, and the state of the time."""

import asyncio
import gc
import random
from pathlib import Path

import pytest

from gateway.adapters.viewer.browser import Browser
from gateway.adapters.viewer.config import ViewerConfig
from gateway.adapters.viewer.hub import ViewHub
from gateway.adapters.viewer.messages import TimeCommand
from gateway.files.assets.mesh_files import MeshFiles
from gateway.replay.log_timeline import Checkpoints, LogTimeline, scan_log
from gateway.scene.tree.live import LiveTree
from tests.adapters.viewer.model import Model
from tests.replay.logs import BEGIN, write_log
from tests.replay.test_log_timeline import cloud_of, moving
from tests.support.view_frames import parse_frame
from tests.support.waiting import SECONDS

COUNT = 40
CONFIG = ViewerConfig(max_update_rate=1000.0)


class Page:
    """A page that processes each frame at once."""

    def __init__(self, hub: ViewHub) -> None:
        self.browser: Browser = hub.connect()
        self.browser.execute(TimeCommand("pause"))
        self.model = Model()
        self.task = asyncio.create_task(self._receive())

    async def _receive(self) -> None:
        async for frame in self.browser.frames():
            kind = parse_frame(frame)[0]["kind"]
            if kind in ("update", "mesh", "forget"):
                self.model.receive(frame)
            if kind == "update":
                self.browser.acknowledge()
                shown = {
                    draw["mesh"] for node in self.model.nodes.values() for p in node.parts or () for draw in p["draws"]
                }
                assert shown <= self.model.meshes, "the page was told to forget a mesh that it shows"

    def seek(self, seconds: float) -> None:
        self.browser.execute(TimeCommand("seek", at=BEGIN + seconds))

    async def until_at(self, x: float) -> None:
        """Wait until the box is there."""
        async with asyncio.timeout(SECONDS):
            while self.x != x:
                assert not self.task.done(), self.task.exception()
                await asyncio.sleep(0)

    @property
    def x(self) -> float | None:
        pose = self.model.tree().get(("a",))
        return None if pose is None else (pose[2][0] if len(pose[2]) == 7 else pose[2][12])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
async def test_pages_that_seek(seed: int, tmp_path: Path) -> None:
    """Clouds are decoded again at each seek, so that a revision has different meshes at different times."""
    messages = sorted(
        [*moving(COUNT), *((k / 10 + 0.05, f"DRAKE_POINT_CLOUD_{k % 3}", cloud_of(10, k)) for k in range(COUNT))]
    )
    log = write_log(tmp_path / "x", messages)
    numbers = random.Random(seed)
    with LogTimeline(log, MeshFiles(()), scan_log(log), Checkpoints(interval=15.0)) as timeline:
        hub = ViewHub(CONFIG, LiveTree(), timeline=timeline, has_live=False)
        running = asyncio.create_task(hub.run())
        pages = [Page(hub) for _ in range(2)]
        for _ in range(25):
            frame, page = numbers.choice((3, 9, 10, 20, 30, numbers.randrange(1, COUNT))), numbers.choice(pages)
            page.seek(frame / 10 + 0.06)
            await page.until_at(float(frame))
            gc.collect()
        for page in pages:
            page.browser.close()
            await page.task
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
