"""Prometheus metrics, in a registry per application so that two in one process do not collide."""

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Final

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Counter,
    Histogram,
    PlatformCollector,
    ProcessCollector,
    disable_created_metrics,
    generate_latest,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

CONTENT_TYPE: Final = CONTENT_TYPE_LATEST

_SECONDS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0)
"""Histogram buckets: a cached render takes about a millisecond, a queue of large scenes a minute."""

Reading = float | Mapping[str, float]
"""A value, or one per value of a label."""


class Metrics(Collector):
    """Metrics of one application."""

    def __init__(self) -> None:
        # Removes a second time series of each counter and histogram.
        disable_created_metrics()  # type: ignore[no-untyped-call]  # has no annotations
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        PlatformCollector(registry=self.registry)
        self.requests = Counter(
            "scenegate_http_requests_total",
            "HTTP requests answered, by route, method and status code.",
            ("route", "method", "status"),
            registry=self.registry,
        )
        self.seconds = Histogram(
            "scenegate_http_request_duration_seconds",
            "Seconds from receiving the head of an HTTP request to sending the end of its response, by route.",
            ("route",),
            buckets=_SECONDS,
            registry=self.registry,
        )
        self.requests_in_flight = 0
        self.renders = Counter(
            "scenegate_renders_total",
            "Requests of the render endpoint, by type of image and by outcome: ok, rejected (a bad request), "
            "busy (503), slow (503 at --render-seconds), gone (the client disconnected) or failed (an internal error).",
            ("type", "outcome"),
            registry=self.registry,
        )
        self.stage_seconds = Histogram(
            "scenegate_render_stage_duration_seconds",
            "Seconds that a render request spent in a stage: receive (from head to last byte), form "
            "(reading the form), queue (waiting for a worker thread), parse (reading the scene), render (drawing), "
            "encode (compressing the image, until the response is ready) or send (until the system has taken it).",
            ("stage",),
            buckets=_SECONDS,
            registry=self.registry,
        )
        # Finding a metric by its labels takes longer than counting.
        self.request = lru_cache(maxsize=256)(self.requests.labels)
        self.request_seconds = lru_cache(maxsize=256)(self.seconds.labels)
        self.render = lru_cache(maxsize=64)(self.renders.labels)
        self.stage = lru_cache(maxsize=16)(self.stage_seconds.labels)
        self._watched: list[tuple[str, str, Callable[[], Reading], str]] = []
        """Arguments of ``watch``."""
        self.watch(
            "scenegate_http_requests_in_flight",
            "HTTP requests received and not yet fully answered.",
            lambda: self.requests_in_flight,
        )
        self.registry.register(self)

    def watch(self, name: str, description: str, read: Callable[[], Reading], *, label: str = "") -> None:
        """Add a metric that is read in the event loop when Prometheus scrapes: a counter (``_total``) or a gauge.

        With a label, ``read`` returns values by the label's value.
        """
        self._watched.append((name, description, read, label))

    def collect(self) -> Iterator[Metric]:
        """Read the watched metrics when Prometheus scrapes, instead of updating copies at every event."""
        for name, description, read, label in self._watched:
            kind = CounterMetricFamily if name.endswith("_total") else GaugeMetricFamily
            family: CounterMetricFamily | GaugeMetricFamily = kind(name, description, labels=(label,) if label else ())
            reading = read()
            for label_value, value in reading.items() if isinstance(reading, Mapping) else (("", reading),):
                family.add_metric((label_value,) if label else (), value)
            yield family

    def exposition(self) -> bytes:
        """Return all metrics in Prometheus' text format."""
        return generate_latest(self.registry)
