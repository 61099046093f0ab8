"""Supervisor of several processes of one program: replaces those that end or hang, and ends all at a signal.

The main loop waits for signals and for all processes at once, so that it never waits for one of them alone. SIGTERM and
SIGINT end all processes; SIGHUP replaces them, one after the other.
"""

from __future__ import annotations

import math
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from typing import Any, Final

import structlog

from gateway.runtime.supervised_process import BEAT_SECONDS, READY_SECONDS, ChildProcess

_log = structlog.get_logger("gateway")

START_FAILED: Final = 3
"""Exit code of a process that cannot start. The supervisor then stops, unless another process is ready."""
KILL_SECONDS: Final = 1.0
"""Time from the end of ``stop_seconds`` until a process that still runs is killed."""


class Supervisor:
    """Runs processes until a signal."""

    def __init__(
        self,
        target: Callable[[Connection], object],
        count: int,
        *,
        unresponsive_seconds: float,
        stop_seconds: float,
    ) -> None:
        """
        Args:
            target: function of each process; picklable. It gets the connection for its ``Heartbeat``.
            count: number of processes.
            unresponsive_seconds: time without heartbeat after which a process is killed and replaced.
            stop_seconds: time in which a process ends after SIGTERM. It is killed ``KILL_SECONDS`` later.
        """
        self._target = target
        self._count = count
        self._unresponsive_seconds = unresponsive_seconds
        self._kill_seconds = stop_seconds + KILL_SECONDS
        self._running: list[ChildProcess] = []
        self._outdated: list[ChildProcess] = []
        """Processes to replace since the last SIGHUP."""
        self._replacement: ChildProcess | None = None
        """The process that starts for the first of ``_outdated``."""
        self._ending: dict[ChildProcess, float] = {}
        """Processes that got SIGTERM, with the monotonic times at which they are killed."""
        self._has_failed = False

    def run(self) -> bool:
        """Run until SIGTERM or SIGINT, or until no process can start; return False in the latter case."""
        with _signals(signal.SIGTERM, signal.SIGINT, signal.SIGHUP) as received:
            stopping = False
            while not stopping and not self._has_failed:
                self._start_missing()
                self._wait(received)
                self._reap()
                self._kill_hung()
                numbers = _take(received)
                if signal.SIGHUP in numbers:
                    _log.info("All processes are replaced")
                    self._outdated = list(self._running)
                    if self._replacement is not None:  # it started before the signal
                        self._end(self._replacement)
                self._replace_outdated()
                stopping = not {signal.SIGTERM, signal.SIGINT}.isdisjoint(numbers)
            if self._has_failed:
                _log.error("No process can start, so all end")
            self._end(*self._all())
            while self._ending:
                self._wait(received)
                self._reap()
                self._kill_hung()
                _take(received)
        return not self._has_failed

    def _all(self) -> list[ChildProcess]:
        replacement = [self._replacement] if self._replacement is not None else []
        return [*self._running, *replacement, *self._ending]

    def _start_missing(self) -> None:
        while len(self._running) < self._count and (child := self._start()) is not None:
            self._running.append(child)

    def _start(self) -> ChildProcess | None:
        try:
            return ChildProcess(self._target)
        except OSError as error:
            _log.error("A process could not be started, which is tried again", reason=error.strerror)
            return None

    def _wait(self, received: socket.socket) -> None:
        """Wait for a signal or the end of a process, at most ``BEAT_SECONDS``, and read the heartbeats."""
        seconds = min((deadline - time.monotonic() for deadline in self._ending.values()), default=BEAT_SECONDS)
        sentinels = [child.process.sentinel for child in self._all()]
        wait([received, *sentinels], max(0.0, min(seconds, BEAT_SECONDS)))
        for child in self._all():
            child.read_beats()

    def _kill_hung(self) -> None:
        now = time.monotonic()
        for child in self._running:
            if now - child.last_beat > self._unresponsive_seconds:
                _log.error("A process does not respond and is killed", pid=child.pid)
                child.process.kill()
                child.last_beat = math.inf  # kill it only once
        for child, deadline in self._ending.items():
            if now > deadline:
                _log.error("A process has not ended in time and is killed", pid=child.pid)
                child.process.kill()
                self._ending[child] = math.inf

    def _reap(self) -> None:
        """Remove the processes that have ended."""
        for child in self._all():
            if (code := child.process.exitcode) is None:
                continue
            was_told = child in self._ending
            if child is self._replacement:
                self._keep_outdated()
            self._remove(child)
            if not was_told:
                _log.error("A process has ended", pid=child.pid, exit_code=code)
                self._has_failed |= code == START_FAILED and not any(each.ready for each in self._running)
            child.close()

    def _replace_outdated(self) -> None:
        """Do the next step of the replacement after SIGHUP, if one is due."""
        new = self._replacement
        if new is not None and new.ready:
            self._end(*self._outdated[:1])  # none if all of them have ended meanwhile
            self._replacement = None
            self._running.append(new)
            self._end(*self._running[self._count :])
        elif new is not None and time.monotonic() - new.started > READY_SECONDS:
            self._keep_outdated()
            self._end(new)
        elif new is None and self._outdated:
            self._replacement = self._start()

    def _keep_outdated(self) -> None:
        _log.error("A new process is not ready; the old ones stay")
        self._replacement = None
        self._outdated = []

    def _end(self, *children: ChildProcess) -> None:
        for child in children:
            deadline = self._ending.get(child, time.monotonic() + self._kill_seconds)
            self._remove(child)
            child.process.terminate()
            self._ending[child] = deadline

    def _remove(self, child: ChildProcess) -> None:
        if child is self._replacement:
            self._replacement = None
        self._running = [each for each in self._running if each is not child]
        self._outdated = [each for each in self._outdated if each is not child]
        self._ending.pop(child, None)


@contextmanager
def _signals(*numbers: signal.Signals) -> Iterator[socket.socket]:
    """Yield a socket that receives one byte for each of these signals, its number."""
    received, sender = socket.socketpair()
    received.setblocking(False)
    sender.setblocking(False)
    handlers = {number: signal.signal(number, _ignore) for number in numbers}
    previous = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    try:
        yield received
    finally:
        signal.set_wakeup_fd(previous)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        received.close()
        sender.close()


def _ignore(*_: Any) -> None:
    """Handle a signal; ``signal.set_wakeup_fd`` reports it to the main loop."""


def _take(received: socket.socket) -> set[int]:
    """Return the numbers of the signals since the last call."""
    try:
        return set(received.recv(4096))
    except BlockingIOError:
        return set()
