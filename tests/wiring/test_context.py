"""Objects shared by all interfaces: what happens while nothing is rendered."""

import asyncio
from functools import partial

import numpy as np
import pytest

import gateway.app
from gateway.runtime.settings import Settings
from gateway.runtime.workers import process_tuning
from gateway.wiring import context as context_module
from gateway.wiring.context import Context
from tests.support.waiting import until


async def test_memory_of_frames_is_returned_once_when_nothing_is_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    returned: list[bool] = []
    monkeypatch.setattr(context_module, "IDLE_SECONDS", 0.0)
    monkeypatch.setattr(process_tuning, "return_memory", lambda: returned.append(True))

    def has_returned(times: int) -> bool:
        return len(returned) == times

    context: Context = gateway.app.create_app(Settings()).state.context
    idle = asyncio.create_task(context.return_memory_when_idle())
    try:
        for times in (1, 2):
            await context.workers.run(lambda: np.zeros(1))
            await until(partial(has_returned, times))
        for _ in range(100):
            await asyncio.sleep(0)
        assert len(returned) == 2
        with context.tree.edit() as edit:
            edit.set_visible(("a",), True)
        await until(partial(has_returned, 3))
    finally:
        idle.cancel()
        await context.workers.close()
