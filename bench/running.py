"""A bench in processes of its own, of which nothing is left: no process, no temporary file."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

GRACE = 10.0
"""Seconds in which processes may end by themselves."""


@dataclass(frozen=True, slots=True)
class Ran:
    """What came of a command."""

    output: str
    failure: str
    """Why it did not reach its end; empty: it did."""
    seconds: float


def run(arguments: Sequence[str], limit: float) -> Ran:
    """This Python with ``arguments``, for ``limit`` seconds at most; what it started ends with it, however it ends."""
    begin = time.perf_counter()
    failure = ""
    with tempfile.TemporaryDirectory(prefix="scenegate-bench-", ignore_cleanup_errors=True) as folder:
        # Files, not pipes: whoever inherits a pipe keeps its reader waiting.
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
                _end(process)
        if failure:
            last = (complained.read_text(errors="replace").strip().splitlines() or [""])[-1][:200]
            failure = f"{failure}: {last}" if last else failure
        return Ran(said.read_text(errors="replace"), failure, time.perf_counter() - begin)


def _end(process: subprocess.Popen[bytes]) -> None:
    """The process and all of its session that is left."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
        except ProcessLookupError:
            break
        until = time.perf_counter() + GRACE
        while time.perf_counter() < until and _alive(process):
            time.sleep(0.05)
    process.wait()


def _alive(process: subprocess.Popen[bytes]) -> bool:
    """Whether any process of the session still is there."""
    process.poll()
    try:
        os.killpg(process.pid, 0)
    except ProcessLookupError:
        return False
    return True
