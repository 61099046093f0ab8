"""Scene files of settings, read while the gateway starts."""

import asyncio
import threading
from typing import Any

import pytest

from gateway.runtime.settings import Settings
from gateway.runtime.workers.pool_errors import CallerCancelled
from gateway.wiring import scene_setting
from renderers.stop import check_stop


async def test_cancelling_stops_the_thread_that_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, stopped = threading.Event(), threading.Event()

    def read_slowly(*_: Any) -> None:
        begun.set()
        try:
            while True:
                check_stop()
        except CallerCancelled:
            stopped.set()

    monkeypatch.setattr(scene_setting, "read_scene", read_slowly)
    task = asyncio.create_task(scene_setting.read_scene_setting("robot.xml", Settings()))
    await asyncio.to_thread(begun.wait)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    await asyncio.to_thread(stopped.wait)
