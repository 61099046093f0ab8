"""Runs tasks on a Ray cluster. Every node needs the extra ``scenegate[ray]``, and all nodes share the folders."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from gateway.datasets.job import Result, Task

RETRIES: Final = 3
"""Number of times that Ray repeats a task whose worker or node died. Tasks with errors in scenes are not repeated."""
TASKS_PER_CORE: Final = 2
"""Number of submitted tasks per core of the cluster, so that no core waits for its next task."""


class RayUnavailableError(RuntimeError):
    """Ray cannot be used; the message is one sentence."""


def run_ray(tasks: list[Task], address: str) -> Iterator[Result]:
    """Yield the results of tasks as they finish.

    Args:
        address: address of the cluster (``HOST:6379``, ``ray://HOST:10001``, ``auto``), or ``local`` to start one.

    Raises:
        RayUnavailableError: Ray is not installed, or there is no cluster at the address.
    """
    try:
        import ray
    except ImportError:
        raise RayUnavailableError("Ray is not installed: pip install 'scenegate[ray]'") from None
    starts_ray = not ray.is_initialized()
    if starts_ray:
        try:
            ray.init(address, log_to_driver=False, logging_level="ERROR", namespace="scenegate")
        except (ConnectionError, ValueError, RuntimeError, OSError) as error:
            raise RayUnavailableError(f"there is no Ray cluster at {address}: {str(error).splitlines()[0]}") from None
    try:
        yield from _results(ray, tasks)
    finally:
        if starts_ray:
            ray.shutdown()


def _results(ray: Any, tasks: list[Task]) -> Iterator[Result]:
    remote = ray.remote(num_cpus=1, max_retries=RETRIES)(run_pickled_task)
    pending = iter(tasks)
    running: dict[Any, Task] = {}
    while True:
        # Read every time: nodes may join and leave.
        limit = max(TASKS_PER_CORE * int(ray.cluster_resources().get("CPU", 1)), 1)
        while len(running) < limit and (task := next(pending, None)) is not None:
            running[remote.remote(pickle.dumps(task))] = task
        if not running:
            return
        finished, _ = ray.wait(list(running))
        for reference in finished:
            task = running.pop(reference)
            try:
                yield pickle.loads(ray.get(reference))  # noqa: S301 - made by our own worker
            except ray.exceptions.RayError as error:
                yield task.failed(f"Ray gave up after {RETRIES} retries: {str(error).strip().splitlines()[0]}")


def run_pickled_task(task: bytes) -> bytes:
    """Return the pickled result of a pickled task.

    Ray must not unpickle them itself: that imports their classes and so Numba, whose kernel cache must be configured
    before its import.
    """
    from gateway.runtime import kernel_cache
    from gateway.wiring import warmup

    kernel_cache.ensure_cached(warmup.PARTS)
    from gateway.datasets.worker import work

    return pickle.dumps(work(pickle.loads(task)))  # noqa: S301 - made by our own driver
