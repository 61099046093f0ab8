"""Runs tasks on the cores of this machine, in one process per core, because reading scenes holds the GIL."""

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
from contextlib import ExitStack
from dataclasses import replace
from typing import Final

from gateway.datasets.job import Result, Task

_PR_SET_PDEATHSIG: Final = 1
"""Option of prctl(2): send this process a signal when its parent ends."""
DIED_MESSAGE: Final = "the process that rendered it died twice (out of memory?)"


def run_local(tasks: list[Task], cores: int) -> Iterator[Result]:
    """Yield the results of tasks as they finish.

    A task whose process died is run again at the end, alone. If its process dies again, the task has failed.
    """
    workers = max(1, min(cores, len(tasks)))
    tasks = [replace(task, threads=max(1, cores // workers)) for task in tasks]
    if workers == 1:
        from gateway.datasets.worker import work

        yield from map(work, tasks)
        return
    died: list[Task] = []
    yield from _run_in_parallel(deque(tasks), workers, died)
    for task in died:
        with _single_process_pool() as pool:
            try:
                yield pool.submit(_work, task).result()
            except BrokenProcessPool:
                yield task.failed(DIED_MESSAGE)


def _run_in_parallel(pending: deque[Task], workers: int, died: list[Task]) -> Iterator[Result]:
    """Run tasks. Each worker is a pool of one process: when a process dies, all tasks of its pool fail.

    Args:
        died: gets the tasks whose process died.
    """
    with ExitStack() as stack:
        idle = [stack.enter_context(_single_process_pool()) for _ in range(workers)]
        running: dict[Future[Result], tuple[Task, ProcessPoolExecutor]] = {}
        try:
            while pending or running:
                while pending and idle:
                    task, pool = pending.popleft(), idle.pop()
                    running[pool.submit(_work, task)] = task, pool
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    task, pool = running.pop(future)
                    try:
                        result = future.result()
                    except BrokenProcessPool:
                        died.append(task)
                        pool = stack.enter_context(_single_process_pool())
                    else:
                        yield result
                    idle.append(pool)
        finally:
            for future in running:
                future.cancel()


def _single_process_pool() -> ProcessPoolExecutor:
    """Return a pool of one process. It is spawned: a forked one would inherit locks that other threads hold."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(1, mp_context=context, initializer=_initialize, initargs=(os.getpid(),))


def _initialize(parent: int) -> None:
    """Ignore Ctrl+C, which the parent handles, and die with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError, AttributeError):  # only Linux has prctl
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # the parent ended before the call
            os._exit(1)


def _work(task: Task) -> Result:
    from gateway.datasets.worker import work  # late: it imports kernels, whose cache folder is set by then

    return work(task)
