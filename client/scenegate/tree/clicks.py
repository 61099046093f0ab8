"""Clicks on geometry in the browser: the callbacks of ``TreeViewer.on_click``."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import msgspec

from scenegate.messages.changes import Path, is_at_or_below
from scenegate.messages.clicks import Click
from scenegate.tree.callbacks import CallbackThreads, check_callback

MAX_WAITING: Final = 100
"""Maximum number of calls that wait when a click arrives; further clicks are dropped."""


Callback = Callable[[Click], Any]


class ClickListener:
    """Callbacks of one client."""

    def __init__(self, threads: CallbackThreads) -> None:
        self._threads = threads
        self._callbacks: list[tuple[Path, Callback]] = []
        self._lock = threading.Lock()

    def add(self, path: Path, callback: Callback) -> Callable[[], None]:
        """Add a callback for clicks at and below a path; return the function that removes it.

        Raises:
            TypeError: the callback is a coroutine function, or cannot be called.
        """
        check_callback(callback, "on_click")
        entry = (path, callback)
        with self._lock:
            self._callbacks.append(entry)
        self._threads.start()

        def remove() -> None:
            with self._lock, contextlib.suppress(ValueError):
                self._callbacks.remove(entry)

        return remove

    def paths(self) -> list[Path]:
        """Return the paths that have callbacks, without duplicates."""
        with self._lock:
            return list(dict.fromkeys(path for path, _ in self._callbacks))

    def receive(self, fields: Any) -> None:
        """Queue the callbacks for the click of a message. Invalid ones are ignored."""
        try:
            click = msgspec.convert(fields, Click)
        except msgspec.ValidationError:
            return
        if self._threads.waiting >= MAX_WAITING:
            return
        with self._lock:
            callbacks = [callback for path, callback in self._callbacks if is_at_or_below(click.path, path)]
        for callback in callbacks:
            self._threads.call(partial(callback, click))
