"""One computation for all clients that request the same thing at the same time."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Hashable
from typing import Any, Generic, TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class SharedResults(Generic[K, V]):
    """Results by key, each computed by one task. Belongs to the event loop.

    A task is cancelled when all its callers are. The ``max_count`` most recently used results are kept; failures
    are not.
    """

    def __init__(self, max_count: int) -> None:
        self._max_count = max_count
        self._tasks: OrderedDict[K, _SharedTask[V]] = OrderedDict()

    async def get(self, key: K, compute: Callable[[], Coroutine[Any, Any, V]]) -> V:
        """Return the result for a key; call ``compute`` if there is none and none is on its way.

        Raises:
            Exception: ``compute`` raised it.
        """
        task = self._tasks.get(key)
        if task is None or not task.usable:
            task = self._tasks[key] = _SharedTask(compute())
        self._tasks.move_to_end(key)
        while len(self._tasks) > self._max_count:
            self._tasks.popitem(last=False)
        return await task.result()


class _SharedTask(Generic[V]):
    """A task with any number of callers."""

    def __init__(self, work: Coroutine[Any, Any, V]) -> None:
        self._task: asyncio.Task[V] = asyncio.get_running_loop().create_task(work)
        self._task.add_done_callback(_mark_retrieved)
        self._callers = 0

    @property
    def usable(self) -> bool:
        """False if the task failed or is cancelled."""
        if not self._task.done():
            return not self._task.cancelling()
        return not self._task.cancelled() and self._task.exception() is None

    async def result(self) -> V:
        """Wait for the result."""
        self._callers += 1
        try:
            return await asyncio.shield(self._task)
        finally:
            self._callers -= 1
            if self._callers == 0:
                self._task.cancel()  # no effect if it is done


def _mark_retrieved(task: asyncio.Task[Any]) -> None:
    """Keep asyncio from logging an exception that no caller waited for."""
    if not task.cancelled():
        task.exception()
