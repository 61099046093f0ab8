"""Threads that help the one that asked."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

Work = Callable[[int], object]


@dataclass(frozen=True, slots=True)
class Phase:
    """Independent units of work: ``work(0) .. work(units - 1)``, in any order, from any thread."""

    units: int
    work: Work


class _Job:
    """Phases one after the other; whoever calls ``run`` takes units until none are left."""

    def __init__(self, phases: Sequence[Phase]) -> None:
        self._phases = phases
        # next() of itertools.count is atomic.
        self._taken = [itertools.count() for _ in phases]
        self._ended = [itertools.count(1) for _ in phases]
        self._finished = [phase.units == 0 for phase in phases]
        self.error: BaseException | None = None

    def run(self) -> None:
        for index, phase in enumerate(self._phases):
            for unit in self._taken[index]:
                if unit >= phase.units:
                    break
                try:
                    if self.error is None:
                        phase.work(unit)
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

    def __init__(self, threads: int) -> None:
        if threads < 1:
            raise ValueError(f"threads must be at least 1, got {threads}")
        self.threads = threads
        self._lock = threading.Lock()
        self._callers = 0
        self._helpers = ThreadPoolExecutor(threads - 1, "scenegate-raster") if threads > 1 else None

    @contextmanager
    def caller(self) -> Iterator[None]:
        """While inside, the calling thread counts as one of the crew's threads."""
        with self._lock:
            self._callers += 1
        try:
            yield
        finally:
            with self._lock:
                self._callers -= 1

    def run(self, phases: Sequence[Phase], *, alone: bool = False) -> None:
        """Do the phases one after the other, each in parallel; raises the first error of a unit.

        Args:
            alone: the work is too small to be worth waking a helper.
        """
        job = _Job(phases)
        if self._helpers is not None and not alone:
            for _ in range(min(self.threads - max(1, self._callers), max((p.units for p in phases), default=0) - 1)):
                self._helpers.submit(job.run)
        job.run()
        if job.error is not None:
            raise job.error

    def close(self) -> None:
        """End the helpers once they are idle."""
        if self._helpers is not None:
            self._helpers.shutdown(wait=True)
