"""CPUs of this process; priority of threads that compute, below that of the event loop (on Linux only)."""

import contextlib
import ctypes
import math
import os
import platform
import struct
import sys
import threading
from pathlib import Path
from typing import Final

BACKGROUND_NICENESS: Final = 10
"""Niceness of threads without a waiting client: a tenth of another thread's share of a CPU."""
CAMERA_FIRST_NICENESS: Final = 10
"""Niceness of threads that give way to streaming cameras: they get what the cameras leave, and a tenth at least."""
_SHORT_SLICE: Final = 100_000
_DEFAULT_SLICE: Final = 3_000_000
"""Time slices in nanoseconds. Since Linux 6.12 a thread that wakes up preempts one with longer slices (EEVDF). Without
that, the event loop waits 3 to 5 ms for a computing thread's slice to end."""
_SCHED_SETATTR: Final = {"x86_64": 314, "aarch64": 274}
"""System call numbers by machine; C libraries have a wrapper since 2024 only."""
_SCHED_ATTR: Final = struct.Struct("=IIQiIQQQ")
"""``struct sched_attr``: size, policy, flags, niceness, priority, runtime, deadline, period."""
_CONTROL_GROUPS: Final = Path("/sys/fs/cgroup")
_OWN_GROUPS: Final = Path("/proc/self/cgroup")
"""File with the paths of this process's control groups; a line for each hierarchy, ``0::PATH`` for version 2."""


def prefer_this_thread() -> None:
    """Give the calling thread short time slices, so that it runs soon after it wakes up.

    For the event loop's thread. Threads that it starts inherit this until they call ``yield_to_event_loop``. Does
    nothing where the system does not allow it.
    """
    _set_slice(_SHORT_SLICE)


def yield_to_event_loop(niceness: int = BACKGROUND_NICENESS) -> None:
    """Give the calling thread, which computes, default time slices and a higher niceness, if the system allows it."""
    if sys.platform == "linux":
        raise_niceness(threading.get_native_id(), niceness)
        _set_slice(_DEFAULT_SLICE)


def raise_niceness(thread: int, niceness: int) -> None:
    """Give a thread, by its native id, a niceness relative to the process. Lowering it needs privileges.

    It is at least 0; at 0 nothing changes.
    """
    if sys.platform == "linux" and niceness > 0:  # elsewhere niceness belongs to the process
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, thread, min(19, os.getpriority(os.PRIO_PROCESS, os.getpid()) + niceness))


def _set_slice(nanoseconds: int) -> None:
    number = _SCHED_SETATTR.get(platform.machine())
    if sys.platform != "linux" or number is None or os.sched_getscheduler(0) != os.SCHED_OTHER:
        return
    niceness = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    attr = _SCHED_ATTR.pack(_SCHED_ATTR.size, os.SCHED_OTHER, 0, niceness, 0, nanoseconds, 0, 0)
    ctypes.CDLL(None).syscall(ctypes.c_long(number), ctypes.c_long(0), attr, ctypes.c_long(0))


def usable_cpus() -> int:
    """Return the number of CPUs that this process may use, within the CPU set and quota of its container."""
    cpus = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, math.ceil(min(cpus, _cpu_quota())))


def _cpu_quota() -> float:
    """Return the smallest quota of this process's control groups (version 2), CPUs; infinite if there is none."""
    quotas = [math.inf]
    with contextlib.suppress(OSError):
        own = _CONTROL_GROUPS / os.fsdecode(_OWN_GROUPS.read_bytes()).rpartition("0::/")[2].strip()
        for group in (own, *own.parents):
            with contextlib.suppress(OSError, ValueError):  # ValueError: "max", no limit
                quota, period = (group / "cpu.max").read_text().split()
                quotas.append(int(quota) / int(period))
    return min(quotas)
