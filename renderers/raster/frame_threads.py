"""The threads that work on frames: each caller's own, and helper threads that all callers share."""

import ctypes
import itertools
import os
import sys
import threading
import time
import weakref
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import SimpleQueue
from typing import Protocol

from renderers.stop import current_stop

Work = Callable[[int], object]

_processor: Callable[[], int] = ctypes.PyDLL(None).sched_getcpu if sys.platform == "linux" else lambda: -1
"""Return the number of the processor that the caller runs on; negative if unknown."""


class Task(Protocol):
    """Work that its callers share; a call returns when all of it is done and never raises."""

    @property
    def threads(self) -> int:
        """Maximum number of threads that can share the work."""
        ...

    def __call__(self) -> object: ...

    def help(self) -> object:
        """Like a call, but may return before all is done."""
        ...


class _Job:
    """``work(0) .. work(units - 1)``. Every thread that calls ``run`` takes units until none are left."""

    def __init__(self, units: int, work: Work) -> None:
        self.threads = units
        self._work = work
        # next() of itertools.count is atomic.
        self._taken = itertools.count()
        self._done = itertools.count(1)
        self._finished = units == 0
        self.error: BaseException | None = None
        self._stop = current_stop()

    def __call__(self) -> None:
        for unit in self._taken:
            if unit >= self.threads:
                break
            try:
                if self.error is None:
                    self._stop.check()
                    self._stop.run(partial(self._work, unit))
            except BaseException as error:  # noqa: BLE001  raised again in the caller's thread
                self.error = error
            finally:
                if next(self._done) == self.threads:
                    self._finished = True
        while not self._finished:
            time.sleep(0)  # other threads work on the last units

    help = __call__


class FrameThreads:
    """A caller's thread and up to ``threads - 1`` helper threads.

    The calling thread always takes part. While helpers are late or busy with other callers' jobs, it does all of the
    work, so that no job waits for a free thread.
    """

    def __init__(self, threads: int, spare: Callable[[], int] | None = None) -> None:
        """
        Args:
            spare: returns the number of idle processors, beyond which no helpers are used; None: no such limit.
        """
        if threads < 1:
            raise ValueError(f"threads must be at least 1, got {threads}")
        self.threads = threads
        self._spare = spare
        self._lock = threading.Lock()
        self._callers = 0  # threads that are in ``share``
        self._jobs: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
        self._helpers: list[threading.Thread] = []
        self._closed = False
        self._pinned_off = -1
        # Without ``close``, helpers end when this object is collected.
        self._finalizer = weakref.finalize(self, _end, self._jobs, self._helpers)

    def run(self, units: int, work: Work) -> None:
        """Call ``work(0) .. work(units - 1)`` in parallel, in any order, under the caller's ``StopFlag``.

        The first error of a unit is raised after all calls have ended; units that have not begun are skipped.
        """
        job = _Job(units, work)
        self.share(job)
        if job.error is not None:
            raise job.error

    def share(self, task: Task) -> None:
        """Run a task in the caller's thread and in idle helper threads.

        Raises:
            Exception: the current ``StopFlag`` was set; the task's results are incomplete.
        """
        with self._lock:
            self._callers += 1
            helpers = min(self.threads - self._callers, task.threads - 1)
        if helpers > 0 and self._spare is not None:
            helpers = min(helpers, self._spare())  # sharing costs more than it gains when all processors are busy
        try:
            if helpers > 0 and not self._closed:
                if len(self._helpers) < self.threads - 1:
                    self._start()
                self._pin_helpers()
                for _ in range(helpers):
                    self._jobs.put(task.help)
        finally:  # also when interrupted: a helper's work must live until it is done
            try:
                task()
            finally:
                with self._lock:
                    self._callers -= 1
        current_stop().check()

    def _start(self) -> None:
        with self._lock:
            while not self._closed and len(self._helpers) < self.threads - 1:
                name = f"scenegate-raster-{len(self._helpers)}"
                helper = threading.Thread(target=_help, args=(self._jobs,), name=name, daemon=True)
                helper.start()
                self._helpers.append(helper)
                self._pinned_off = -1

    def _pin_helpers(self) -> None:
        """Keep helpers off the processor that the caller runs on.

        Linux wakes a thread where it ran last. On processors that share no cache, as in small virtual machines, a
        helper that once ran on the caller's processor waits there for milliseconds while another one is idle.
        """
        processor = _processor()
        if processor == self._pinned_off or processor < 0:
            return
        self._pinned_off = processor
        with suppress(OSError):  # a sandbox may forbid it
            others = os.sched_getaffinity(0) - {processor}
            for helper in self._helpers:
                if others and helper.native_id is not None:
                    os.sched_setaffinity(helper.native_id, others)

    def close(self) -> None:
        """End the helpers once they are idle."""
        with self._lock:
            self._closed = True
        self._finalizer()
        for helper in self._helpers:
            helper.join()


def _help(jobs: SimpleQueue[Callable[[], object] | None]) -> None:
    """Run a helper thread."""
    while (work := jobs.get()) is not None:
        work()
        del work  # keeps nothing alive while idle


def _end(jobs: SimpleQueue[Callable[[], object] | None], helpers: list[threading.Thread]) -> None:
    for _ in helpers:
        jobs.put(None)
