"""Progress bar of long commands: count, rate and remaining time."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

_BAR_COLUMNS: Final = 60
"""Columns of a terminal that a line with a bar needs."""


class ProgressBar:
    """A bar on a terminal. Elsewhere, updates do nothing."""

    def __init__(self, unit: str, bar: Any = None, task: Any = None) -> None:
        self._unit = unit
        self._bar = bar
        self._task = task
        self._first_update: tuple[float, float] | None = None
        """Time, ``time.monotonic()``, and count of the first update."""

    @property
    def shown(self) -> bool:
        """True if stderr is a terminal, so that a bar is shown."""
        return self._bar is not None

    def update(self, completed: float, count: int, *, total: float | None = None, note: str = "") -> None:
        """Show the current state.

        Args:
            completed: completed amount, 0 to ``total``.
            count: number of units so far. The rate is the mean since the first update.
            total: value of ``completed`` at the end; None: unchanged.
            note: text at the end of the line.
        """
        if self._bar is None:
            return
        now = time.monotonic()
        if self._first_update is None:
            self._first_update = now, count
        seconds = now - self._first_update[0]
        rate = f"{(count - self._first_update[1]) / seconds:.1f}/s" if seconds > 0.0 else ""
        changes: dict[str, Any] = {"completed": completed, "count": f"{count} {self._unit}", "rate": rate, "note": note}
        if total is not None:
            changes["total"] = total
        self._bar.update(self._task, **changes)


@contextmanager
def progress_bar(description: str, unit: str, total: float | None = None) -> Iterator[ProgressBar]:
    """Show a bar on stderr while the block runs, if stderr is a terminal.

    Args:
        description: what is being done.
        unit: what is counted, in the plural.
        total: value of ``completed`` at the end; None: not known, and elapsed time is shown instead.
    """
    if not sys.stderr.isatty():
        yield ProgressBar(unit)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True, highlight=False)
    columns = (
        TextColumn("{task.description}"),
        *([BarColumn()] if console.width >= _BAR_COLUMNS else []),
        TextColumn("{task.fields[count]}"),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn() if total is None else TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        yield ProgressBar(unit, bar, bar.add_task(description, total=total, count="", rate="", note=""))
