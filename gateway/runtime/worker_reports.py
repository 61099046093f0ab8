"""Reports that the processes of ``serve --workers`` write for each other, so that any of them can respond for all.

Each process has one JSON file in a folder that they share. It holds the process's status and metrics, and the counters
of the processes that it has replaced. docs/decisions/0021-worker-processes.md has the reasons.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from gateway.runtime.metrics_sum import sum_texts

INTERVAL_SECONDS: Final = 0.5
"""Time between two reports of a process: the age that the figures of other processes may have."""
SILENT_SECONDS: Final = 10.0
"""Age of a report after which its process counts as silent: its event loop hangs, or the machine is overloaded."""


@dataclass(frozen=True, slots=True)
class Report:
    """Status and metrics of one process."""

    pid: int
    status: str
    """Status of ``/readyz`` of this process alone; ``restarting`` for a process that replaces another one."""
    metrics: str
    """Its metrics, in Prometheus' text format."""
    ended: str
    """Counters of the processes that it has replaced, in the same format."""
    time: float
    """Time of the report, ``time.monotonic`` of this machine."""

    def state(self) -> str:
        """Return the status; ``silent`` for an old report, ``ended`` if there is no such process."""
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return "ended"
        return "silent" if time.monotonic() - self.time > SILENT_SECONDS else self.status


class WorkerReports:
    """Reports of all processes, seen from one of them. Reading and writing blocks for about a millisecond."""

    def __init__(self, folder: Path, count: int, pid: int | None = None) -> None:
        """
        Args:
            folder: folder for the reports, empty when the first process starts.
            count: number of processes that should run.
            pid: number of the process that reports; default: this one.
        """
        self._folder = folder
        self.count = count
        self._pid = pid if pid is not None else os.getpid()
        self._ended = ""
        self.replaces = False
        """True if this process replaces one that has ended, or that will end when this one is ready (SIGHUP)."""

    def join(self) -> None:
        """Take over the counters of one process that has ended, if any, and write the first report."""
        reports = list(self._read())
        self.replaces = len(reports) >= self.count
        for report in reports:
            if report.state() == "ended" and self._take(report.pid):
                self._ended = sum_texts((), (report.metrics, report.ended)).decode()
                break
        self.write("starting", "")

    def write(self, status: str, metrics: str) -> None:
        """Replace the report of this process.

        Args:
            status: status of ``/readyz`` of this process alone.
            metrics: its metrics, in Prometheus' text format.
        """
        if status == "starting" and self.replaces:
            status = "restarting"
        report = Report(self._pid, status, metrics, self._ended, time.monotonic())
        unfinished = self._file(self._pid).with_suffix(".new")
        unfinished.write_text(json.dumps(asdict(report)), "utf-8")
        unfinished.replace(self._file(self._pid))

    def describe(self, own: str) -> tuple[str, dict[str, Any]]:
        """Return the status of all processes together, and the state of each as plain JSON values.

        Args:
            own: status of this process now.
        """
        states = {self._pid: own, **{report.pid: report.state() for report in self._others()}}
        running = {pid: state for pid, state in states.items() if state != "ended"}
        return combined_status(own, tuple(states.values()), self.count), {
            "count": self.count,
            "this": self._pid,
            "states": {str(pid): state for pid, state in sorted(running.items())},
        }

    def sum_metrics(self, own: str) -> bytes:
        """Return the metrics of all processes together, in Prometheus' text format.

        Args:
            own: metrics of this process now.
        """
        running, ended = [own], [self._ended]
        for report in self._others():
            (ended if report.state() == "ended" else running).append(report.metrics)
            ended.append(report.ended)
        return sum_texts(running, ended)

    def _others(self) -> Iterator[Report]:
        return (report for report in self._read() if report.pid != self._pid)

    def _read(self) -> Iterator[Report]:
        for path in sorted(self._folder.glob("*.json")):
            with contextlib.suppress(FileNotFoundError):  # taken over meanwhile
                yield Report(**json.loads(path.read_text("utf-8")))

    def _take(self, pid: int) -> bool:
        """Remove the report of a process that has ended; False if another process has done it."""
        try:
            self._file(pid).unlink()
        except FileNotFoundError:
            return False
        return True

    def _file(self, pid: int) -> Path:
        return self._folder / f"{pid}.json"


def combined_status(own: str, states: Sequence[str], count: int) -> str:
    """Return the status of all processes together.

    Args:
        own: status of the process that responds.
        states: states of all processes, its own included; ``ended`` for those that have not been replaced.
        count: number of processes that should run.

    Returns:
        ``stopping`` if the responding process stops; ``starting`` before each process was ready for the first time;
        ``ready`` if all serve; ``busy`` if all have a full queue; ``degraded`` if some serve and the others are
        restarting, silent or failed; else the responding process's own status.
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
