"""A page that seeks in a log: after each update it has the meshes of all its nodes, and the state of the time."""

import gc
import random
from pathlib import Path

import pytest

from gateway.adapters.viewer.config import ViewerConfig
from gateway.adapters.viewer.hub import ViewHub
from gateway.files.assets.mesh_files import MeshFiles
from gateway.replay.log_timeline import Checkpoints, LogTimeline, scan_log
from gateway.scene.tree.live import LiveTree
from tests.adapters.viewer.model import running
from tests.adapters.viewer.test_playback import Page
from tests.replay.logs import BEGIN, write_log
from tests.replay.test_log_timeline import cloud_of, moving

COUNT = 40
CONFIG = ViewerConfig(max_update_rate=1000.0)


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
        async with running(ViewHub(CONFIG, LiveTree(), timeline=timeline, has_live=False)) as hub:
            pages = [Page(hub.connect(), "a") for _ in range(2)]
            for page in pages:
                page.send("pause")
            for _ in range(25):
                frame, page = numbers.choice((3, 9, 10, 20, 30, numbers.randrange(1, COUNT))), numbers.choice(pages)
                page.send("seek", at=BEGIN + frame / 10 + 0.06)
                await page.until(lambda page=page, frame=frame: page.x == frame)
                gc.collect()
