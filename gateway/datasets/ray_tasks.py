"""Tasks on a Ray cluster. Needs the extra ``scenegate[ray]`` on every node, and folders that all nodes share."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from gateway.client.manifest import Failure

if TYPE_CHECKING:
    from gateway.datasets.plan import Result, Task

RETRIES: Final = 3
"""Of a task whose worker or node dies; an error in a scene is no such death and is never tried again."""
WAITING: Final = 2
"""Tasks per core of the cluster that are handed out."""


class RayError(RuntimeError):
    """Ray cannot be used; a sentence."""


def run_ray(tasks: list[Task], address: str) -> Iterator[Result]:
    """Results as they come.

    Args:
        address: of the cluster (``HOST:6379``, ``ray://HOST:10001``, ``auto``), or ``local`` for one of its own.

    Raises:
        RayError: Ray is not installed, or there is no cluster.
    """
    try:
        import ray
    except ImportError:
        raise RayError("Ray is not installed: pip install 'scenegate[ray]'") from None
    owned = not ray.is_initialized()
    if owned:
        try:
            ray.init(address, log_to_driver=False, logging_level="ERROR", namespace="scenegate")
        except (ConnectionError, ValueError, RuntimeError, OSError) as error:
            raise RayError(f"there is no Ray cluster at {address}: {str(error).splitlines()[0]}") from None
    try:
        yield from _results(ray, tasks)
    finally:
        if owned:
            ray.shutdown()


def _results(ray: Any, tasks: list[Task]) -> Iterator[Result]:
    from gateway.datasets.plan import Result

    remote = ray.remote(num_cpus=1, max_retries=RETRIES)(draw)
    waiting = iter(tasks)
    running: dict[Any, Task] = {}
    while True:
        # Asked every time: nodes come and go.
        most = max(WAITING * int(ray.cluster_resources().get("CPU", 1)), 1)
        while len(running) < most and (task := next(waiting, None)) is not None:
            running[remote.remote(pickle.dumps(task))] = task
        if not running:
            return
        finished, _ = ray.wait(list(running))
        for reference in finished:
            task = running.pop(reference)
            try:
                yield pickle.loads(ray.get(reference))  # noqa: S301 - of our own worker
            except ray.exceptions.RayError as error:
                reason = f"Ray gave up after {RETRIES} retries: {str(error).strip().splitlines()[0]}"
                failures = [Failure(task.source.name, view.name, reason) for view in task.views]
                yield Result(task.number, failures=failures)


def draw(task: bytes) -> bytes:
    """A pickled task to its pickled result: pickled, because what a task is made of may only be imported after Numba
    was told where this node keeps its kernels."""
    from gateway.runtime import kernel_cache
    from gateway.wiring import warmup

    kernel_cache.ensure_cached(warmup.PARTS)
    from gateway.datasets.tasks import work

    return pickle.dumps(work(pickle.loads(task)))  # noqa: S301 - of our own driver
