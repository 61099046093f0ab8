"""Runs decoders and compilers of other projects in a process of their own, with limits on memory and time.

Damaged or hostile files can make them allocate gigabytes, run for hours or crash; only that process then ends.
"""

from __future__ import annotations

import os
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
    """Limits of a process."""

    memory_bytes: int
    """Address space of the process, where the system can limit it: Windows and macOS cannot."""
    seconds: int
    """Seconds until the process is ended. Where the system can, it limits the seconds of CPU time as well."""


class ProcessFailed(Exception):  # noqa: N818 - the file's fault, an expected outcome
    """The process crashed, or exceeded a limit."""

    def __init__(self, reason: str, *, timed_out: bool) -> None:
        super().__init__(reason)
        self.timed_out = timed_out
        """True if the process was ended by the limit on its time; False if it crashed or ran out of memory."""


def run_limited(program: str, arguments: list[str], stdin: bytes, limits: ProcessLimits) -> bytes:
    """Run a Python program with a process's limits, and return what it writes to stdout.

    Args:
        program: Path of a Python file that imports nothing of this project.
        stdin: Bytes for the program's stdin.

    Raises:
        ProcessFailed: The program failed or exceeded a limit.
        Exception: The error of the current stop flag, which ends the process.
    """
    numbers = [str(limits.memory_bytes), str(limits.seconds)]
    command = [sys.executable, "-P", str(_LAUNCHER), *numbers, program, *arguments]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # its threads reserve gigabytes of address space
    end = time.monotonic() + limits.seconds
    pipe = subprocess.PIPE
    with subprocess.Popen(  # noqa: S603 - our own program
        command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=environment
    ) as process:
        outputs: list[bytes] = []
        # With a timeout, Process.communicate would not pass the rest of a long input after it.
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
    if timed_out or process.returncode == -_signal("SIGXCPU"):
        raise ProcessFailed(f"it took longer than {limits.seconds} s", timed_out=True)
    if process.returncode != 0:
        raise ProcessFailed(f"it failed, or needs more than {limits.memory_bytes} bytes of memory", timed_out=False)
    return outputs[0]


def _signal(name: str) -> int:
    """Return the number of a signal; 0 on systems without it."""
    import signal

    return int(getattr(signal, name, 0))
