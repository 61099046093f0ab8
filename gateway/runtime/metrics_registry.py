"""Figures for Prometheus, in a registry of their own so that two applications in one process do not collide."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Counter,
    Gauge,
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
"""A cached render takes about a millisecond, a queue of large scenes a minute."""


_LABELLED = 512
"""Labels' figures that are found at once."""

Reading = float | Mapping[str, float]
"""One figure, or one for each value of a label."""


@dataclass(frozen=True, slots=True)
class _Watched:
    """A figure that somebody else keeps."""

    name: str
    text: str
    read: Callable[[], Reading]
    label: str
    total: bool

    def family(self) -> Metric:
        kind = CounterMetricFamily if self.total else GaugeMetricFamily
        labels = (self.label,) if self.label else ()
        family: CounterMetricFamily | GaugeMetricFamily = kind(self.name, self.text, labels=labels)
        found = self.read()
        for value, figure in found.items() if isinstance(found, Mapping) else (("", found),):
            family.add_metric((value,) if self.label else (), figure)
        return family


class _Reader(Collector):
    """Reads what is watched when Prometheus asks: keeping a second copy up to date would cost at every event."""

    def __init__(self) -> None:
        self.watched: list[_Watched] = []

    def collect(self) -> Iterator[Metric]:
        for each in self.watched:
            yield each.family()


class Metrics:
    """What is counted, by name."""

    def __init__(self) -> None:
        # A second time series for each counter and histogram, which no alert or graph reads.
        disable_created_metrics()  # type: ignore[no-untyped-call]
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
        self.in_flight = Gauge(
            "scenegate_http_requests_in_flight",
            "HTTP requests received and not yet fully answered.",
            registry=self.registry,
        )

        self.renders = Counter(
            "scenegate_renders_total",
            "Requests of the render endpoint, by type of image and by outcome: ok, rejected (a bad request), "
            "busy (503), slow (503 at --render-seconds), gone (the client disconnected) or failed (an internal error).",
            ("type", "outcome"),
            registry=self.registry,
        )
        self.stage_seconds = Histogram(
            "scenegate_render_stage_duration_seconds",
            "Seconds that a render request spent in a stage: queue (waiting for a worker thread), parse (reading the "
            "scene), render (drawing) or encode (compressing the image).",
            ("stage",),
            buckets=_SECONDS,
            registry=self.registry,
        )
        # Looking up a label's figure takes longer than to count. Labels are few: routes, not paths.
        self._requests: Callable[..., Counter] = lru_cache(_LABELLED)(self.requests.labels)
        self._seconds: Callable[..., Histogram] = lru_cache(_LABELLED)(self.seconds.labels)
        self._renders: Callable[..., Counter] = lru_cache(_LABELLED)(self.renders.labels)
        self._stage_seconds: Callable[..., Histogram] = lru_cache(_LABELLED)(self.stage_seconds.labels)
        self._reader = _Reader()
        self.registry.register(self._reader)

    def answered(self, route: str, method: str, status: int | str, seconds: float) -> None:
        """Counts an HTTP request."""
        self._requests(route, method, status).inc()
        self._seconds(route).observe(seconds)

    def rendered(self, kind: str, outcome: str, stages: Iterable[tuple[str, float]]) -> None:
        """Counts a request of the render endpoint; ``stages`` and their seconds, of one that was drawn."""
        self._renders(kind, outcome).inc()
        for stage, seconds in stages:
            self._stage_seconds(stage).observe(seconds)

    def watch(self, name: str, text: str, read: Callable[[], Reading], *, label: str = "") -> None:
        """A gauge that is read, in the event loop, when Prometheus asks.

        Args:
            label: of a gauge with several figures; ``read`` gives them by its value.
        """
        self._reader.watched.append(_Watched(name, text, read, label, total=False))

    def watch_total(self, name: str, text: str, read: Callable[[], Reading], *, label: str = "") -> None:
        """As ``watch``, for a counter; its name ends in ``_total``."""
        self._reader.watched.append(_Watched(name, text, read, label, total=True))

    def exposition(self) -> bytes:
        """The text format."""
        return generate_latest(self.registry)
