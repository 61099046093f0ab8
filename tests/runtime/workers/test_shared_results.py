"""One computation for concurrent callers."""

import asyncio
from collections import Counter
from functools import partial

import pytest

from gateway.runtime.workers.shared_results import SharedResults
from tests.support.waiting import until


class Work:
    """Computations that block until the test lets them finish."""

    def __init__(self) -> None:
        self.started: Counter[str] = Counter()
        self.cancelled: Counter[str] = Counter()
        self.finish = asyncio.Event()

    async def compute(self, key: str) -> str:
        self.started[key] += 1
        try:
            await self.finish.wait()
        except asyncio.CancelledError:
            self.cancelled[key] += 1
            raise
        return key.upper()


async def test_concurrent_and_later_callers_share_a_result() -> None:
    work, results = Work(), SharedResults[str, str](2)
    callers = [asyncio.create_task(results.get("a", lambda: work.compute("a"))) for _ in range(3)]
    await until(lambda: work.started["a"])
    callers[0].cancel()
    work.finish.set()
    assert await asyncio.gather(*callers[1:]) == ["A", "A"]
    assert await results.get("a", lambda: work.compute("a")) == "A"
    assert (work.started["a"], work.cancelled["a"]) == (1, 0)


async def test_last_cancelled_caller_cancels_the_computation() -> None:
    work, results = Work(), SharedResults[str, str](2)
    callers = [asyncio.create_task(results.get("a", lambda: work.compute("a"))) for _ in range(2)]
    await until(lambda: work.started["a"])
    for caller in callers:
        caller.cancel()
    await until(lambda: work.cancelled["a"])
    work.finish.set()
    assert await results.get("a", lambda: work.compute("a")) == "A"
    assert work.started["a"] == 2


async def test_least_recently_used_results_are_dropped_beyond_the_limit() -> None:
    work, results = Work(), SharedResults[str, str](2)
    work.finish.set()
    for key in ("a", "b", "a", "c", "a", "b"):
        await results.get(key, partial(work.compute, key))
    assert work.started == {"a": 1, "b": 2, "c": 1}


async def test_failures_are_not_kept() -> None:
    results, count = SharedResults[str, str](2), 0

    async def fail() -> str:
        nonlocal count
        count += 1
        raise ValueError("broken")

    for _ in range(2):
        with pytest.raises(ValueError, match="broken"):
            await results.get("a", fail)
    assert count == 2
