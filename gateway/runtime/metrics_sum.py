"""Sum of the metrics of several processes, from their texts in Prometheus' format."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

MINIMUM: Final = frozenset(
    {"python_info", "process_start_time_seconds", "scenegate_build_info", "scenegate_interface_ready"}
)
"""Gauges of which the minimum is shown: constants and times. All other metrics are added."""
_CUMULATIVE: Final = ("counter", "histogram")

Labels = tuple[tuple[str, str], ...]


def sum_texts(running: Iterable[str], ended: Iterable[str] = ()) -> bytes:
    """Return one text with the sums of all processes' metrics.

    Args:
        running: texts of running processes.
        ended: texts of processes that have ended. Only their counters and histograms count: Prometheus would take a sum
            that falls for a restart, and the whole rest of it for new events.
    """
    total = _Sum()
    for text in running:
        total.add(text, (*_CUMULATIVE, "gauge"))
    for text in ended:
        total.add(text, _CUMULATIVE)
    registry = CollectorRegistry()
    registry.register(total)
    return generate_latest(registry)


class _Sum(Collector):
    def __init__(self) -> None:
        self._families: dict[str, Metric] = {}
        self._values: dict[str, dict[tuple[str, Labels], float]] = {}
        """Values by sample name and labels, of each family."""

    def add(self, text: str, kinds: tuple[str, ...]) -> None:
        """Add the metrics of these kinds: counter, histogram, gauge."""
        for family in text_string_to_metric_families(text):
            if family.type not in kinds:
                continue
            self._families.setdefault(family.name, family)
            values = self._values.setdefault(family.name, {})
            for sample in family.samples:
                key = sample.name, tuple(sample.labels.items())
                if key not in values:
                    values[key] = sample.value
                elif family.name in MINIMUM:
                    values[key] = min(values[key], sample.value)
                else:
                    values[key] += sample.value

    def collect(self) -> Iterator[Metric]:
        """Return the sums."""
        for name, family in self._families.items():
            total = Metric(name, family.documentation, family.type)
            for (sample_name, labels), value in self._values[name].items():
                total.add_sample(sample_name, dict(labels), value)
            yield total
