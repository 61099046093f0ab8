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
    now: list[str] = field(default_factory=list)
    """Names of the parts that are being compiled."""
    waiting: bool = False
    """True while another process compiles the kernels and this one waits for it."""
    began: float = field(default_factory=time.monotonic)
    changed: Callable[[], object] = lambda: None
    """Called after every change."""

    @property
    def seconds(self) -> float:
        """Seconds since the start."""
        return round(time.monotonic() - self.began, 1)

    @property
    def part(self) -> int:
        """Number of the part that was begun last, counted from 1."""
        return self.done + len(self.now)

    def wait(self, waiting: bool) -> None:
        """Note whether another process compiles."""
        if waiting != self.waiting:
            self.waiting = waiting
            self.changed()

    def begin(self, part: str) -> None:
        """Note that a part is being compiled."""
        self.now.append(part)
        self.changed()

    def end(self, part: str) -> None:
        """Note that a part is compiled."""
        self.now.remove(part)
        self.done += 1
        self.changed()

    def describe(self) -> dict[str, Any]:
        """Return JSON values for ``/healthz`` and ``/readyz``."""
        if self.waiting:
            return {"waiting": "another process compiles the kernels", "seconds": self.seconds}
        compiling = {"part": self.part, "of": self.parts, "done": self.done, "now": list(self.now)}
        return {"compiling": {**compiling, "seconds": self.seconds}}


@contextmanager
def shown(progress: Progress, log: Callable[..., object]) -> Iterator[None]:
    """Show progress while the block runs: a bar if stderr is a terminal, else a log line for each part.

    Args:
        log: called as ``log(event, **fields)``.
    """
    if sys.stderr.isatty():
        with _bar(progress):
            yield
        return
    logged = 0

    def line() -> None:
        nonlocal logged
        if progress.waiting:
            log("Waiting for another process that compiles the rendering kernels", seconds=progress.seconds)
        elif progress.part > logged:
            logged = progress.part
            fields = {"part": logged, "of": progress.parts, "name": progress.now[-1], "seconds": progress.seconds}
            log("Compiling the rendering kernels", **fields)

    progress.changed = line
    yield


@contextmanager
def on_stderr(progress: Progress) -> Iterator[None]:
    """``shown`` with lines on stderr, for commands."""

    def write(event: str, *, seconds: float, part: int = 0, of: int = 0, name: str = "") -> None:
        which = f", part {part} of {of} ({name})" if part else ""
        sys.stderr.write(f"{event}{which}, {seconds:.0f} s\n")

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
            now = "another process compiles" if progress.waiting else ", ".join(progress.now)
            bar.update(task, completed=progress.done, now=now)

        progress.changed = show
        # While the bar is shown, rich replaces sys.stderr by one that writes lines above the bar.
        handlers = [h for h in logging.getLogger().handlers if isinstance(h, logging.StreamHandler)]
        moved = [handler for handler in handlers if handler.stream is terminal]
        for handler in moved:
            handler.setStream(sys.stderr)
        try:
            yield
        finally:
            for handler in moved:
                handler.setStream(terminal)
