"""Calls parsers of untrusted files in child processes with limits on memory and time.

Damaged or hostile files can make a parser allocate gigabytes, run for hours or crash. Then only the child process ends.

A program that needs a parser starts one helper process (``limited_process_child``), which imports the parser once and
forks a child process for each call: a fork takes milliseconds, a start with imports a second. Calls share no
state, each has its own limits, and calls of several threads run in parallel. The reasons are in
docs/decisions/0022-limited-child-processes.md.
"""

import atexit
import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any, Final

import msgspec

from gateway.runtime.workers.limited_process_child import CALL, DATA, ERROR, RESULT, receive_message, send_message
from renderers.stop import check_stop

_PROGRAM: Final = Path(__file__).with_name("limited_process_child.py")
_SECONDS_BETWEEN_STOP_CHECKS: Final = 0.05
ELAPSED_FACTOR: Final = 4
"""Maximum elapsed time of a call, divided by its CPU time: child processes have a lower priority than the server."""
_HELPER_SECONDS: Final = 60.0
"""Maximum time of the helper process to import a parser, on a loaded machine. Imports take 0.2 to 0.7 s."""


@dataclass(frozen=True, slots=True)
class ProcessLimits:
    """Limits of a call."""

    memory_bytes: int
    """Address space of the child process, without that of the helper process. macOS does not limit it."""
    seconds: int
    """CPU time after which the child process is killed. Elapsed time may be ``ELAPSED_FACTOR`` times as long."""


class ProcessFailed(Exception):  # noqa: N818 - expected for damaged files
    """The child process crashed, exceeded a limit, or could not be started."""

    def __init__(self, reason: str, *, timed_out: bool = False) -> None:
        super().__init__(reason)
        self.timed_out = timed_out
        """True if the process exceeded its time; False if it crashed or ran out of memory."""


def no_files(name: str) -> bytes:
    """Refuse a file: for parsers that read no other files."""
    raise FileNotFoundError(name)


def call_limited(
    function: str, arguments: tuple[Any, ...], limits: ProcessLimits, read_file: Callable[[str], bytes] = no_files
) -> bytes:
    """Call a function, ``module:name``, in a child process, and return its result, encoded as MessagePack.

    The module should import little. The function's first argument returns the bytes of a file by its name, or raises
    OSError: ``read_file`` does this in this process, and may raise OSError or ValueError. The other arguments are
    values that MessagePack can encode.

    Raises ProcessFailed if the child process failed or exceeded a limit; else the error of ``read_file`` or of the
    current ``StopFlag``, after which the child is killed.
    """
    module, _, name = function.partition(":")
    helper = _running_helper()
    pid, connection = helper.start_child(module, limits)
    seconds = ELAPSED_FACTOR * limits.seconds
    deadline = time.monotonic() + seconds
    timer = threading.Timer(seconds, connection.shutdown, [socket.SHUT_RDWR])  # ends any read and write of ``_call``
    timer.daemon = True
    try:
        with connection, contextlib.suppress(EOFError, ConnectionError):
            timer.start()
            try:
                return _call(connection, name, arguments, limits.memory_bytes, read_file)
            finally:
                timer.cancel()
    finally:
        status = helper.end_child(pid)
    if status == signal.SIGXCPU or time.monotonic() >= deadline:
        reason = f"it took longer than {limits.seconds} s of CPU time, or {ELAPSED_FACTOR} times that in all"
        raise ProcessFailed(reason, timed_out=True)
    raise ProcessFailed(f"it failed, or needs more than {limits.memory_bytes} bytes of memory")


def _call(
    connection: socket.socket, name: str, arguments: tuple[Any, ...], max_bytes: int, read_file: Callable[[str], bytes]
) -> bytes:
    """Send a call, then the files that it needs, until the result arrives.

    Raises EOFError or ConnectionError if the child process has ended, or the connection was shut down.
    """
    with connection.makefile("rwb") as stream:
        kind, body = CALL, msgspec.msgpack.encode((name, arguments))
        while True:
            send_message(stream, kind, body)
            while not wait([connection], _SECONDS_BETWEEN_STOP_CHECKS):
                check_stop()
            kind, body = receive_message(stream, max_bytes)
            check_stop()
            if kind == RESULT:
                return body
            try:
                kind, body = DATA, read_file(str(body, "utf-8", "replace"))
            except (OSError, ValueError) as error:
                kind, body = ERROR, str(error).encode("utf-8", "replace")


class _Helper:
    """The process that imports parsers and forks children. Methods are thread-safe."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # its threads reserve gigabytes of address space
        nothing = subprocess.DEVNULL
        with theirs:
            descriptor = theirs.fileno()
            self._process = subprocess.Popen(  # noqa: S603 - our own program
                [sys.executable, "-P", str(_PROGRAM), str(descriptor)],
                stdin=nothing,
                stdout=nothing,
                stderr=nothing,
                env=environment,
                pass_fds=[descriptor],
                start_new_session=True,  # signals for this process group, as from Ctrl+C, do not end it
            )
        self._socket = ours
        self._socket.settimeout(_HELPER_SECONDS)
        self._lock = threading.Lock()
        self.has_failed = False

    def start_child(self, module: str, limits: ProcessLimits) -> tuple[int, socket.socket]:
        """Return the process id of a new child process, and a connection to it. ``end_child`` must follow."""
        ours, theirs = socket.socketpair()
        with theirs:
            request = f"{module} {limits.memory_bytes} {limits.seconds}"
            try:
                return self._ask(request, [theirs.fileno()]), ours
            except BaseException:
                ours.close()
                raise

    def end_child(self, pid: int) -> int:
        """Kill a child process if it still runs. Return the signal that ended it; 0 if it returned."""
        with contextlib.suppress(ProcessFailed):
            return self._ask(str(pid), [])
        return 0

    def close(self) -> None:
        """End the process, which kills its children."""
        self.has_failed = True
        self._socket.close()
        self._process.kill()
        self._process.wait()

    def _ask(self, request: str, descriptors: list[int]) -> int:
        """Send a request, and return the number that is its response."""
        with self._lock:
            try:
                socket.send_fds(self._socket, [request.encode()], descriptors)
                response = self._socket.recv(4096).decode("utf-8", "replace")
            except OSError as error:  # TimeoutError, too
                self.close()
                raise ProcessFailed(f"the helper process does not respond: {error.strerror or error}") from None
            if response.isdigit():
                return int(response)
            if not response:
                self.close()
            raise ProcessFailed(response or "the helper process has ended")


_lock = threading.Lock()
_helper: _Helper | None = None


def _running_helper() -> _Helper:
    """Return the helper process of this program. The first call starts it; a later one replaces it if it has failed."""
    global _helper
    with _lock:
        if _helper is None or _helper.has_failed:
            try:
                _helper = _Helper()
            except OSError as error:
                raise ProcessFailed(f"no process can be started: {error.strerror}") from None
        return _helper


def _close_helper() -> None:
    if _helper is not None and not _helper.has_failed:
        _helper.close()


atexit.register(_close_helper)
