"""Clicks on geometry in the browser: the callbacks of ``TreeViewer.on_click``, and the threads that call them."""

from __future__ import annotations

import contextlib
import inspect
import logging
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from scenegate.messages.changes import Path, is_at_or_below

RENEW_SECONDS: Final = 10.0
"""Interval of repeated subscriptions. A viewer drops the subscription of a client after 30 s without one."""
MAX_WAITING: Final = 100
"""Maximum number of clicks that wait for a callback; further ones are dropped."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Click:
    """A click on geometry in the browser."""

    path: Path
    """Path of the geometry."""
    point: tuple[float, float, float]
    """Point on the geometry in the world, metres."""
    button: str
    """``left``, ``middle`` or ``right``."""


Callback = Callable[[Click], Any]


class ClickListener:
    """Callbacks of one client. One thread runs them in order; another repeats the client's subscription."""

    def __init__(self, renew: Callable[[list[Path]], None]) -> None:
        """``renew`` sends the subscription without waiting for a response."""
        self._renew = renew
        self._callbacks: list[tuple[Path, Callback]] = []
        self._lock = threading.Lock()
        self._clicks: queue.Queue[Click | None] = queue.Queue(MAX_WAITING)
        self._closed = threading.Event()
        self._threads: list[threading.Thread] = []

    def add(self, path: Path, callback: Callback) -> Callable[[], None]:
        """Add a callback for clicks at and below a path; return the function that removes it.

        Raises:
            TypeError: the callback is a coroutine function, or cannot be called.
        """
        if inspect.iscoroutinefunction(callback):
            raise TypeError("a callback of TreeViewer.on_click must not be a coroutine; AsyncTreeViewer takes both")
        if not callable(callback):
            raise TypeError(f"a callback of on_click must be a function, not a {type(callback).__name__}")
        entry = (path, callback)
        with self._lock:
            self._callbacks.append(entry)
            if not self._threads:
                for name, target in (("clicks", self._run_callbacks), ("renew", self._renew_subscription)):
                    self._threads.append(threading.Thread(target=target, name=f"treeviewer-{name}", daemon=True))
                    self._threads[-1].start()

        def remove() -> None:
            with self._lock, contextlib.suppress(ValueError):
                self._callbacks.remove(entry)

        return remove

    def paths(self) -> list[Path]:
        """Return the paths that have callbacks, without duplicates."""
        with self._lock:
            return list(dict.fromkeys(path for path, _ in self._callbacks))

    def receive(self, fields: Any) -> None:
        """Queue the click of a message. Invalid ones are ignored."""
        try:
            x, y, z = map(float, fields["point"])
            click = Click(tuple(fields["path"]), (x, y, z), str(fields["button"]))
        except (KeyError, TypeError, ValueError):
            return
        with contextlib.suppress(queue.Full):
            self._clicks.put_nowait(click)

    def close(self) -> None:
        """End the threads without waiting for them. A running callback is not interrupted."""
        self._closed.set()
        with contextlib.suppress(queue.Full):
            self._clicks.put_nowait(None)

    def _run_callbacks(self) -> None:
        """Run the callbacks of each click until ``close``: the body of a thread. An exception is logged."""
        while (click := self._clicks.get()) is not None and not self._closed.is_set():
            with self._lock:
                callbacks = [callback for path, callback in self._callbacks if is_at_or_below(click.path, path)]
            for callback in callbacks:
                try:
                    callback(click)
                except Exception:  # one callback must not end the others  # noqa: BLE001
                    _log.exception("A callback of on_click has failed")

    def _renew_subscription(self) -> None:
        """Repeat the subscription until ``close``: the body of a thread."""
        while not self._closed.wait(RENEW_SECONDS):
            paths = self.paths()
            if paths:
                self._renew(paths)
