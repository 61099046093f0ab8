"""Threads that help the one that asked."""

from __future__ import annotations

import ctypes
import itertools
import os
import sys
import threading
import time
import weakref
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from queue import SimpleQueue
from typing import Protocol

from renderers.stop import current_stop

Work = Callable[[int], object]

_processor: Callable[[], int] = ctypes.PyDLL(None).sched_getcpu if sys.platform == "linux" else lambda: -1
"""Number of the processor that the caller runs on; negative: not known."""


@dataclass(frozen=True, slots=True)
class Phase:
    """Independent units of work: ``work(0) .. work(units - 1)``, in any order, from any thread."""

    units: int
    work: Work


class Task(Protocol):
    """Work that shares itself out among those who call it; a call returns when all is done and never raises."""

    @property
    def threads(self) -> int:
        """How many may be of use."""
        ...

    def __call__(self) -> object: ...

    def help(self) -> object:
        """As a call, but it may return before all is done."""
        ...


class _Job:
    """Phases one after the other; whoever calls ``run`` takes units until none are left."""

    def __init__(self, phases: Sequence[Phase]) -> None:
        self._phases = phases
        # next() of itertools.count is atomic.
        self._taken = [itertools.count() for _ in phases]
        self._ended = [itertools.count(1) for _ in phases]
        self._finished = [phase.units == 0 for phase in phases]
        self.error: BaseException | None = None
        self._stop = current_stop()

    def run(self) -> None:
        for index, phase in enumerate(self._phases):
            for unit in self._taken[index]:
                if unit >= phase.units:
                    break
                try:
                    if self.error is None:
                        self._stop.check()
                        self._stop.run(partial(phase.work, unit))
                except BaseException as error:  # noqa: BLE001  raised again in the caller's thread
                    self.error = error
                finally:
                    if next(self._ended[index]) == phase.units:
                        self._finished[index] = True
            while not self._finished[index]:
                time.sleep(0)  # the last units are under way in other threads: shorter than a sleep


class Crew:
    """A caller and up to ``threads - 1`` helpers. The caller always works itself: when helpers are late or busy with
    other callers' jobs, it does everything, so that a job never waits for a free thread."""

    def __init__(self, threads: int, spare: Callable[[], int] | None = None) -> None:
        """``spare``: tells how many processors nobody else has work for now; None: nobody knows."""
        if threads < 1:
            raise ValueError(f"threads must be at least 1, got {threads}")
        self.threads = threads
        self._spare = spare
        self._lock = threading.Lock()
        self._callers = 0
        self._jobs: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
        self._helpers: list[threading.Thread] = []
        self._closed = False
        self._away = -1
        # A crew that nobody closes ends its helpers when it is collected.
        self._finalizer = weakref.finalize(self, _end, self._jobs, self._helpers)

    def __enter__(self) -> None:
        """Until ``__exit__``, the calling thread counts as one of the crew's threads."""
        with self._lock:
            self._callers += 1

    def __exit__(self, *exc: object) -> None:
        with self._lock:
            self._callers -= 1

    def run(self, phases: Sequence[Phase]) -> None:
        """Do the phases one after the other, each in parallel, under the caller's ``StopFlag``; raises the first error
        of a unit."""
        job = _Job(phases)
        self._share(job.run, job.run, max((p.units for p in phases), default=0))
        if job.error is not None:
            raise job.error

    def share(self, task: Task) -> None:
        """Run a task in the caller's thread and in idle helper threads.

        Raises:
            Exception: the current ``StopFlag`` was set; what the task should have filled is half done.
        """
        self._share(task, task.help, task.threads)
        current_stop().check()

    def _share(self, work: Callable[[], object], help_it: Callable[[], object], threads: int) -> None:
        """Call ``work`` here and ``help_it`` in up to ``threads - 1`` helpers, in which it must not raise."""
        helpers = min(self.threads - max(1, self._callers), threads - 1)
        if helpers > 0 and self._spare is not None:
            helpers = min(helpers, self._spare())  # sharing costs more than it gains where all have work of their own
        try:
            if helpers > 0 and not self._closed:
                if len(self._helpers) < self.threads - 1:
                    self._start()
                self._part()
                for _ in range(helpers):
                    self._jobs.put(help_it)
        finally:  # whatever interrupts this: what a helper works on must live until it is done
            work()

    def _start(self) -> None:
        with self._lock:
            while not self._closed and len(self._helpers) < self.threads - 1:
                name = f"scenegate-raster-{len(self._helpers)}"
                helper = threading.Thread(target=_help, args=(self._jobs,), name=name, daemon=True)
                helper.start()
                self._helpers.append(helper)
                self._away = -1

    def _part(self) -> None:
        """Keep helpers off the processor that the caller runs on.

        Linux wakes a thread where it ran last. Where processors share no cache, as those of small virtual machines, a
        helper that once ran on the caller's waits there for milliseconds beside an idle one, longer than most frames
        take.
        """
        here = _processor()
        if here == self._away or here < 0:
            return
        self._away = here
        with suppress(OSError):  # a sandbox may forbid it
            others = os.sched_getaffinity(0) - {here}
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
    """A helper's life."""
    while (work := jobs.get()) is not None:
        work()
        del work  # nothing is kept alive while there is nothing to do


def _end(jobs: SimpleQueue[Callable[[], object] | None], helpers: list[threading.Thread]) -> None:
    for _ in helpers:
        jobs.put(None)
