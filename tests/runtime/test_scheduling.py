"""Time slices of the event loop's thread and of workers."""

from __future__ import annotations

import ctypes
import platform
import sys
import threading

import pytest

from gateway.runtime.scheduling import _SCHED_ATTR, _SCHED_SETATTR, prefer_this_thread, yield_to_event_loop


def turn() -> int:
    """Nanoseconds that the calling thread has asked for."""
    buffer = ctypes.create_string_buffer(_SCHED_ATTR.size)
    number = _SCHED_SETATTR[platform.machine()] + 1  # sched_getattr follows in every table
    long = ctypes.c_long
    assert ctypes.CDLL(None).syscall(long(number), long(0), buffer, long(_SCHED_ATTR.size), long(0)) == 0
    return int(_SCHED_ATTR.unpack(buffer.raw)[5])


def known() -> bool:
    if sys.platform != "linux" or platform.machine() not in _SCHED_SETATTR:
        return False
    return tuple(int(part) for part in platform.release().split("-")[0].split(".")[:2]) >= (6, 12)


@pytest.mark.skipif(not known(), reason="threads can ask for turns on Linux 6.12 and later")
def test_event_loop_has_shorter_slices_than_workers() -> None:
    seen: list[int] = []

    def compute() -> None:
        seen.append(turn())
        yield_to_event_loop(0)
        seen.append(turn())

    def wait() -> None:
        prefer_this_thread()
        seen.append(turn())
        worker = threading.Thread(target=compute)
        worker.start()
        worker.join()

    loop = threading.Thread(target=wait)
    loop.start()
    loop.join()
    mine, inherited, computing = seen
    assert mine == inherited < computing
