"""Calls in child processes, with limits on memory and time."""

import os
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import pytest

from gateway.runtime.workers import limited_process
from gateway.runtime.workers.limited_process import ProcessFailed, ProcessLimits, call_limited, no_files
from gateway.runtime.workers.limited_process_child import receive_message
from renderers.stop import StopFlag
from tests.support.waiting import SECONDS, wait_until

LIMITS = ProcessLimits(memory_bytes=64 << 20, seconds=int(SECONDS))
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="limits on memory and /proc are Linux's")


def call(
    name: str, *arguments: Any, limits: ProcessLimits = LIMITS, read_file: Callable[[str], bytes] = no_files
) -> Any:
    return msgspec.msgpack.decode(
        call_limited(f"tests.runtime.workers.limited_functions:{name}", arguments, limits, read_file)
    )


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


class Processes:
    """Reads the file that ``tell_pid_and_sleep`` asks for: its name has the ids of the child and of its helper."""

    def __init__(self) -> None:
        self.started = threading.Event()
        self.child = self.helper = 0

    def read_file(self, name: str) -> bytes:
        self.child, self.helper = map(int, name.split())
        self.started.set()
        return b""


def test_arguments_and_result_can_be_large() -> None:
    assert call("echo", 1, "two", b"x" * (12 << 20)) == [1, "two", b"x" * (12 << 20)]


@pytest.mark.parametrize(
    "data", [b"", b"R", struct.pack("<cQ", b"R", 5) + b"half", struct.pack("<cQ", b"R", 9) + b"x" * 9]
)
def test_messages_that_are_cut_off_or_too_long_are_the_end(data: bytes) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(data)
        theirs.shutdown(socket.SHUT_WR)
        with pytest.raises(EOFError):
            receive_message(ours.makefile("rwb"), max_bytes=8)


def test_files_are_read_by_the_caller() -> None:
    def read_file(name: str) -> bytes:
        if name == "a":
            return b"content" * (1 << 18)
        raise {"b": FileNotFoundError(2, "there is none"), "c": ValueError("not allowed")}[name]

    assert call("read", "a", "b", "c", read_file=read_file) == [
        b"content" * (1 << 18), "[Errno 2] there is none", "not allowed",
    ]  # fmt: skip
    assert call("read", "a") == ["a"]


def test_no_call_sees_what_another_one_left() -> None:
    assert [call("count_calls"), call("count_calls")] == [1, 1]


@needs_linux
def test_memory_is_limited_and_counted_anew() -> None:
    for _ in range(3):
        assert call("allocate", 48 << 20) == 48 << 20
    with pytest.raises(ProcessFailed, match="it failed, or needs more than 67108864 bytes of memory") as caught:
        call("allocate", 80 << 20)
    assert not caught.value.timed_out


BLOCKING = ("hang", "read_repeatedly", "stop_within_a_message", "read_and_stop")
"""Calls that wait, and so do not end by the limit on CPU time."""


@pytest.mark.parametrize("name", ["compute", *(pytest.param(each, marks=pytest.mark.slow) for each in BLOCKING)])
def test_time_is_limited(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name in BLOCKING:
        monkeypatch.setattr(limited_process, "ELAPSED_FACTOR", 1)
    with pytest.raises(ProcessFailed, match="it took longer than 1 s of CPU time") as caught:
        call(name, limits=ProcessLimits(1 << 30, 1), read_file=lambda name: bytes(8 << 20))
    assert caught.value.timed_out


@needs_linux
def test_writes_no_files(tmp_path: Path) -> None:
    with pytest.raises(ProcessFailed):
        call("write_file", str(tmp_path / "file"))
    assert not (tmp_path / "file").read_bytes()


def test_a_crash_is_an_error_of_its_own_call_only() -> None:
    with ThreadPoolExecutor(8) as threads:
        crashing = [threads.submit(call, "crash") for _ in range(4)]
        returning = [threads.submit(call, "echo", number) for number in range(4)]
    for future in crashing:
        with pytest.raises(ProcessFailed, match="it failed"):
            future.result()
    assert [future.result() for future in returning] == [[0], [1], [2], [3]]


def test_a_slow_call_does_not_delay_others() -> None:
    flag, processes = StopFlag(), Processes()
    with ThreadPoolExecutor(1) as threads:
        slow = threads.submit(flag.run, lambda: call("tell_pid_and_sleep", read_file=processes.read_file))
        assert processes.started.wait(SECONDS)
        assert call("echo", 1) == [1]
        assert not slow.done()
        flag.set(TimeoutError("late"))
        with pytest.raises(TimeoutError, match="late"):
            slow.result(SECONDS)
    assert not is_alive(processes.child)


def test_errors_of_the_reader_end_the_child() -> None:
    processes = Processes()

    def read_file(name: str) -> bytes:
        processes.read_file(name)
        raise TypeError("a fault of ours")

    with pytest.raises(TypeError, match="a fault of ours"):
        call("tell_pid_and_sleep", read_file=read_file)
    assert not is_alive(processes.child)


def test_an_ended_helper_is_replaced() -> None:
    for signal_number in (signal.SIGKILL, signal.SIGKILL):
        processes = Processes()

        def read_file(name: str, processes: Processes = processes, number: int = signal_number) -> bytes:
            processes.read_file(name)
            os.kill(processes.helper, number)
            return b""

        with pytest.raises(ProcessFailed):
            call("tell_pid_and_sleep", read_file=read_file)
    assert call("echo", 1) == [1]


@needs_linux
def test_the_child_has_nothing_of_the_program() -> None:
    with (Path(__file__)).open() as file:
        os.set_inheritable(file.fileno(), True)
        found = call("environment")
    assert not {name.partition(".")[0] for name in found["modules"]} & {
        "numba",
        "renderers",
        "fastapi",
        "pytest",
        "numpy",
    }
    assert len(found["descriptors"]) == 1
    assert found["descriptors"][0].startswith("socket:")


PROGRAM = """
import os
from gateway.runtime.workers.limited_process import ProcessLimits, call_limited
def read_file(name):
    print(name, flush=True)
    return b""
call_limited("tests.runtime.workers.limited_functions:tell_pid_and_sleep", (), ProcessLimits(1 << 28, 1000), read_file)
"""


def test_children_end_with_a_killed_program() -> None:
    with subprocess.Popen([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, text=True) as program:
        child, helper = map(int, program.stdout.readline().split())
        assert is_alive(child)
        program.kill()
    wait_until(lambda: not is_alive(child) and not is_alive(helper))
