"""Compute an image once for all clients that request the same image at the same time.

``scene_images`` and ``sensor_images`` use it.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Hashable
from typing import Any, Generic, TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class SharedResults(Generic[K, V]):
    """Results by key, each computed by one task. Not thread-safe: used in the event loop only.

    A task is cancelled when all its callers are cancelled. The ``max_count`` most recently used results are kept.
    Errors are not kept.
    """

    def __init__(self, max_count: int) -> None:
        self._max_count = max_count
        self._tasks: OrderedDict[K, _SharedTask[V]] = OrderedDict()

    async def get(self, key: K, compute: Callable[[], Coroutine[Any, Any, V]]) -> V:
        """Return the result for a key. Start ``compute`` if there is neither a result nor a running task.

        Raises:
            Exception: the error of ``compute``.
        """
        task = self._tasks.get(key)
        if task is None or not task.usable:
            task = self._tasks[key] = _SharedTask(compute())
        self._tasks.move_to_end(key)
        while len(self._tasks) > self._max_count:
            self._tasks.popitem(last=False)
        return await task.result()


class _SharedTask(Generic[V]):
    """A task that computes one result for any number of callers."""

    def __init__(self, computation: Coroutine[Any, Any, V]) -> None:
        self._task: asyncio.Task[V] = asyncio.get_running_loop().create_task(computation)
        self._task.add_done_callback(_mark_retrieved)
        self._callers = 0
        """Number of callers that wait for the result."""

    @property
    def usable(self) -> bool:
        """True unless the task has failed, was cancelled or is being cancelled."""
        if not self._task.done():
            return not self._task.cancelling()
        return not self._task.cancelled() and self._task.exception() is None

    async def result(self) -> V:
        """Wait for the result. Cancel the task if its last caller is cancelled."""
        self._callers += 1
        try:
            return await asyncio.shield(self._task)
        finally:
            self._callers -= 1
            if self._callers == 0:
                self._task.cancel()  # no effect on a task that is done


def _mark_retrieved(task: asyncio.Task[Any]) -> None:
    """Retrieve the task's exception. asyncio logs exceptions that are never retrieved."""
    if not task.cancelled():
        task.exception()
