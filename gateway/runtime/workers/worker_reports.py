"""Reports of the processes of ``serve --workers``, from which each process computes status and metrics of all.

Each process writes one JSON file into a shared folder: its status, its metrics, and the counters of the processes that
it has replaced. docs/decisions/0021-worker-processes.md has the reasons.
"""

import contextlib
import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
from prometheus_client import generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

INTERVAL_SECONDS: Final = 0.5
"""Interval between two reports of a process. Metrics of other processes are up to this old."""
SILENT_SECONDS: Final = 10.0
"""Age of a report above which its process is ``silent``: its event loop hangs, or the machine is overloaded."""
MINIMUM_GAUGES: Final = frozenset(
    {"python_info", "process_start_time_seconds", "scenegate_build_info", "scenegate_interface_ready"}
)
"""Gauges of which the result has the minimum instead of the sum: constants, times, and flags that all must have."""
_CUMULATIVE: Final = ("counter", "histogram")
"""Types of metrics whose values never decrease."""

Labels = tuple[tuple[str, str], ...]
"""Names and values of a sample's labels."""


class WorkerReport(msgspec.Struct, frozen=True):
    """Status and metrics of one process."""

    pid: int
    status: str
    """Status of ``/readyz`` of this process alone. It is ``restarting`` while the process starts as a replacement."""
    metrics: str
    """Metrics of the process, in Prometheus' exposition format."""
    replaced_metrics: str
    """Sum of the counters of its predecessor and of all earlier ones, in the same format."""
    time: float
    """Time of the report, ``time.monotonic()``: one clock for all processes of a machine."""

    def state(self) -> str:
        """Return the status; ``silent`` if the report is old; ``ended`` if the process no longer exists."""
        try:
            os.kill(self.pid, 0)
        except OSError:  # none with this id, or one of another user
            return "ended"
        return "silent" if time.monotonic() - self.time > SILENT_SECONDS else self.status


class WorkerReports:
    """Writes the reports of one process and reads those of all. Methods block for about a millisecond."""

    def __init__(self, folder: Path, count: int, pid: int | None = None) -> None:
        """Report to a folder, empty when the first of ``count`` processes starts. ``pid`` None: this process."""
        self._folder = folder
        self.count = count
        self._pid = pid if pid is not None else os.getpid()
        self._replaced_metrics = ""
        self.is_replacement = False
        """True if this process replaces one that has ended, or that will end when this one is ready (SIGHUP)."""

    def register(self) -> None:
        """Write the first report. If a process has ended and none has replaced it, take over its counters."""
        reports = list(self._read())
        self.is_replacement = len(reports) >= self.count
        for report in reports:
            if report.state() == "ended":
                with contextlib.suppress(FileNotFoundError):  # another process has taken it over
                    self._file(report.pid).rename(self._file(self._pid))
                    self._replaced_metrics = sum_expositions((), (report.metrics, report.replaced_metrics)).decode()
                    break
        with contextlib.suppress(OSError):  # with a full disk, the others still read the report taken over, or none
            self.write("starting", "")

    def write(self, status: str, metrics: str) -> None:
        """Replace the report of this process: its status of ``/readyz``, and its metrics in Prometheus' exposition
        format."""
        if status == "starting" and self.is_replacement:
            status = "restarting"
        report = WorkerReport(self._pid, status, metrics, self._replaced_metrics, time.monotonic())
        temporary = self._file(self._pid).with_suffix(".new")
        temporary.write_bytes(msgspec.json.encode(report))
        temporary.replace(self._file(self._pid))

    def describe(self, own: str) -> tuple[str, dict[str, Any]]:
        """Return the combined status, given this process's, and the fields of ``workers`` in ``/healthz`` as JSON
        values."""
        states = {self._pid: own, **{report.pid: report.state() for report in self._others()}}
        running = {pid: state for pid, state in states.items() if state != "ended"}
        return combined_status(own, tuple(states.values()), self.count), {
            "count": self.count,
            "this": self._pid,
            "states": {str(pid): state for pid, state in sorted(running.items())},
        }

    def sum_metrics(self, own: str) -> bytes:
        """Return the sum of the metrics of all processes, given this one's, in Prometheus' exposition format."""
        running, ended = [own], [self._replaced_metrics]
        for report in self._others():
            metrics = ended if report.state() == "ended" else running
            metrics.append(report.metrics)
            ended.append(report.replaced_metrics)
        return sum_expositions(running, ended)

    def _others(self) -> Iterator[WorkerReport]:
        return self._read(skip=self._file(self._pid))

    def _read(self, skip: Path | None = None) -> Iterator[WorkerReport]:
        for path in sorted({*self._folder.glob("*.json")} - {skip}):
            with contextlib.suppress(FileNotFoundError):  # another process has just removed it
                yield msgspec.json.decode(path.read_bytes(), type=WorkerReport)

    def _file(self, pid: int) -> Path:
        return self._folder / f"{pid}.json"


def combined_status(own: str, states: Sequence[str], count: int) -> str:
    """Return the status of all ``count`` processes together, given that of the responding one and the states of all.

    States that are ``ended`` have no replacement yet. The status is ``stopping`` if the responding process stops;
    ``starting`` until each process has been ready once; ``ready`` if all serve; ``busy`` if all have a full queue;
    ``degraded`` if some serve and the others are restarting, silent or failed; else the responding process's own
    status.
    """
    counts = Counter(states)
    running = len(states) - counts["ended"]
    serving = counts["ready"] + counts["busy"]
    if own == "stopping":
        return own
    if counts["starting"] or len(states) < count:
        return "starting"
    if serving == running and running >= count:
        return "ready" if counts["ready"] else "busy"
    return "degraded" if serving else own


def sum_expositions(running_texts: Iterable[str], ended_texts: Iterable[str] = ()) -> bytes:
    """Return the metrics of all processes together, in the same format.

    Of processes that have ended, only counters and histograms are added, since Prometheus interprets a counter that
    decreases as a restart from 0.
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
