"""Progress bar of long commands: count, rate and remaining time."""

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
        self._start = time.monotonic()
        self._first_update: tuple[float, float, float] | None = None
        """Time, ``time.monotonic()``, completed amount and count of the first update."""
        self._last_write = -_UPDATE_SECONDS
        """Time of the last line, ``time.monotonic()``."""
        if shown:
            self._write(f"{description} ...")

    def update(self, completed: float, count: int, *, total: float | None = None, note: str = "") -> None:
        """Show the completed part of ``total`` (None: unchanged), the units so far with their rate, and a note.

        The bar and the remaining time follow from the completed part.
        """
        if total is not None:
            self._total = total
        now = time.monotonic()
        if not self.shown or now - self._last_write < _UPDATE_SECONDS:
            return
        self._last_write = now
        if self._first_update is None:
            self._first_update = now, completed, count
        first_time, first_completed, first_count = self._first_update
        seconds = now - first_time
        rate = f"{(count - first_count) / seconds:.1f}/s" if seconds > 0.0 else ""
        columns = shutil.get_terminal_size().columns
        if not self._total:
            bar, time_text = "", clock_text(now - self._start)
        else:
            bar = _bar(completed / self._total) if columns >= _MIN_COLUMNS else ""
            time_text = "-:--:--"
            if completed > first_completed:
                seconds_each = seconds / (completed - first_completed)
                time_text = clock_text(seconds_each * max(0.0, self._total - completed))
        parts = (self._description, bar, f"{count} {self._unit}", rate, time_text, note)
        self._write(" ".join(part for part in parts if part)[: columns - 1])

    def end(self) -> None:
        """Remove the line."""
        if self.shown:
            self._write("")

    def _write(self, line: str) -> None:
        sys.stderr.write(f"\r\x1b[K{line}")
        sys.stderr.flush()


def _bar(fraction: float) -> str:
    filled = round(min(fraction, 1.0) * _BAR_COLUMNS)
    return "━" * filled + "─" * (_BAR_COLUMNS - filled)


def clock_text(seconds: float) -> str:
    """Return a time as hours, minutes and seconds: ``0:01:30``."""
    minutes, whole_seconds = divmod(int(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{whole_seconds:02}"


@contextmanager
def progress_bar(description: str, unit: str, total: float | None = None) -> Iterator[ProgressBar]:
    """Show a bar on stderr while the block runs, if stderr is a terminal. ``unit``: what is counted, in the plural.

    ``total``: value of ``completed`` at the end; None: not known, and elapsed time is shown instead.
    """
    bar = ProgressBar(description, unit, total, sys.stderr.isatty())
    try:
        yield bar
    finally:
        bar.end()
