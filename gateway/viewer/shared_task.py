"""Work that several clients wait for."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class SharedTask(Generic[T]):
    """A task that is cancelled when the last of those who wait for it is."""

    def __init__(self, work: Coroutine[Any, Any, T]) -> None:
        self.task: asyncio.Task[T] = asyncio.get_running_loop().create_task(work)
        self.task.add_done_callback(_retrieve)
        self._waiting = 0

    @property
    def usable(self) -> bool:
        """True while the task has a result or can still produce one."""
        if not self.task.done():
            return not self.task.cancelling()
        return not self.task.cancelled() and self.task.exception() is None

    async def result(self) -> T:
        """Wait for the result; raises whatever the work raised."""
        self._waiting += 1
        try:
            return await asyncio.shield(self.task)
        finally:
            self._waiting -= 1
            if self._waiting == 0:
                self.task.cancel()  # does nothing where it is done


def _retrieve(task: asyncio.Task[Any]) -> None:
    """Mark a failure as seen: those who waited got it."""
    if not task.cancelled():
        task.exception()
