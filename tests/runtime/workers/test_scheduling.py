"""Time slices of the event loop's thread and of workers."""

import ctypes
import os
import platform
import sys
import threading
from pathlib import Path

import pytest

from gateway.runtime.workers import scheduling
from gateway.runtime.workers.scheduling import (
    _SCHED_ATTR,
    _SCHED_SETATTR,
    prefer_this_thread,
    usable_cpus,
    yield_to_event_loop,
)


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


@pytest.mark.parametrize(
    ("own", "outer", "inner", "expected"),
    [
        ("0::/", "max 100000", "", 16),  # no limit
        ("0::/", "150000 100000", "", 2),  # docker run --cpus 1.5
        ("4:memory:/x\n0::/pod/box", "max 100000", "300000 100000", 3),
        ("0::/pod/box", "100000 100000", "300000 100000", 1),  # the outer group limits, too
        ("0::/pod/box", "max 100000", "5000 100000", 1),  # at least one
        ("0::/pod/box", "max 100000", "3200000 100000", 16),  # more than there are
        ("0::/p\udcfcd", "200000 100000", "", 2),  # no UTF-8
        ("0::/", "", "", 16),  # not mounted
        ("1:cpu:/x", "junk", "junk", 16),  # version 1 only
    ],
)
def test_usable_cpus_within_the_quota_of_a_container(
    own: str, outer: str, inner: str, expected: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(16)), raising=False)
    monkeypatch.setattr(scheduling, "_CONTROL_GROUPS", tmp_path)
    monkeypatch.setattr(scheduling, "_OWN_GROUPS", tmp_path / "own")
    box = tmp_path / "pod" / "box"
    box.mkdir(parents=True)
    (tmp_path / "own").write_bytes(os.fsencode(own + "\n"))
    for group, quota in ((tmp_path, outer), (box, inner)):
        if quota:
            (group / "cpu.max").write_text(quota + "\n")
    assert usable_cpus() == expected
