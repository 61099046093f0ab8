"""Both ends of the heartbeat between a supervised process and its supervisor."""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Final

BEAT_SECONDS: Final = 0.5
"""Interval between two heartbeats of a process, and between two attempts to start one."""
READY_SECONDS: Final = 60.0
"""Maximum time for the start of a process. After SIGHUP, the old processes stay if a new one takes longer."""


class Heartbeat:
    """The process's side: sends heartbeats, which state whether the process is ready.

    A thread sends them while the process imports its modules; then the event loop does, in ``beat``.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._in_loop = False
        os.set_blocking(connection.fileno(), False)
        threading.Thread(target=self._beat_before_loop, name="heartbeat", daemon=True).start()

    async def beat(self, is_ready: Callable[[], bool]) -> None:
        """Beat from the event loop, until cancelled: a process whose loop hangs is replaced."""
        self._in_loop = True
        while True:
            self._send(is_ready())
            await asyncio.sleep(BEAT_SECONDS)

    def _beat_before_loop(self) -> None:
        while not self._in_loop:
            self._send(False)
            time.sleep(BEAT_SECONDS)

    def _send(self, is_ready: bool) -> None:
        with contextlib.suppress(OSError):  # the supervisor has ended, or does not read
            self._connection.send(is_ready)


class ChildProcess:
    """The supervisor's side: a process, and the time of its last heartbeat."""

    def __init__(self, target: Callable[[Connection], object]) -> None:
        """Start the process.

        Raises:
            OSError: the system has no resources for it.
        """
        self.connection, connection = multiprocessing.Pipe(duplex=False)
        try:
            self.process: SpawnProcess = multiprocessing.get_context("spawn").Process(target=target, args=(connection,))
            self.process.start()
        except OSError:
            self.connection.close()
            raise
        finally:
            connection.close()
        assert self.process.pid is not None
        self.pid: Final = self.process.pid
        self.started = time.monotonic()
        self.last_beat = self.started + READY_SECONDS
        """Monotonic time of the last heartbeat. In the future at first: the interpreter has to start."""
        self.ready = False

    def read_beats(self) -> None:
        with contextlib.suppress(OSError, EOFError):
            while self.connection.poll():
                self.ready = self.connection.recv()
                self.last_beat = time.monotonic()

    def close(self) -> None:
        """Release the resources of a process that has ended."""
        self.connection.close()
        self.process.close()
