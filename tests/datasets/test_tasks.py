"""How tasks are shared among processes of this computer and of a Ray cluster, with processes that are only named."""

from __future__ import annotations

import json
import pickle
import signal
import sys
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.datasets import local_tasks, ray_tasks, worker
from gateway.datasets.errors import DatasetError
from gateway.datasets.job import RenderTask, Result
from tests.datasets.conftest import job_of
from tests.support import forms


@pytest.fixture
def task(tmp_path: Path) -> RenderTask:
    scene = tmp_path / "scenes" / "a.gltf"
    scene.parent.mkdir()
    scene.write_text(json.dumps(forms.gltf()))
    (only,) = job_of(scene.parent, tmp_path / "out").tasks(lambda _: False, "")
    return only


def numbered(task: RenderTask, count: int) -> list[RenderTask]:
    return [replace(task, out=str(number)) for number in range(count)]


@pytest.mark.parametrize(("cores", "tasks", "threads"), [(1, 3, 1), (8, 1, 8), (0, 1, 1), (3, 1, 3)])
def test_one_worker_runs_in_this_process(
    task: RenderTask, cores: int, tasks: int, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[RenderTask] = []

    def run_task(task: RenderTask) -> Result:
        done.append(task)
        return Result()

    monkeypatch.setattr(worker, "run_task", run_task)
    results = list(local_tasks.run_local(numbered(task, tasks), cores))
    assert len(results) == tasks
    assert [each.out for each in done] == [str(number) for number in range(tasks)]
    assert {each.threads for each in done} == {threads}


class FakePool:
    """Runs a task when it is submitted; the tasks named in ``deadly`` kill its process."""

    made = 0
    deadly: dict[str, int]

    def __init__(self) -> None:
        FakePool.made += 1
        self.alive = True

    def __enter__(self) -> FakePool:
        return self

    def __exit__(self, *_: object) -> None:
        self.alive = False

    def submit(self, _: Any, task: RenderTask) -> Future[Result]:
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()), "Ctrl+C would reach a process that starts"
        assert self.alive, "the process of this pool has died"
        future: Future[Result] = Future()
        if self.deadly.get(task.out, 0) > 0:
            self.deadly[task.out] -= 1
            self.alive = False
            future.set_exception(BrokenProcessPool("died"))
        else:
            future.set_result(Result(warnings=(task.out, str(task.threads))))
        return future


@pytest.fixture
def pools(monkeypatch: pytest.MonkeyPatch) -> type[FakePool]:
    FakePool.made, FakePool.deadly = 0, {}
    monkeypatch.setattr(local_tasks, "_single_process_pool", FakePool)
    return FakePool


@pytest.mark.parametrize(
    ("cores", "tasks", "workers", "threads"), [(2, 5, 2, 1), (4, 2, 2, 2), (5, 2, 2, 2), (3, 3, 3, 1)]
)
def test_cores_are_shared_by_the_workers(
    task: RenderTask, pools: type[FakePool], cores: int, tasks: int, workers: int, threads: int
) -> None:
    results = list(local_tasks.run_local(numbered(task, tasks), cores))
    assert pools.made == workers
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert sorted(result.warnings for result in results) == [(str(n), str(threads)) for n in range(tasks)]


@pytest.mark.parametrize(("deaths", "failed"), [(0, 0), (1, 0), (2, 1)])
def test_a_task_whose_process_died_is_repeated_once_at_the_end(
    task: RenderTask, pools: type[FakePool], deaths: int, failed: int
) -> None:
    pools.deadly = {"1": deaths}
    results = list(local_tasks.run_local(numbered(task, 4), 2))
    assert len(results) == 4
    failures = [failure for result in results for failure in result.failures]
    assert [failure.reason for failure in failures] == [local_tasks.DIED_MESSAGE] * failed * len(task.samples)
    if deaths:
        assert results[-1].warnings[:1] == (() if failed else ("1",))
        assert pools.made == 4, "two workers, the replacement of the dead one, and one for the repeated task"


def test_a_process_that_dies_between_two_tasks_is_replaced(
    task: RenderTask, pools: type[FakePool], monkeypatch: pytest.MonkeyPatch
) -> None:
    submit, refusals = FakePool.submit, iter((False, False, True))

    def refusing(self: FakePool, function: Any, task: RenderTask) -> Future[Result]:
        if next(refusals, False):
            raise BrokenProcessPool("died")
        return submit(self, function, task)

    monkeypatch.setattr(FakePool, "submit", refusing)
    results = list(local_tasks.run_local(numbered(task, 4), 2))
    assert sorted(result.warnings[0] for result in results) == ["0", "1", "2", "3"]
    assert pools.made == 3, "two workers, and the replacement of the dead one"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_wait_until_a_process_has_started(
    task: RenderTask, pools: type[FakePool], monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    """The signal comes while the first task is submitted, as if another thread had received it."""
    submit, submitted = FakePool.submit, []

    def interrupted(self: FakePool, function: Any, task: RenderTask) -> Future[Result]:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {number})
        signal.raise_signal(number)
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        submitted.append(task)
        return submit(self, function, task)

    monkeypatch.setattr(FakePool, "submit", interrupted)
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            list(local_tasks.run_local(numbered(task, 4), 2))
    finally:
        assert signal.signal(number, before) is signal.default_int_handler
    assert len(submitted) == 1


class FakeRay(SimpleNamespace):
    """Ray's API, with references that are numbers; the oldest task finishes first."""

    def __init__(self, cores: Any, fails: tuple[str, ...] = (), raises: tuple[str, ...] = ()) -> None:
        super().__init__()
        error = type("RayError", (Exception,), {})
        self.exceptions = SimpleNamespace(RayError=error, RayTaskError=type("RayTaskError", (error,), {}))
        self.resources = {} if cores is None else {"CPU": cores}
        self.fails, self.raises = fails, raises
        self.options: dict[str, Any] = {}
        self.tasks: list[RenderTask] = []
        self.most_running = self.finished = 0
        self.initialised, self.calls = False, list[str]()

    def is_initialized(self) -> bool:
        return self.initialised

    def init(self, address: str, **options: Any) -> None:
        self.calls.append(address)
        if address == "nowhere":
            raise ConnectionError("no answer\nand more")
        assert options == {"log_to_driver": False, "logging_level": "ERROR", "namespace": "scenegate"}

    def shutdown(self) -> None:
        self.calls.append("shutdown")

    def cluster_resources(self) -> dict[str, float]:
        return self.resources

    def remote(self, **options: Any) -> Any:
        self.options = options

        def submit(data: bytes) -> int:
            self.tasks.append(pickle.loads(data))
            self.most_running = max(self.most_running, len(self.tasks) - self.finished)
            return len(self.tasks) - 1

        return lambda _: SimpleNamespace(remote=submit)

    def wait(self, references: list[int]) -> tuple[list[int], list[int]]:
        self.finished += 1
        return references[:1], references[1:]

    def get(self, reference: int) -> bytes:
        out = self.tasks[reference].out
        if out in self.raises:
            raise self.exceptions.RayTaskError()
        if out in self.fails:
            raise self.exceptions.RayError(f"  the node of {out} is gone\nTraceback\n")
        return pickle.dumps(Result(warnings=(out,)))


@pytest.mark.parametrize(("cores", "most"), [(3.0, 6), (1, 2), (None, 2), (0, 1), (0.5, 1)])
def test_every_core_of_the_cluster_has_its_next_task(
    task: RenderTask, cores: Any, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    ray = FakeRay(cores)
    monkeypatch.setitem(sys.modules, "ray", ray)
    results = list(ray_tasks.run_ray(numbered(task, 8), "auto"))
    assert [result.warnings for result in results] == [(str(number),) for number in range(8)]
    assert ray.most_running == most
    assert ray.options == {"num_cpus": 1, "max_retries": 3}
    assert ray.calls == ["auto", "shutdown"]


def test_ray_that_runs_already_is_left_running(task: RenderTask, monkeypatch: pytest.MonkeyPatch) -> None:
    ray = FakeRay(1)
    ray.initialised = True
    monkeypatch.setitem(sys.modules, "ray", ray)
    assert len(list(ray_tasks.run_ray([task], "auto"))) == 1
    assert ray.calls == []


def test_a_task_that_ray_gave_up_fails_alone(task: RenderTask, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", FakeRay(1, fails=("1",), raises=("3",)))
    first, second, third, fourth = ray_tasks.run_ray(numbered(task, 4), "auto")
    assert (first.warnings, third.warnings) == (("0",), ("2",))
    reasons = {failure.reason for failure in second.failures}
    assert reasons == {"Ray gave up after 3 retries: the node of 1 is gone"}
    assert {failure.reason for failure in fourth.failures} == {"the worker failed: RayTaskError"}


def test_ray_without_a_cluster_and_without_ray(task: RenderTask, monkeypatch: pytest.MonkeyPatch) -> None:
    ray = FakeRay(1)
    monkeypatch.setitem(sys.modules, "ray", ray)
    with pytest.raises(DatasetError, match=r"Ray .*nowhere"):
        list(ray_tasks.run_ray([task], "nowhere"))
    assert ray.calls == ["nowhere"]
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(DatasetError, match=r"pip install 'scenegate\[ray\]'"):
        list(ray_tasks.run_ray([task], "auto"))
