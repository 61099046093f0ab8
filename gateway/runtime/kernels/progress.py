"""Progress of compiling the kernels, as shown by ``/readyz``, the log, a terminal and responses to requests."""

import logging
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

from scenegate.cli.progress_bar import progress_bar

_LOG_STEP_PERCENT: Final = 20
"""Progress between two lines of the log, percent."""
_MIN_ESTIMATE_FRACTION: Final = 0.1
"""Minimum progress, 0 to 1, for an estimate of the remaining time."""


@dataclass(slots=True)
class KernelProgress:
    """Progress of compiling, counted in functions. Used by one thread."""

    expected: Mapping[str, int]
    """Number of functions to compile, by part of the kernels (``Part.function_count``)."""
    compiled: dict[str, int] = field(default_factory=dict)
    """Number of functions compiled so far, by part; at most the expected one."""
    waiting: bool = False
    """True while another process compiles the kernels and this one waits for it."""
    started: float = field(default_factory=time.monotonic)
    """Time of the start, ``time.monotonic()``."""
    first_compiled: float = math.nan
    """Time of the first compiled function, ``time.monotonic()``. Until then, the child processes import modules."""
    on_change: Callable[[], object] = lambda: None
    """Called after every change."""

    @property
    def seconds(self) -> float:
        """Seconds since the start."""
        return round(time.monotonic() - self.started, 1)

    @property
    def fraction(self) -> float:
        """Fraction of the functions that are compiled, 0 to 1."""
        total = sum(self.expected.values())
        return sum(self.compiled.values()) / total if total else 1.0

    @property
    def percent(self) -> int:
        """``fraction`` in percent."""
        return int(100 * self.fraction)

    @property
    def seconds_left(self) -> int | None:
        """Estimated seconds until the end, at least 1; None while there is no estimate."""
        if self.fraction < _MIN_ESTIMATE_FRACTION:
            return None
        return math.ceil(max(1.0, (time.monotonic() - self.first_compiled) * (1 / self.fraction - 1)))

    def set_waiting(self, waiting: bool) -> None:
        """Set ``waiting``, and call ``on_change`` if it changes."""
        if waiting != self.waiting:
            self.waiting = waiting
            self.on_change()

    def add(self, part: str, *, complete: bool) -> None:
        """Note that one more function of a part is compiled; or all of them, if ``complete``."""
        if math.isnan(self.first_compiled):
            self.first_compiled = time.monotonic()
        expected = self.expected[part]
        self.compiled[part] = expected if complete else min(expected, self.compiled.get(part, 0) + 1)
        self.on_change()

    def describe(self) -> dict[str, Any]:
        """Return the fields that ``/healthz`` and ``/readyz`` show, as JSON values."""
        if self.waiting:
            return {"waiting": "another process compiles the kernels", "seconds": self.seconds}
        values = {"percent": self.percent, "seconds": self.seconds, "seconds_left": self.seconds_left}
        return {"compiling": values}

    def __str__(self) -> str:
        if self.waiting:
            return "waiting for another process that compiles the rendering kernels"
        left = f", about {self.seconds_left} s left" if self.seconds_left else ""
        return f"compiling the rendering kernels, once: {self.percent} %{left}"


@contextmanager
def show_progress(progress: KernelProgress, log: Callable[..., object], *, bar: bool = True) -> Iterator[None]:
    """Show progress while the block runs: a bar if stderr is a terminal, else a log line every 20 %.

    ``bar`` False: log lines on a terminal, too, because other processes write to the same terminal.
    """
    if bar and sys.stderr.isatty():
        with _shown_as_bar(progress):
            yield
        return
    logged = 0  # percent of the last log line

    def log_line() -> None:
        nonlocal logged
        percent = progress.percent // _LOG_STEP_PERCENT * _LOG_STEP_PERCENT
        if progress.waiting:
            log("Waiting for another process that compiles the rendering kernels", seconds=progress.seconds)
        elif percent > logged:
            logged = percent
            left = {} if progress.seconds_left is None else {"seconds_left": progress.seconds_left}
            log("Compiling the rendering kernels", percent=percent, seconds=progress.seconds, **left)

    progress.on_change = log_line
    yield


@contextmanager
def _shown_as_bar(progress: KernelProgress) -> Iterator[None]:
    handlers = logging.getLogger().handlers
    with progress_bar("Compiling the rendering kernels, once", "%", 1.0) as bar:

        def show() -> None:
            note = "another process compiles" if progress.waiting else ""
            bar.update(progress.fraction, progress.percent, note=note)

        def write_log_lines_above(_: logging.LogRecord) -> bool:
            bar.end()  # the next update shows the bar again
            return True

        progress.on_change = show
        for handler in handlers:
            handler.addFilter(write_log_lines_above)
        try:
            yield
        finally:
            for handler in handlers:
                handler.removeFilter(write_log_lines_above)


def write_progress(event: str, *, seconds: float, percent: int | None = None, seconds_left: int | None = None) -> None:
    """Write a line to stderr: the ``log`` of ``show_progress`` for commands."""
    position = "" if percent is None else f", {percent} %"
    left = "" if seconds_left is None else f", about {seconds_left} s left"
    sys.stderr.write(f"{event}{position}, {seconds:.0f} s{left}\n")
