"""A log in place of the live tree, while it is indexed."""

import asyncio
from pathlib import Path

import pytest

from gateway.replay import log_service, log_timeline
from gateway.replay.log_service import LogService
from gateway.replay.log_timeline import open_log
from tests.replay.logs import write_log
from tests.replay.test_log_timeline import moving, x_of
from tests.support.waiting import until


async def test_the_live_tree_has_the_last_state_of_the_part_that_is_indexed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_timeline, "SLICE_SECONDS", 0.0)  # one message
    monkeypatch.setattr(log_service, "SHOW_SECONDS", 0.0)
    shown: list[float] = []
    service = LogService(
        open_log(write_log(tmp_path / "run.lcmlog", moving(5))),
        lambda progress: shown.append(x_of(service.tree.snapshot)) if progress > 0.3 else None,
    )
    running = asyncio.create_task(service.run())
    await until(lambda: service.timeline.is_fully_indexed and x_of(service.tree.snapshot) == 4.0)
    assert service.ready
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert not service.ready
    assert shown == sorted(shown)
    assert {1.0, 2.0, 3.0} & set(shown)
