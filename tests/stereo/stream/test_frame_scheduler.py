"""The scheduler's waits."""

from __future__ import annotations

import asyncio

import pytest

from gateway.stereo.stream import frame_scheduler

uvloop = pytest.importorskip("uvloop")


@pytest.mark.parametrize("milliseconds", [0.1, 0.4, 1.2, 3.45])
def test_a_wait_is_over_when_it_ends(milliseconds: float) -> None:
    """On uvloop, whose clock and timers count milliseconds, shorter waits ended at once, again and again."""

    async def wait() -> float:
        loop = asyncio.get_running_loop()
        begin = loop.time()
        await frame_scheduler._wait(asyncio.Event(), milliseconds / 1000.0)  # noqa: SLF001 - all that waits
        return (loop.time() - begin) * 1000.0

    assert uvloop.run(wait()) >= milliseconds
