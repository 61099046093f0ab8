"""Time at which the message that is being handled arrived.

The time is a context variable. Passed as a parameter, it would go through all functions between a transport and the
live tree.
"""

from __future__ import annotations

import time
from contextvars import ContextVar

_arrival: ContextVar[int | None] = ContextVar("arrival", default=None)


def arrival_time() -> int:
    """Return the arrival of the message that is being handled, or the current time; nanoseconds since the epoch."""
    arrival = _arrival.get()
    return time.time_ns() if arrival is None else arrival


def set_arrival(arrival_ns: int | None) -> None:
    """Set the arrival of the message that this task or callback handles next; None: it arrives when it is handled."""
    _arrival.set(arrival_ns)
