"""Runs third-party decoders and compilers in a child process, with limits on memory and time.

Damaged or hostile files can make them allocate gigabytes, run for hours or crash. Then only the child process ends.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from renderers.stop import check_stop

_LAUNCHER: Final = Path(__file__).with_name("limited_process_child.py")
_SECONDS_BETWEEN_STOP_CHECKS: Final = 0.05


@dataclass(frozen=True, slots=True)
class ProcessLimits:
    """Limits of a child process."""

    memory_bytes: int
    """Address space of the process. macOS does not limit it."""
    seconds: int
    """Elapsed time, and CPU time, after which the process is killed."""


class ProcessFailed(Exception):  # noqa: N818 - expected for damaged files
    """The process crashed, or exceeded a limit."""

    def __init__(self, reason: str, *, timed_out: bool) -> None:
        super().__init__(reason)
        self.timed_out = timed_out
        """True if the process exceeded its time; False if it crashed or ran out of memory."""


def run_limited(program: str, arguments: list[str], stdin: bytes, limits: ProcessLimits) -> bytes:
    """Run a Python program in a child process, and return the bytes that it writes to stdout.

    Args:
        program: Path of a Python file that imports nothing of this project.
        arguments: Command-line arguments of the program.
        stdin: Bytes for the program's stdin.
        limits: Limits of the child process.

    Raises:
        ProcessFailed: The program failed or exceeded a limit.
        Exception: The current ``StopFlag`` was set, with its error. The child process is killed.
    """
    command = [sys.executable, "-P", str(_LAUNCHER), str(limits.memory_bytes), str(limits.seconds), program, *arguments]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # its threads reserve gigabytes of address space
    end = time.monotonic() + limits.seconds
    pipe = subprocess.PIPE
    with subprocess.Popen(  # noqa: S603 - our own program
        command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=environment
    ) as process:
        outputs: list[bytes] = []
        # communicate() with a timeout could not be used: called again, it does not send the rest of the input.
        communication = threading.Thread(target=lambda: outputs.append(process.communicate(stdin)[0]), daemon=True)
        communication.start()
        try:
            while communication.is_alive():
                communication.join(_SECONDS_BETWEEN_STOP_CHECKS)
                check_stop()
                if time.monotonic() > end:
                    break
        finally:
            if timed_out := communication.is_alive():
                process.kill()
                communication.join()
    if timed_out or process.returncode == -signal.SIGXCPU:
        raise ProcessFailed(f"it took longer than {limits.seconds} s", timed_out=True)
    if process.returncode != 0:
        raise ProcessFailed(f"it failed, or needs more than {limits.memory_bytes} bytes of memory", timed_out=False)
    return outputs[0]
