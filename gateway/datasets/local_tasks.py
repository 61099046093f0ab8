"""Tasks on the cores of this machine: one process each, since reading scenes holds the interpreter's lock."""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Final

from gateway.client.manifest import Failure
from gateway.datasets.plan import Result, Task, with_threads

WAITING: Final = 2
"""Tasks per worker that are handed out, so that none waits for the next one."""
_PR_SET_PDEATHSIG: Final = 1
"""prctl(2)."""
DIED: Final = "the process that drew it died twice (out of memory?)"


def run_local(tasks: list[Task], workers: int) -> Iterator[Result]:
    """Results as they come.

    A worker that dies takes the whole pool with it (``BrokenProcessPool`` does not say which). What was handed out is
    then tried again alone, task by task, so that only the one that kills its worker fails.
    """
    workers_used = max(1, min(workers, len(tasks)))
    tasks = with_threads(tasks, max(1, workers // workers_used))
    if workers_used == 1:
        from gateway.datasets.tasks import work

        yield from map(work, tasks)
        return
    left = deque(tasks)
    while left:
        suspects: list[Task] = []
        yield from _until_broken(left, workers_used, suspects)
        for task in suspects:
            yield _alone(task)


def _until_broken(left: deque[Task], workers: int, suspects: list[Task]) -> Iterator[Result]:
    """Works off ``left``; after the death of a worker, ``suspects`` has what was handed out."""
    pool = _pool(workers)
    try:
        running: dict[Future[Result], Task] = {}
        while left or running:
            while left and len(running) < WAITING * workers:
                task = left.popleft()
                try:
                    running[pool.submit(_work, task)] = task
                except BrokenProcessPool:
                    left.appendleft(task)
                    break
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task = running.pop(future)
                try:
                    result = future.result()
                except BrokenProcessPool:
                    suspects.append(task)
                else:
                    yield result
            if suspects:
                suspects.extend(running.values())
                return
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _alone(task: Task) -> Result:
    for _ in range(2):
        with _pool(1) as pool:
            try:
                return pool.submit(_work, task).result()
            except BrokenProcessPool:
                continue
    failures = [Failure(task.source.name, view.name, DIED) for view in task.views]
    return Result(task.number, failures=failures)


def _pool(workers: int) -> ProcessPoolExecutor:
    # A forked child would inherit locks that threads of this process hold.
    return ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin, initargs=(os.getpid(),)
    )


def _begin(parent: int) -> None:
    """In a worker: Ctrl+C is for the one that hands out work, and nobody outlives that one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError, AttributeError):  # another system than Linux
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before this was asked for
            os._exit(1)


def _work(task: Task) -> Result:
    from gateway.datasets.tasks import work  # after the environment of the kernels' cache is there

    return work(task)
