"""Functions that ``test_limited_process`` calls in child processes. They import nothing of this project."""

import contextlib
import inspect
import os
import signal
import struct
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ReadFile = Callable[[str], bytes]


def echo(read_file: ReadFile, *arguments: Any) -> list[Any]:
    return list(arguments)


def read(read_file: ReadFile, *names: str) -> list[bytes | str]:
    """Return the files, or the reasons why there are none."""
    results: list[bytes | str] = []
    for name in names:
        try:
            results.append(read_file(name))
        except OSError as error:
            results.append(str(error))
    return results


def allocate(read_file: ReadFile, size: int) -> int:
    return len(bytes(size))


def compute(read_file: ReadFile) -> None:
    while True:
        pass


def hang(read_file: ReadFile) -> None:
    threading.Event().wait()


def read_repeatedly(read_file: ReadFile) -> None:
    while True:
        with contextlib.suppress(OSError):
            read_file("file")
        time.sleep(0.01)


def stop_within_a_message(read_file: ReadFile) -> None:
    stream = inspect.getclosurevars(read_file).nonlocals["stream"]
    stream.write(b"R")
    stream.flush()
    hang(read_file)


def read_and_stop(read_file: ReadFile) -> None:
    stream = inspect.getclosurevars(read_file).nonlocals["stream"]
    stream.write(struct.pack("<cQ", b"F", 4) + b"file")
    stream.flush()
    hang(read_file)


def tell_pid_and_sleep(read_file: ReadFile) -> None:
    read_file(f"{os.getpid()} {os.getppid()}")
    while True:
        time.sleep(1)


def crash(read_file: ReadFile) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def write_file(read_file: ReadFile, path: str) -> None:
    Path(path).write_bytes(b"x")


def count_calls(read_file: ReadFile) -> int:
    global _calls
    _calls += 1
    return _calls


_calls = 0


def environment(read_file: ReadFile) -> dict[str, Any]:
    """Return the names of loaded modules, and the targets of open descriptors."""
    descriptors = []
    for number in range(3, 1000):
        with contextlib.suppress(OSError):
            descriptors.append(str(Path(f"/proc/self/fd/{number}").readlink()))
    return {"modules": sorted(sys.modules), "descriptors": descriptors}
