"""Run tasks on all cores of this machine, in processes: reading scenes holds the GIL, so threads would wait."""

import contextlib
import ctypes
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import replace
from typing import Final

from gateway.datasets.job import RenderTask, Result

_PR_SET_PDEATHSIG: Final = 1
"""Option of prctl(2): send this process a signal when its parent ends."""
DIED_MESSAGE: Final = "the process that rendered it died twice (out of memory?)"


def run_local(tasks: list[RenderTask], cores: int) -> Iterator[Result]:
    """Yield the results of tasks in the order in which they finish.

    A task whose process died is run again at the end, without other processes. If its process dies again, the task has
    failed.
    """
    worker_count = max(1, min(cores, len(tasks)))
    tasks = [replace(task, threads=max(1, cores // worker_count)) for task in tasks]
    if worker_count == 1:
        from gateway.datasets.worker import run_task

        yield from map(run_task, tasks)
        return
    interrupted = yield from _run_in_parallel(tasks, worker_count)
    interrupted_again = yield from _run_in_parallel(interrupted, 1)
    yield from (task.failed(DIED_MESSAGE) for task in interrupted_again)


def _run_in_parallel(tasks: list[RenderTask], worker_count: int) -> Generator[Result, None, list[RenderTask]]:
    """Yield the results of tasks in the order in which they finish; return the tasks whose process died.

    Each process has its own pool, because all tasks of a pool fail when one of its processes dies.
    """
    pending, interrupted = deque(tasks), list[RenderTask]()
    with ExitStack() as stack:
        idle_pools: list[ProcessPoolExecutor] = []
        running: dict[Future[Result], tuple[RenderTask, ProcessPoolExecutor]] = {}
        try:
            while pending or running:
                while pending and len(running) < worker_count:
                    pool = idle_pools.pop() if idle_pools else stack.enter_context(_single_process_pool())
                    try:
                        future = _submit(pool, pending[0])
                    except BrokenProcessPool:  # its process died after its last task: another pool takes this one
                        continue
                    running[future] = pending.popleft(), pool
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    task, pool = running.pop(future)
                    try:
                        result = future.result()
                    except BrokenProcessPool:
                        interrupted.append(task)
                    else:
                        idle_pools.append(pool)
                        yield result
        finally:
            for future in running:
                future.cancel()
    return interrupted


def _single_process_pool() -> ProcessPoolExecutor:
    """Return a pool of one process. It is not forked, because it would inherit locks that other threads hold."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(1, mp_context=context, initializer=_initialize, initargs=(os.getpid(),))


def _submit(pool: ProcessPoolExecutor, task: RenderTask) -> Future[Result]:
    """Give a task to a pool, which may start its process.

    The process inherits that Ctrl+C is blocked, so that it does not end before ``_initialize`` runs. Here, Ctrl+C and
    SIGTERM wait until the process has its data; another thread may have received them, so blocking is not enough.
    """
    received: list[int] = []
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    handlers = {
        number: signal.signal(number, lambda number, _: received.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        return pool.submit(_run_task, task)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for late in received:
            signal.raise_signal(late)


def _initialize(parent_id: int) -> None:
    """Make this process ignore Ctrl+C, which its parent handles, and die with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError, AttributeError):  # only Linux has prctl
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent_id:  # the parent ended before the call
            os._exit(1)


def _run_task(task: RenderTask) -> Result:
    from gateway.datasets.worker import run_task  # it imports kernels, so the kernel cache must be configured before

    return run_task(task)
