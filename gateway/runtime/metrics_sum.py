"""Adds up the metrics of several processes, from their texts in Prometheus' exposition format."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

MINIMUM_GAUGES: Final = frozenset(
    {"python_info", "process_start_time_seconds", "scenegate_build_info", "scenegate_interface_ready"}
)
"""Gauges that are not added: constants and times, of which the minimum is shown."""
_CUMULATIVE: Final = ("counter", "histogram")
"""Kinds of metrics that never fall."""

Labels = tuple[tuple[str, str], ...]
"""Names and values of a sample's labels."""


def sum_expositions(running: Iterable[str], ended: Iterable[str] = ()) -> bytes:
    """Return the metrics of all processes together, in the same format.

    Args:
        running: texts of running processes.
        ended: texts of processes that have ended. Their gauges are left out. Their counters and histograms are added,
            since Prometheus takes a counter that falls for a restart from 0.
    """
    total = _SumCollector()
    for text in running:
        total.add(text, (*_CUMULATIVE, "gauge"))
    for text in ended:
        total.add(text, _CUMULATIVE)
    registry = CollectorRegistry()
    registry.register(total)
    return generate_latest(registry)


class _SumCollector(Collector):
    """Sums of samples with equal names and labels."""

    def __init__(self) -> None:
        self._families: dict[str, Metric] = {}
        self._values: dict[str, dict[tuple[str, Labels], float]] = {}
        """By name of the family: values by sample name and labels."""

    def add(self, text: str, kinds: tuple[str, ...]) -> None:
        """Add the metrics in a text whose kind (counter, histogram, gauge) is one of ``kinds``."""
        for family in text_string_to_metric_families(text):
            if family.type not in kinds:
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
        """Return the sums."""
        for name, family in self._families.items():
            total = Metric(name, family.documentation, family.type)
            for (sample_name, labels), value in self._values[name].items():
                total.add_sample(sample_name, dict(labels), value)
            yield total
