"""Progress of compiling the kernels, as shown by ``/readyz``, the log, a terminal and responses to requests."""

from __future__ import annotations

import logging
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

_LOG_STEP_PERCENT: Final = 20
"""Progress between two lines of the log, percent."""
_BAR_COLUMNS: Final = 80
"""Columns of a terminal that a line with a bar needs."""
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
        values = {"percent": int(100 * self.fraction), "seconds": self.seconds, "seconds_left": self.seconds_left}
        return {"compiling": values}

    def __str__(self) -> str:
        if self.waiting:
            return "waiting for another process that compiles the rendering kernels"
        left = f", about {self.seconds_left} s left" if self.seconds_left else ""
        return f"compiling the rendering kernels, once: {int(100 * self.fraction)} %{left}"


@contextmanager
def show_progress(progress: KernelProgress, log: Callable[..., object], *, bar: bool = True) -> Iterator[None]:
    """Show progress while the block runs: a bar if stderr is a terminal, else a log line every 20 %.

    Args:
        log: called as ``log(event, **fields)``.
        bar: False: log lines on a terminal, too, because other processes write to the same terminal.
    """
    if bar and sys.stderr.isatty():
        with _bar(progress):
            yield
        return
    logged = 0  # percent of the last log line

    def log_line() -> None:
        nonlocal logged
        percent = int(100 * progress.fraction) // _LOG_STEP_PERCENT * _LOG_STEP_PERCENT
        if progress.waiting:
            log("Waiting for another process that compiles the rendering kernels", seconds=progress.seconds)
        elif percent > logged:
            logged = percent
            left = {} if progress.seconds_left is None else {"seconds_left": progress.seconds_left}
            log("Compiling the rendering kernels", percent=percent, seconds=progress.seconds, **left)

    progress.on_change = log_line
    yield


@contextmanager
def show_progress_on_stderr(progress: KernelProgress) -> Iterator[None]:
    """Show progress while the block runs, for commands: a bar on a terminal, else lines on stderr."""

    def write(event: str, *, seconds: float, percent: int | None = None, seconds_left: int | None = None) -> None:
        position = "" if percent is None else f", {percent} %"
        left = "" if seconds_left is None else f", about {seconds_left} s left"
        sys.stderr.write(f"{event}{position}, {seconds:.0f} s{left}\n")

    with show_progress(progress, write):
        yield


@contextmanager
def _bar(progress: KernelProgress) -> Iterator[None]:
    from rich import progress as rich_progress
    from rich.console import Console

    console = Console(stderr=True)
    columns: list[rich_progress.ProgressColumn] = [
        rich_progress.TextColumn("{task.description}"),
        rich_progress.TaskProgressColumn(),
        rich_progress.TextColumn("{task.fields[left]}"),
    ]
    description = "Compiling kernels"
    if console.width >= _BAR_COLUMNS:
        description = "Compiling the rendering kernels, once"
        columns[1:1] = [rich_progress.BarColumn()]
        columns[3:3] = [rich_progress.TimeElapsedColumn()]
    terminal = sys.stderr
    with rich_progress.Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(description, total=1.0, left="")

        def show() -> None:
            left = f"about {progress.seconds_left} s left" if progress.seconds_left else ""
            bar.update(task, completed=progress.fraction, left="another process compiles" if progress.waiting else left)

        progress.on_change = show
        # While the bar is shown, rich replaces sys.stderr with a stream that writes above the bar.
        handlers = [h for h in logging.getLogger().handlers if isinstance(h, logging.StreamHandler)]
        redirected = [handler for handler in handlers if handler.stream is terminal]
        for handler in redirected:
            handler.setStream(sys.stderr)
        try:
            yield
        finally:
            for handler in redirected:
                handler.setStream(terminal)
