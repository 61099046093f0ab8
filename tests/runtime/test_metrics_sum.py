"""Metrics of several processes as one text."""

from __future__ import annotations

from gateway.runtime.metrics_registry import Metrics
from gateway.runtime.worker_reports import sum_expositions


def process(renders: int, seconds: float, level: float) -> str:
    metrics = Metrics()
    for _ in range(renders):
        metrics.renders.labels("color", "ok").inc()
        metrics.stage_seconds.labels("queue").observe(seconds)
    metrics.watch("scenegate_level", "Level.", lambda: level)
    metrics.watch("scenegate_interface_ready", "State.", lambda: {"render": min(level, 1.0)}, label="interface")
    metrics.watch("scenegate_steps_total", "Steps.", lambda: {"up": level}, label="way")
    return metrics.exposition().decode()


def test_counters_histograms_and_gauges_are_added() -> None:
    text = sum_expositions((process(2, 0.002, 3.0), process(1, 0.2, 4.0))).decode().splitlines()
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
    text = sum_expositions((process(0, 0.0, 0.0), process(0, 0.0, 1.0))).decode()
    assert 'scenegate_interface_ready{interface="render"} 0.0' in text
    assert text.count("python_info{") == 1
    assert text[text.index("python_info{") :].split("\n", 1)[0].endswith(" 1.0")


def test_of_ended_processes_only_counters_and_histograms_are_left() -> None:
    text = sum_expositions((process(1, 0.2, 3.0),), (process(2, 0.2, 4.0),)).decode()
    assert 'scenegate_renders_total{outcome="ok",type="color"} 3.0' in text
    assert 'scenegate_render_stage_duration_seconds_count{stage="queue"} 3.0' in text
    assert "scenegate_level 3.0" in text


def test_one_process_is_the_same_as_without_a_sum() -> None:
    def values(text: str) -> list[str]:
        return sorted(line for line in text.splitlines() if not line.startswith(("#", "process_")))

    metrics = process(2, 0.5, 1.0)
    assert values(sum_expositions((metrics,)).decode()) == values(metrics)


def test_metrics_of_the_process_are_added() -> None:
    texts = [process(0, 0.0, 0.0), process(0, 0.0, 0.0)]
    total = sum_expositions(texts).decode()

    def memory(text: str) -> float:
        (line,) = (line for line in text.splitlines() if line.startswith("process_resident_memory_bytes "))
        return float(line.split()[1])

    assert memory(total) == sum(map(memory, texts))
