"""Progress bar of long commands: count, rate and remaining time."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_BAR_COLUMNS: Final = 20
"""Width of the bar."""
_MIN_COLUMNS: Final = 80
"""Columns of a terminal that a line with a bar needs."""
_UPDATE_SECONDS: Final = 0.1
"""Minimum time between two lines."""


class ProgressBar:
    """A bar on a terminal. Elsewhere, updates do nothing."""

    def __init__(self, description: str, unit: str, total: float | None, shown: bool) -> None:
        self._description = description
        self._unit = unit
        self._total = total
        self.shown = shown
        """True if stderr is a terminal, so that a bar is shown."""
        self._begin = time.monotonic()
        self._first_update: tuple[float, float, float] | None = None
        """Time, ``time.monotonic()``, completed amount and count of the first update."""
        self._written = -_UPDATE_SECONDS
        """Time of the last line."""
        if shown:
            self._write(f"{description} ...")

    def update(self, completed: float, count: int, *, total: float | None = None, note: str = "") -> None:
        """Show the current state.

        Args:
            completed: completed amount, 0 to ``total``.
            count: number of units so far. Rate and remaining time follow from the mean since the first update.
            total: value of ``completed`` at the end; None: unchanged.
            note: text at the end of the line.
        """
        now = time.monotonic()
        if not self.shown or now - self._written < _UPDATE_SECONDS:
            return
        self._written = now
        self._total = self._total if total is None else total
        if self._first_update is None:
            self._first_update = now, completed, count
        begin, first_completed, first_count = self._first_update
        rate = f"{(count - first_count) / (now - begin):.1f}/s" if now > begin else ""
        done, left = 0.0, clock(now - self._begin)  # without a total, elapsed time is shown instead
        if self._total:
            done = min(completed / self._total, 1.0)
            seconds_each = (now - begin) / (completed - first_completed) if completed > first_completed else 0.0
            left = clock(seconds_each * max(0.0, self._total - completed)) if seconds_each else "-:--:--"
        columns = shutil.get_terminal_size().columns
        filled = round(done * _BAR_COLUMNS)
        bar = "━" * filled + "─" * (_BAR_COLUMNS - filled) if self._total and columns >= _MIN_COLUMNS else ""
        parts = (self._description, bar, f"{count} {self._unit}", rate, left, note)
        self._write(" ".join(part for part in parts if part)[: columns - 1])

    def end(self) -> None:
        """Remove the line."""
        if self.shown:
            self._write("")

    def _write(self, line: str) -> None:
        sys.stderr.write(f"\r\x1b[K{line}")
        sys.stderr.flush()


def clock(seconds: float) -> str:
    """Return a time as hours, minutes and seconds."""
    minutes, seconds = divmod(int(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{seconds:02}"


@contextmanager
def progress_bar(description: str, unit: str, total: float | None = None) -> Iterator[ProgressBar]:
    """Show a bar on stderr while the block runs, if stderr is a terminal.

    Args:
        description: what is being done.
        unit: what is counted, in the plural.
        total: value of ``completed`` at the end; None: not known, and elapsed time is shown instead.
    """
    bar = ProgressBar(description, unit, total, sys.stderr.isatty())
    try:
        yield bar
    finally:
        bar.end()
