"""Progress of compiling the kernels, for ``/readyz``, the log and a terminal."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True)
class Progress:
    """Progress of compiling; changes on the thread that waits for the child processes."""

    parts: int
    """Number of parts to compile."""
    done: int = 0
    """Number of parts that are compiled."""
    compiling: list[str] = field(default_factory=list)
    """Names of the parts that are being compiled."""
    waiting: bool = False
    """True while another process compiles the kernels and this one waits for it."""
    started: float = field(default_factory=time.monotonic)
    on_change: Callable[[], object] = lambda: None
    """Called after every change."""

    @property
    def seconds(self) -> float:
        """Seconds since the start."""
        return round(time.monotonic() - self.started, 1)

    @property
    def part(self) -> int:
        """Number of the part that was begun last, counted from 1."""
        return self.done + len(self.compiling)

    def set_waiting(self, waiting: bool) -> None:
        """Note whether another process compiles."""
        if waiting != self.waiting:
            self.waiting = waiting
            self.on_change()

    def begin(self, part: str) -> None:
        """Note that a part is being compiled."""
        self.compiling.append(part)
        self.on_change()

    def end(self, part: str) -> None:
        """Note that a part is compiled."""
        self.compiling.remove(part)
        self.done += 1
        self.on_change()

    def describe(self) -> dict[str, Any]:
        """Return JSON values for ``/healthz`` and ``/readyz``."""
        if self.waiting:
            return {"waiting": "another process compiles the kernels", "seconds": self.seconds}
        counts = {"part": self.part, "of": self.parts, "done": self.done, "now": list(self.compiling)}
        return {"compiling": {**counts, "seconds": self.seconds}}


@contextmanager
def shown(progress: Progress, log: Callable[..., object], *, bar: bool = True) -> Iterator[None]:
    """Show progress while the block runs: a bar if stderr is a terminal, else a log line for each part.

    Args:
        log: called as ``log(event, **fields)``.
        bar: False: lines on a terminal, too, which other processes use.
    """
    if bar and sys.stderr.isatty():
        with _bar(progress):
            yield
        return
    logged = 0  # number of the part in the last line

    def log_line() -> None:
        nonlocal logged
        if progress.waiting:
            log("Waiting for another process that compiles the rendering kernels", seconds=progress.seconds)
        elif progress.part > logged:
            logged = progress.part
            fields = {"part": logged, "of": progress.parts, "name": progress.compiling[-1], "seconds": progress.seconds}
            log("Compiling the rendering kernels", **fields)

    progress.on_change = log_line
    yield


@contextmanager
def on_stderr(progress: Progress) -> Iterator[None]:
    """``shown`` with lines on stderr, for commands."""

    def write(event: str, *, seconds: float, part: int = 0, of: int = 0, name: str = "") -> None:
        position = f", part {part} of {of} ({name})" if part else ""
        sys.stderr.write(f"{event}{position}, {seconds:.0f} s\n")

    with shown(progress, write):
        yield


@contextmanager
def _bar(progress: Progress) -> Iterator[None]:
    from rich import progress as rich_progress
    from rich.console import Console

    columns = (
        rich_progress.TextColumn("{task.description}"),
        rich_progress.BarColumn(),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TimeElapsedColumn(),
        rich_progress.TextColumn("{task.fields[now]}"),
    )
    terminal = sys.stderr
    with rich_progress.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("Compiling the rendering kernels", total=progress.parts, now="")

        def show() -> None:
            now = "another process compiles" if progress.waiting else ", ".join(progress.compiling)
            bar.update(task, completed=progress.done, now=now)

        progress.on_change = show
        # While the bar is shown, rich replaces sys.stderr by one that writes lines above the bar.
        handlers = [h for h in logging.getLogger().handlers if isinstance(h, logging.StreamHandler)]
        redirected = [handler for handler in handlers if handler.stream is terminal]
        for handler in redirected:
            handler.setStream(sys.stderr)
        try:
            yield
        finally:
            for handler in redirected:
                handler.setStream(terminal)
