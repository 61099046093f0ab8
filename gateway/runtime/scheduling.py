"""Who goes first on a processor that both the event loop and a thread that draws want. Linux only; elsewhere nothing
happens."""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import struct
import sys
import threading
from typing import Final

NICENESS: Final = 10
"""Of threads that nobody waits for: a tenth of another's share of a processor that both want."""
_SHORT_TURN: Final = 100_000
_USUAL_TURN: Final = 3_000_000
"""Nanoseconds. Since Linux 6.12 a thread that wakes up goes before one whose turns are longer (EEVDF's slices, 0.1 ms
at least). Otherwise the event loop, for which a byte has come, waits until a drawing thread's 3 to 5 ms are over."""
_SCHED_SETATTR: Final = {"x86_64": 314, "aarch64": 274}
"""Numbers of the system call, which C libraries got a name for in 2024 only."""
_ATTR: Final = struct.Struct("=IIQiIQQQ")
"""``struct sched_attr``: its size, policy, flags, niceness, priority, runtime, deadline, period."""


def step_forward() -> None:
    """Asks for short turns, soon, for the calling thread, which mostly waits; threads that it starts have them, too,
    until they ``step_back``. Does what the system allows, silently."""
    _take_turns(_SHORT_TURN)


def step_back(niceness: int = NICENESS) -> None:
    """Lets every thread of a lower niceness go first, and those of short turns whatever the niceness, in a thread that
    is about to compute; threads that it starts do the same. Does what the system allows, silently."""
    if sys.platform == "linux":  # elsewhere a thread has no number, and the whole process would step back
        if niceness > 0:
            with contextlib.suppress(OSError):
                thread = threading.get_native_id()
                os.setpriority(os.PRIO_PROCESS, thread, min(19, os.getpriority(os.PRIO_PROCESS, thread) + niceness))
        _take_turns(_USUAL_TURN)


def _take_turns(nanoseconds: int) -> None:
    number = _SCHED_SETATTR.get(platform.machine())
    if sys.platform != "linux" or number is None or os.sched_getscheduler(0) != os.SCHED_OTHER:
        return
    niceness = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    attr = _ATTR.pack(_ATTR.size, os.SCHED_OTHER, 0, niceness, 0, nanoseconds, 0, 0)
    ctypes.CDLL(None).syscall(ctypes.c_long(number), ctypes.c_long(0), attr, ctypes.c_long(0))
