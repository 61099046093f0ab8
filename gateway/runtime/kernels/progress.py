"""Progress of compiling the kernels, as shown by ``/readyz``, the log and responses to requests."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

_LOG_STEP_PERCENT: Final = 20
"""Progress between two lines of the log, percent."""


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

    def set_waiting(self, waiting: bool) -> None:
        """Set ``waiting``, and call ``on_change`` if it changes."""
        if waiting != self.waiting:
            self.waiting = waiting
            self.on_change()

    def add(self, part: str, *, complete: bool) -> None:
        """Note that one more function of a part is compiled; or all of them, if ``complete``."""
        expected = self.expected[part]
        self.compiled[part] = expected if complete else min(expected, self.compiled.get(part, 0) + 1)
        self.on_change()

    def describe(self) -> dict[str, Any]:
        """Return the fields that ``/healthz`` and ``/readyz`` show, as JSON values."""
        if self.waiting:
            return {"waiting": "another process compiles the kernels", "seconds": self.seconds}
        return {"compiling": {"percent": self.percent, "seconds": self.seconds}}

    def __str__(self) -> str:
        if self.waiting:
            return "waiting for another process that compiles the rendering kernels"
        return f"compiling the rendering kernels, once: {self.percent} %"


@contextmanager
def show_progress(progress: KernelProgress, log: Callable[..., object]) -> Iterator[None]:
    """Write a log line every 20 % while the block runs."""
    logged = 0  # percent of the last log line

    def log_line() -> None:
        nonlocal logged
        percent = progress.percent // _LOG_STEP_PERCENT * _LOG_STEP_PERCENT
        if progress.waiting:
            log("Waiting for another process that compiles the rendering kernels", seconds=progress.seconds)
        elif percent > logged:
            logged = percent
            log("Compiling the rendering kernels", percent=percent, seconds=progress.seconds)

    progress.on_change = log_line
    yield


def write_progress(event: str, *, seconds: float, percent: int | None = None) -> None:
    """Write a line to stderr: the ``log`` of ``show_progress`` for commands."""
    position = "" if percent is None else f", {percent} %"
    sys.stderr.write(f"{event}{position}, {seconds:.0f} s\n")
