"""Runs tasks on the cores of this machine: one process each, because reading scenes holds the GIL."""

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
"""See prctl(2)."""
DIED: Final = "the process that rendered it died twice (out of memory?)"


def run_local(tasks: list[Task], cores: int) -> Iterator[Result]:
    """Yield the results of tasks as they finish.

    A task whose process dies is tried again at the end, with no other process running; if it dies again, it has failed.
    """
    workers = max(1, min(cores, len(tasks)))
    tasks = [replace(task, threads=max(1, cores // workers)) for task in tasks]
    if workers == 1:
        from gateway.datasets.worker import work

        yield from map(work, tasks)
        return
    killed: list[Task] = []
    yield from _in_parallel(deque(tasks), workers, killed)
    for task in killed:
        with _process() as process:
            try:
                yield process.submit(_work, task).result()
            except BrokenProcessPool:
                yield task.failed(DIED)


def _in_parallel(left: deque[Task], workers: int, killed: list[Task]) -> Iterator[Result]:
    """Run tasks, each worker in a pool of its own, so that a broken pool tells which task killed its process.

    Args:
        killed: gets the tasks whose process died.
    """
    with ExitStack() as stack:
        idle = [stack.enter_context(_process()) for _ in range(workers)]
        running: dict[Future[Result], tuple[Task, ProcessPoolExecutor]] = {}
        try:
            while left or running:
                while left and idle:
                    task, process = left.popleft(), idle.pop()
                    running[process.submit(_work, task)] = task, process
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    task, process = running.pop(future)
                    try:
                        result = future.result()
                    except BrokenProcessPool:
                        killed.append(task)
                        process = stack.enter_context(_process())
                    else:
                        yield result
                    idle.append(process)
        finally:
            for future in running:
                future.cancel()


def _process() -> ProcessPoolExecutor:
    """Return a pool of one process. It is spawned, since a forked one would inherit locks that other threads hold."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(1, mp_context=context, initializer=_initialize, initargs=(os.getpid(),))


def _initialize(parent: int) -> None:
    """Ignore Ctrl+C, which the parent handles, and die with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError, AttributeError):  # only Linux has prctl
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before the call
            os._exit(1)


def _work(task: Task) -> Result:
    from gateway.datasets.worker import work  # imports kernels, after the parent has set the cache folder

    return work(task)
