"""Compute a result once for all callers, concurrent and later ones."""

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Hashable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


@dataclass(slots=True, eq=False)
class _Computation(Generic[V]):
    """A task, and the number of callers that wait for it."""

    task: asyncio.Task[V]
    callers: int = 0


class SharedResults(Generic[K, V]):
    """Results by key, each computed by one task. Not thread-safe: used in the event loop only.

    A task is cancelled when all its callers are cancelled. The ``max_count`` most recently used results are kept.
    Errors are not kept.
    """

    def __init__(self, max_count: int) -> None:
        self._max_count = max_count
        self._computations: OrderedDict[K, _Computation[V]] = OrderedDict()

    async def get(self, key: K, compute: Callable[[], Coroutine[Any, Any, V]]) -> V:
        """Return the result for a key; ``compute`` it, which may raise, if there is neither a result nor a running
        task."""
        computation = self._computations.get(key)
        if computation is None:
            computation = self._computations[key] = _Computation(asyncio.get_running_loop().create_task(compute()))
            if len(self._computations) > self._max_count:
                self._computations.popitem(last=False)
        else:
            self._computations.move_to_end(key)
        computation.callers += 1
        try:
            return await asyncio.shield(computation.task)
        except BaseException:
            if computation.task.done() or computation.callers == 1:  # an error, or the last caller is cancelled
                computation.task.cancel()
                if self._computations.get(key) is computation:
                    del self._computations[key]
            raise
        finally:
            computation.callers -= 1
