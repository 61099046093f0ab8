"""Run a bench in a process group of its own, and remove its processes and temporary files afterwards."""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

GRACE = 10.0
"""Seconds between SIGTERM and SIGKILL."""


@dataclass(frozen=True, slots=True)
class Ran:
    """Outcome of a command."""

    output: str
    failure: str
    """Reason why the command did not succeed; empty if it did."""
    seconds: float


def run(arguments: Sequence[str], limit: float) -> Ran:
    """Run this Python with ``arguments`` for at most ``limit`` seconds, and end all processes that it started."""
    begin = time.perf_counter()
    failure = ""
    with tempfile.TemporaryDirectory(prefix="scenegate-bench-", ignore_cleanup_errors=True) as folder:
        # Files, not pipes: a child that inherits a pipe would keep the reader waiting.
        said, complained = Path(folder, "stdout"), Path(folder, "stderr")
        with said.open("wb") as stdout, complained.open("wb") as stderr:
            process = subprocess.Popen(
                [sys.executable, "-u", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=stderr,
                env={**os.environ, "TMPDIR": folder},
                start_new_session=True,
            )
            try:
                if process.wait(limit):
                    failure = f"it ended with {process.returncode}"
            except subprocess.TimeoutExpired:
                failure = f"it took longer than {limit:.0f} s"
            finally:
                _end(process, folder)
        if failure:
            last = (complained.read_text(errors="replace").strip().splitlines() or [""])[-1][:200]
            failure = f"{failure}: {last}" if last else failure
        return Ran(said.read_text(errors="replace"), failure, time.perf_counter() - begin)


def tree_of(pid: int) -> list[int]:
    """Return the process and all that it has started, parents first. Linux only."""
    found = [pid]
    for parent in found:
        for task in Path(f"/proc/{parent}/task").glob("*/children"):
            with contextlib.suppress(OSError):  # a thread that has just ended
                found += [int(child) for child in task.read_text().split()]
    return found


def end(process: subprocess.Popen[Any]) -> None:
    """Kill a process and all that it has started, sessions of their own included (meshcat's server is in one)."""
    if process.poll() is None:
        for pid in tree_of(process.pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
    process.wait()


def _end(process: subprocess.Popen[bytes], folder: str) -> None:
    """End the process and all that it has started, also what outlives it; ``folder``: their TMPDIR."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        for pid in _left(process, folder):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)
        until = time.perf_counter() + GRACE
        while time.perf_counter() < until and _left(process, folder):
            time.sleep(0.05)
    process.wait()


def _left(process: subprocess.Popen[bytes], folder: str) -> list[int]:
    """Return processes of the bench that still run: its session's, and those of other sessions with its TMPDIR."""
    process.poll()
    mark = f"TMPDIR={folder}".encode()
    found = []
    for entry in Path("/proc").iterdir():
        with contextlib.suppress(OSError):  # not a process, ended, or another user's
            state, _, _, session, *_ = (entry / "stat").read_text().rpartition(")")[2].split()
            ours = int(session) == process.pid or mark in (entry / "environ").read_bytes().split(b"\0")
            if ours and state != "Z":
                found.append(int(entry.name))
    return found
