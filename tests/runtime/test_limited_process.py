"""Programs in a process of their own, with limits on memory and time."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gateway.runtime.limited_process import ProcessFailed, ProcessLimits, run_limited
from renderers.stop import StopFlag
from tests.support.waiting import SECONDS

LIMITS = ProcessLimits(memory_bytes=1 << 30, seconds=int(SECONDS))
needs_rlimit = pytest.mark.skipif(sys.platform != "linux", reason="the memory of a process is limited on Linux only")


def run(folder: Path, code: str, stdin: bytes = b"", limits: ProcessLimits = LIMITS) -> bytes:
    """Run a program in Python that has ``code``."""
    path = folder / "program.py"
    path.write_text(f"import sys\n{code}\n")
    return run_limited(str(path), ["a", "b"], stdin, limits)


def test_returns_what_the_program_writes(tmp_path: Path) -> None:
    code = "sys.stdout.write(f'{sys.argv[1:]} {__name__} {len(sys.stdin.read())}')"
    assert run(tmp_path, code, b"x" * 300_000) == b"['a', 'b'] __main__ 300000"


@needs_rlimit
def test_memory_is_limited(tmp_path: Path) -> None:
    with pytest.raises(ProcessFailed, match="it failed, or needs more than 1073741824 bytes of memory") as caught:
        run(tmp_path, "bytes(1 << 31)")
    assert not caught.value.timed_out


@pytest.mark.parametrize("code", ["while True: pass", "import threading; threading.Event().wait()"])
def test_time_is_limited(tmp_path: Path, code: str) -> None:
    with pytest.raises(ProcessFailed, match="it took longer than 1 s") as caught:
        run(tmp_path, code, limits=ProcessLimits(1 << 30, 1))
    assert caught.value.timed_out


@needs_rlimit
def test_writes_no_files(tmp_path: Path) -> None:
    with pytest.raises(ProcessFailed):
        run(tmp_path, f"with open({str(tmp_path / 'file')!r}, 'wb') as file: file.write(b'x')")
    assert not (tmp_path / "file").read_bytes()


def test_a_crash_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ProcessFailed, match="it failed"):
        run(tmp_path, "import os; os.abort()")


def test_the_stop_flag_ends_the_program(tmp_path: Path) -> None:
    flag = StopFlag()
    flag.set(TimeoutError("late"))
    with pytest.raises(TimeoutError, match="late"):
        flag.run(lambda: run(tmp_path, "import threading; threading.Event().wait()"))
