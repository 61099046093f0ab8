"""Metrics of one application in Prometheus' text format."""

from gateway.runtime.logs.metrics_registry import Metrics


def lines(metrics: Metrics) -> list[str]:
    return metrics.exposition().decode().splitlines()


def test_gauges_and_counters_are_read_at_each_scrape() -> None:
    metrics = Metrics()
    values = {"left": 1.0}
    metrics.watch("scenegate_level", "Level.", lambda: values["left"])
    metrics.watch("scenegate_levels", "Levels by side.", lambda: values, label="side")
    metrics.watch("scenegate_steps_total", "Steps.", lambda: 7.0)
    assert {"scenegate_level 1.0", 'scenegate_levels{side="left"} 1.0', "scenegate_steps_total 7.0"} <= {
        *lines(metrics)
    }
    assert "# TYPE scenegate_steps_total counter" in lines(metrics)
    assert "# TYPE scenegate_levels gauge" in lines(metrics)
    values["left"] = 2.0
    values["right"] = 3.0
    assert {"scenegate_level 2.0", 'scenegate_levels{side="right"} 3.0'} <= {*lines(metrics)}


def test_two_applications_have_metrics_of_their_own() -> None:
    first, second = Metrics(), Metrics()
    first.requests.labels("/", "GET", "200").inc()
    assert 'scenegate_http_requests_total{method="GET",route="/",status="200"} 1.0' in lines(first)
    assert not [line for line in lines(first) if "_created" in line]
    assert not [line for line in lines(second) if line.startswith("scenegate_http_requests_total{")]
