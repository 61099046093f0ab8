"""Run tasks on a Ray cluster. Every node must have ``scenegate[ray]``, and the folders of scenes and dataset."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from gateway.datasets.errors import DatasetError

if TYPE_CHECKING:
    from gateway.datasets.job import RenderTask, Result

MAX_RETRIES: Final = 3
"""Maximum number of times that Ray repeats a task whose worker process or node died."""
TASKS_PER_CORE: Final = 2
"""Number of tasks per core of the cluster that are submitted at a time. With 2, no core waits for its next task."""


def run_ray(tasks: list[RenderTask], address: str) -> Iterator[Result]:
    """Yield the results of tasks in the order in which they finish.

    ``address``: that of the cluster (``HOST:6379``, ``ray://HOST:10001``, ``auto``), or ``local`` to start one. Raises
    DatasetError if Ray or the cluster is not there.
    """
    try:
        import ray
    except ImportError:
        raise DatasetError("Ray is not installed: pip install 'scenegate[ray]'") from None
    connects_here = not ray.is_initialized()
    if connects_here:
        try:
            ray.init(address, log_to_driver=False, logging_level="ERROR", namespace="scenegate")
        except (ConnectionError, ValueError, RuntimeError, OSError) as error:
            raise DatasetError(f"there is no Ray cluster at {address}: {_first_line(error)}") from None
    try:
        yield from _results(ray, tasks)
    finally:
        if connects_here:
            ray.shutdown()


def _results(ray: Any, tasks: list[RenderTask]) -> Iterator[Result]:
    """Yield the results of tasks in the order in which they finish. ``ray`` is the imported module."""
    run_remotely = ray.remote(num_cpus=1, max_retries=MAX_RETRIES)(run_pickled_task)
    pending = iter(tasks)
    running: dict[Any, RenderTask] = {}
    while True:
        # Nodes may join and leave, so the number of cores may change.
        max_running = max(TASKS_PER_CORE * int(ray.cluster_resources().get("CPU", 1)), 1)
        while len(running) < max_running and (task := next(pending, None)) is not None:
            running[run_remotely.remote(pickle.dumps(task))] = task
        if not running:
            return
        finished, _ = ray.wait(list(running))
        for reference in finished:
            task = running.pop(reference)
            try:
                yield pickle.loads(ray.get(reference))  # noqa: S301 - pickled by our own worker
            except ray.exceptions.RayTaskError as error:  # ``run_task`` raises none, but its imports may
                yield task.failed(f"the worker failed: {_first_line(error)}")
            except ray.exceptions.RayError as error:
                yield task.failed(f"Ray gave up after {MAX_RETRIES} retries: {_first_line(error)}")


def _first_line(error: Exception) -> str:
    """Return the first line of an error's text, or its type if there is none."""
    return next(iter(str(error).strip().splitlines()), type(error).__name__)


def run_pickled_task(task: bytes) -> bytes:
    """Run a task in a worker process of Ray; return the pickled result.

    Task and result are pickled here and not by Ray, because unpickling a task imports Numba, and ``ensure_compiled``
    configures the kernel cache before that.
    """
    from gateway.runtime.kernels.parts import ensure_compiled

    ensure_compiled()
    from gateway.datasets.worker import run_task

    return pickle.dumps(run_task(pickle.loads(task)))  # noqa: S301 - pickled by run_ray
