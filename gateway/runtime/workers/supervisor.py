"""Supervisor of several processes of one program: replaces those that end or hang, and ends all at a signal.

Its loop checks signals and all processes in turn, and never waits for one of them alone. SIGTERM, SIGINT and the end of
the terminal end all processes; any other SIGHUP replaces them, one after the other.
"""

import asyncio
import contextlib
import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Final

import structlog

_log = structlog.get_logger("gateway")

START_FAILED: Final = 3
"""Exit code of a process that cannot start. The supervisor then stops, unless another process is ready."""
BEAT_SECONDS: Final = 0.5
"""Interval between two heartbeats of a process, and between two attempts to start one."""
READY_SECONDS: Final = 60.0
"""Maximum time for the start of a process. After SIGHUP, the old processes stay if a new one takes longer."""
KILL_SECONDS: Final = 4.0
"""Time from the end of ``stop_seconds`` until a process that still runs is killed. Under load its last responses take
some seconds."""
_POLL_SECONDS: Final = 0.1
"""Time in which the supervisor notices a signal."""
TERMINAL_SIGNALS: Final = (signal.SIGINT, signal.SIGHUP)
"""Signals that a terminal sends to all processes. They are blocked in a new one until it unblocks them."""


async def send_heartbeats(connection: Connection, is_ready: Callable[[], bool]) -> None:
    """Send heartbeats with ``is_ready`` until cancelled: the supervisor replaces a process that hangs."""
    os.set_blocking(connection.fileno(), False)
    while True:
        with contextlib.suppress(OSError):  # the supervisor has ended, or does not read
            connection.send(is_ready())
        await asyncio.sleep(BEAT_SECONDS)


def _is_terminal_open() -> bool:
    """Return whether a standard stream is a terminal that was not closed."""
    return any(os.isatty(descriptor) for descriptor in range(3))


class _Child:
    """The supervisor's side of a process."""

    def __init__(self, target: Callable[[Connection], object]) -> None:
        """Start the process. Raises OSError if the system has no resources for it."""
        self.connection, connection = multiprocessing.Pipe(duplex=False)
        try:
            self.process = multiprocessing.get_context("spawn").Process(target=target, args=(connection,))
            signal.pthread_sigmask(signal.SIG_BLOCK, TERMINAL_SIGNALS)
            resource_tracker.ensure_running()  # which the first process would start, and SIGINT is unblocked then
            signal.pthread_sigmask(signal.SIG_BLOCK, TERMINAL_SIGNALS)
            self.process.start()
        except OSError:
            self.connection.close()
            raise
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, TERMINAL_SIGNALS)
            connection.close()
        self.started = time.monotonic()
        self.last_beat = self.started + READY_SECONDS
        """Monotonic time of the last heartbeat. In the future at first: the process has to import its modules."""
        self.ready = False
        self.is_outdated = False
        """True if another process is to replace it (SIGHUP)."""
        self.is_ending = False
        """True once it got SIGTERM."""
        self.kill_time = math.inf
        """Monotonic time at which it is killed if it has not ended."""

    def read_beats(self) -> None:
        with contextlib.suppress(OSError, EOFError):
            while self.connection.poll():
                self.ready = self.connection.recv()
                self.last_beat = time.monotonic()

    def end(self, seconds: float) -> None:
        """Send SIGTERM, and kill the process if it still runs after ``seconds``."""
        self.is_ending = True
        self.kill_time = time.monotonic() + seconds
        self.process.terminate()

    def kill_if_overdue(self, unresponsive_seconds: float) -> None:
        now = time.monotonic()
        if now > self.kill_time:
            _log.error("A process has not ended in time and is killed", pid=self.process.pid)
        elif not self.is_ending and now - self.last_beat > unresponsive_seconds:
            _log.error("A process does not respond and is killed", pid=self.process.pid)
        else:
            return
        self.process.kill()
        self.kill_time = self.last_beat = math.inf  # kill it only once


class Supervisor:
    """Runs processes until a signal."""

    def __init__(
        self, target: Callable[[Connection], object], count: int, *, unresponsive_seconds: float, stop_seconds: float
    ) -> None:
        """Supervise ``count`` processes that run ``target``, which is picklable and gets the connection for
        ``send_heartbeats``.

        A process without heartbeat for ``unresponsive_seconds`` is killed and replaced. One that has not ended
        ``stop_seconds`` after SIGTERM is killed ``KILL_SECONDS`` later.
        """
        self._target = target
        self._count = count
        self._unresponsive_seconds = unresponsive_seconds
        self._seconds_until_kill = stop_seconds + KILL_SECONDS
        self._children: list[_Child] = []
        self._cannot_start = False

    def run(self) -> bool:
        """Run until a signal ends all processes, or no process can start; return False in the latter case."""
        pending_signals: set[int] = set()
        has_terminal = signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN and _is_terminal_open()  # ignored by nohup
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, lambda number, _: pending_signals.add(number))
        while pending_signals <= {signal.SIGHUP} and not self._cannot_start:
            if signal.SIGHUP in pending_signals:
                if has_terminal and not _is_terminal_open():
                    break
                pending_signals.discard(signal.SIGHUP)
                _log.info("All processes are replaced")
                for child in self._serving():
                    child.is_outdated = True
            while len(self._serving()) < self._count and self._start():
                pass
            self._replace_outdated()
            self._check_children()
        if self._cannot_start:
            _log.error("No process can start, so all end")
        self._end(*self._serving())
        while self._children:
            self._check_children()
        return not self._cannot_start

    def _serving(self) -> list[_Child]:
        """Return the processes that did not get SIGTERM."""
        return [child for child in self._children if not child.is_ending]

    def _start(self) -> bool:
        try:
            self._children.append(_Child(self._target))
        except OSError as error:
            _log.error("A process could not be started, which is tried again", reason=error.strerror)
            time.sleep(BEAT_SECONDS)
            return False
        return True

    def _replace_outdated(self) -> None:
        """Do the next step of the replacement after SIGHUP, if one is due."""
        serving = self._serving()
        outdated = [child for child in serving if child.is_outdated]
        starting = [child for child in serving if not (child.is_outdated or child.ready)]
        late = [child for child in starting if time.monotonic() - child.started > READY_SECONDS]
        if not outdated:
            return
        if late:
            self._give_up_replacement()
            self._end(*late)
        elif starting:
            return
        elif len(serving) > self._count:  # a new process is ready
            not_ready = [child for child in outdated if not child.ready]
            self._end((not_ready or outdated)[0])
        else:
            self._start()

    def _give_up_replacement(self) -> None:
        _log.error("A new process is not ready; the old ones stay")
        for child in self._children:
            child.is_outdated = False

    def _end(self, *children: _Child) -> None:
        for child in children:
            child.end(self._seconds_until_kill)

    def _check_children(self) -> None:
        """Wait ``_POLL_SECONDS``, or until a process ends. Read the heartbeats, and remove what has ended or hangs."""
        wait([child.process.sentinel for child in self._children], _POLL_SECONDS)
        for child in [*self._children]:
            child.read_beats()
            if child.process.exitcode is None:
                child.kill_if_overdue(self._unresponsive_seconds)
                continue
            self._children.remove(child)
            if not child.is_ending:
                self._on_unexpected_end(child)
            child.connection.close()
            child.process.close()

    def _on_unexpected_end(self, child: _Child) -> None:
        serving, exit_code = self._serving(), child.process.exitcode
        is_replacement = not (child.is_outdated or child.ready) and any(other.is_outdated for other in serving)
        if is_replacement:
            self._give_up_replacement()
        _log.error("A process has ended", pid=child.process.pid, exit_code=exit_code)
        if exit_code == START_FAILED and not any(other.ready for other in serving):
            self._cannot_start = True
