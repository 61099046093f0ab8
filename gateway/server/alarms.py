"""Times at which something has not happened, for each request and connection: nearly all are called off long before.

A timer of the event loop's own costs microseconds to start and to end, and the interpreter is let go of once more for
each, whereupon threads that draw take it. Here one timer does for all.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Final

_STEP: Final = 0.25
"""Seconds; an alarm may be so much late."""
_SHORT: Final = 2.0
"""Seconds; what is sooner has a timer of its own, which is exact."""


class Alarm:
    """A call to come, unless it is called off."""

    __slots__ = ("_args", "_call", "_others")

    def __init__(self, others: dict[Alarm, None], call: Callable[..., object], args: tuple[Any, ...]) -> None:
        self._others = others
        self._call: Callable[..., object] | None = call
        self._args = args
        others[self] = None

    def cancel(self) -> None:
        """Calling it again, or after the call, does nothing."""
        self._others.pop(self, None)
        self._call = None

    def ring(self) -> None:
        """For ``Alarms``: the time has come."""
        if self._call is not None:
            self._call(*self._args)


class Alarms:
    """Of an event loop, and to be used in it."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._steps: dict[int, dict[Alarm, None]] = {}
        """Alarms by the step of time at which they ring; steps all of whose alarms were called off are still there."""
        self._next: int | None = None
        self._timer: asyncio.TimerHandle | None = None

    def later(self, seconds: float, call: Callable[..., object], *args: Any) -> Alarm | asyncio.TimerHandle:
        """As the event loop's ``call_later``."""
        if seconds < _SHORT:
            return self._loop.call_later(seconds, call, *args)
        step = int((self._loop.time() + seconds) / _STEP) + 1
        alarms = self._steps.setdefault(step, {})
        if self._next is None or step < self._next:
            self._wait_for(step)
        return Alarm(alarms, call, args)

    def _wait_for(self, step: int) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._next = step
        self._timer = self._loop.call_at(step * _STEP, self._ring)

    def _ring(self) -> None:
        now = self._loop.time()
        for step in sorted(step for step in self._steps if step * _STEP <= now):
            for alarm in self._steps.pop(step):
                self._loop.call_soon(alarm.ring)  # one that is called off meanwhile stays silent
        self._next = self._timer = None
        if self._steps:
            self._wait_for(min(self._steps))


_of_loops: Final[dict[asyncio.AbstractEventLoop, Alarms]] = {}


def alarms_of(loop: asyncio.AbstractEventLoop) -> Alarms:
    """The one of an event loop."""
    found = _of_loops.get(loop)
    if found is None:
        for other in [*_of_loops]:  # alarms hold their loop: those of closed ones go when there is another
            if other.is_closed():
                _of_loops.pop(other, None)
        found = _of_loops[loop] = Alarms(loop)
    return found
