"""Reports of several processes: the status of all together, and counters that outlive a process."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.runtime.logs.metrics_registry import Metrics
from gateway.runtime.workers import worker_reports
from gateway.runtime.workers.worker_reports import WorkerReports, combined_status, sum_expositions

COUNTER = "# HELP scenegate_steps_total Steps.\n# TYPE scenegate_steps_total counter\nscenegate_steps_total {}.0\n"
GAUGE = "# HELP scenegate_level Level.\n# TYPE scenegate_level gauge\nscenegate_level {}.0\n"


def ended_process() -> int:
    """The number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def leave(folder: Path, pid: int, status: str = "ready", steps: int = 0, **changes: object) -> None:
    """The report of another process."""
    WorkerReports(folder, 2, pid).write(status, COUNTER.format(steps) + GAUGE.format(steps))
    file = folder / f"{pid}.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))


def samples(text: bytes) -> dict[str, float]:
    lines = (line.split() for line in text.decode().splitlines() if not line.startswith("#"))
    return {name: float(value) for name, value in lines}


@pytest.mark.parametrize(
    ("own", "others", "status"),
    [
        ("ready", ["ready"], "ready"),
        ("busy", ["ready"], "ready"),
        ("busy", ["busy"], "busy"),
        ("ready", [], "starting"),
        ("ready", ["starting"], "starting"),
        ("ready", ["starting", "ended"], "starting"),
        ("ready", ["restarting"], "degraded"),
        ("restarting", ["ready"], "degraded"),
        ("ready", ["ended"], "degraded"),
        ("ready", ["silent"], "degraded"),
        ("ready", ["failed"], "degraded"),
        ("failed", ["ready"], "degraded"),
        ("failed", ["failed"], "failed"),
        ("restarting", ["ended"], "restarting"),
        ("ready", ["ready", "ended"], "ready"),
        ("stopping", ["ready"], "stopping"),
    ],
)
def test_the_status_is_that_of_all_processes(own: str, others: list[str], status: str) -> None:
    assert combined_status(own, (own, *others), 2) == status


def test_each_process_and_its_state_are_listed(tmp_path: Path) -> None:
    reports = WorkerReports(tmp_path, 2)
    reports.register()
    assert reports.describe("starting")[0] == "starting"
    other = os.getppid()
    leave(tmp_path, other)
    status, workers = reports.describe("ready")
    assert status == "ready"
    assert workers == {"count": 2, "this": os.getpid(), "states": {str(os.getpid()): "ready", str(other): "ready"}}


def test_a_process_without_recent_report_is_silent(tmp_path: Path) -> None:
    reports = WorkerReports(tmp_path, 2)
    reports.register()
    leave(tmp_path, os.getppid(), time=-1.0 - worker_reports.SILENT_SECONDS)
    status, workers = reports.describe("ready")
    assert (status, workers["states"][str(os.getppid())]) == ("degraded", "silent")


def test_a_replacement_takes_over_the_counters_of_one_process(tmp_path: Path) -> None:
    first, second = ended_process(), ended_process()
    leave(tmp_path, first, steps=5, replaced_metrics=COUNTER.format(100))
    leave(tmp_path, second, steps=7)
    reports = WorkerReports(tmp_path, 2)
    reports.register()
    assert reports.is_replacement
    assert len(list(tmp_path.iterdir())) == 2
    assert reports.describe("restarting")[1]["states"] == {str(os.getpid()): "restarting"}
    total = samples(reports.sum_metrics(COUNTER.format(1) + GAUGE.format(1)))
    assert total == {"scenegate_steps_total": 113.0, "scenegate_level": 1.0}


def test_a_starting_replacement_is_restarting(tmp_path: Path) -> None:
    leave(tmp_path, ended_process())
    reports = WorkerReports(tmp_path, 1)
    reports.register()
    (file,) = tmp_path.iterdir()
    assert json.loads(file.read_text())["status"] == "restarting"


def test_the_first_process_replaces_none(tmp_path: Path) -> None:
    leave(tmp_path, os.getppid())
    reports = WorkerReports(tmp_path, 2)
    reports.register()
    assert not reports.is_replacement


def test_a_process_beside_all_others_will_replace_one(tmp_path: Path) -> None:
    leave(tmp_path, os.getppid())
    reports = WorkerReports(tmp_path, 1)
    reports.register()
    assert reports.is_replacement
    assert reports.describe("restarting")[0] == "degraded"


def test_a_process_starts_although_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    leave(tmp_path, ended_process(), steps=3)
    leave(tmp_path, os.getppid(), steps=4)
    reports = WorkerReports(tmp_path, 2)

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_text", full)
        reports.register()
    assert samples(reports.sum_metrics(""))["scenegate_steps_total"] == 7.0
    assert reports.describe("ready")[0] == "ready"
    other = WorkerReports(tmp_path, 2, os.getppid())
    assert samples(other.sum_metrics(COUNTER.format(4)))["scenegate_steps_total"] == 7.0
    assert other.describe("ready")[0] == "degraded"


def test_the_number_of_an_ended_process_may_be_that_of_another_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave(tmp_path, os.getppid())

    def forbidden(*_: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "kill", forbidden)
    assert WorkerReports(tmp_path, 2).describe("ready")[0] == "degraded"


def metrics_of_process(renders: int, seconds: float, level: float) -> str:
    metrics = Metrics()
    for _ in range(renders):
        metrics.renders.labels("color", "ok").inc()
        metrics.stage_seconds.labels("queue").observe(seconds)
    metrics.watch("scenegate_level", "Level.", lambda: level)
    metrics.watch("scenegate_interface_ready", "State.", lambda: {"render": min(level, 1.0)}, label="interface")
    metrics.watch("scenegate_steps_total", "Steps.", lambda: {"up": level}, label="way")
    return metrics.exposition().decode()


def test_counters_histograms_and_gauges_are_added() -> None:
    text = sum_expositions((metrics_of_process(2, 0.002, 3.0), metrics_of_process(1, 0.2, 4.0))).decode().splitlines()
    assert 'scenegate_renders_total{outcome="ok",type="color"} 3.0' in text
    assert 'scenegate_render_stage_duration_seconds_bucket{le="0.001",stage="queue"} 0.0' in text
    assert 'scenegate_render_stage_duration_seconds_bucket{le="0.0025",stage="queue"} 2.0' in text
    assert 'scenegate_render_stage_duration_seconds_bucket{le="+Inf",stage="queue"} 3.0' in text
    assert 'scenegate_render_stage_duration_seconds_count{stage="queue"} 3.0' in text
    assert 'scenegate_steps_total{way="up"} 7.0' in text
    assert "scenegate_level 7.0" in text
    assert "# TYPE scenegate_renders_total counter" in text
    assert "# TYPE scenegate_level gauge" in text
    assert text.count("# HELP scenegate_level Level.") == 1


def test_constants_and_states_are_the_least() -> None:
    text = sum_expositions((metrics_of_process(0, 0.0, 0.0), metrics_of_process(0, 0.0, 1.0))).decode()
    assert 'scenegate_interface_ready{interface="render"} 0.0' in text
    assert text.count("python_info{") == 1
    assert text[text.index("python_info{") :].split("\n", 1)[0].endswith(" 1.0")


def test_of_ended_processes_only_counters_and_histograms_are_left() -> None:
    text = sum_expositions((metrics_of_process(1, 0.2, 3.0),), (metrics_of_process(2, 0.2, 4.0),)).decode()
    assert 'scenegate_renders_total{outcome="ok",type="color"} 3.0' in text
    assert 'scenegate_render_stage_duration_seconds_count{stage="queue"} 3.0' in text
    assert "scenegate_level 3.0" in text


def test_one_process_is_the_same_as_without_a_sum() -> None:
    def values(text: str) -> list[str]:
        return sorted(line for line in text.splitlines() if not line.startswith(("#", "process_")))

    metrics = metrics_of_process(2, 0.5, 1.0)
    assert values(sum_expositions((metrics,)).decode()) == values(metrics)


def test_metrics_of_the_process_are_added() -> None:
    texts = [metrics_of_process(0, 0.0, 0.0), metrics_of_process(0, 0.0, 0.0)]
    total = sum_expositions(texts).decode()

    def memory(text: str) -> float:
        (line,) = (line for line in text.splitlines() if line.startswith("process_resident_memory_bytes "))
        return float(line.split()[1])

    assert memory(total) == sum(map(memory, texts))
