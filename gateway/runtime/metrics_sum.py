"""Adds up the metrics of several processes, from their texts in Prometheus' exposition format."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from prometheus_client import generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

MINIMUM_GAUGES: Final = frozenset(
    {"python_info", "process_start_time_seconds", "scenegate_build_info", "scenegate_interface_ready"}
)
"""Gauges of which the result has the minimum instead of the sum: constants, times, and flags that all must have."""
_CUMULATIVE: Final = ("counter", "histogram")
"""Types of metrics whose values never decrease."""

Labels = tuple[tuple[str, str], ...]
"""Names and values of a sample's labels."""


def sum_expositions(running_texts: Iterable[str], ended_texts: Iterable[str] = ()) -> bytes:
    """Return the metrics of all processes together, in the same format.

    Args:
        running_texts: texts of running processes.
        ended_texts: texts of processes that have ended. Only their counters and histograms are added, since Prometheus
            interprets a counter that decreases as a restart from 0.
    """
    total = _SumCollector()
    for text in running_texts:
        total.add(text, (*_CUMULATIVE, "gauge"))
    for text in ended_texts:
        total.add(text, _CUMULATIVE)
    return generate_latest(total)


class _SumCollector(Collector):
    """Sums of samples with equal names and labels, as a source of ``generate_latest``."""

    def __init__(self) -> None:
        self._families: dict[str, Metric] = {}
        self._values: dict[str, dict[tuple[str, Labels], float]] = {}
        """Values by sample name and labels, by name of the family."""

    def add(self, text: str, types: tuple[str, ...]) -> None:
        """Add those metrics of a text whose type (counter, histogram, gauge) is one of ``types``."""
        for family in text_string_to_metric_families(text):
            if family.type not in types:
                continue
            self._families.setdefault(family.name, family)
            values = self._values.setdefault(family.name, {})
            for sample in family.samples:
                key = sample.name, tuple(sample.labels.items())
                if key not in values:
                    values[key] = sample.value
                elif family.name in MINIMUM_GAUGES:
                    values[key] = min(values[key], sample.value)
                else:
                    values[key] += sample.value

    def collect(self) -> Iterator[Metric]:
        for name, family in self._families.items():
            summed = Metric(name, family.documentation, family.type)
            for (sample_name, labels), value in self._values[name].items():
                summed.add_sample(sample_name, dict(labels), value)
            yield summed
