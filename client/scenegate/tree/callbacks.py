"""Callbacks for messages of the page, and the threads that run them and repeat the subscriptions."""

import contextlib
import inspect
import logging
import queue
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import msgspec

from scenegate.messages.arguments import describe
from scenegate.messages.changes import Path, is_at_or_below
from scenegate.messages.clicks import Click

RESEND_SECONDS: Final = 10.0
"""Interval of repeated subscriptions. A viewer drops the subscription of a client after 30 s without one."""
MAX_WAITING: Final = 100
"""Maximum number of calls that wait when a click arrives; further clicks are dropped."""

Callback = Callable[[Click], Any]

_log = logging.getLogger(__name__)


class CallbackThreads:
    """Two threads, from the first subscription on: one runs callbacks in order, the other repeats subscriptions."""

    def __init__(self, resend: Callable[[], None]) -> None:
        """``resend`` sends the subscriptions without waiting for a response."""
        self._resend = resend
        self._calls: queue.Queue[Callable[[], Any] | None] = queue.Queue()
        self._closed = threading.Event()
        self._resend_event = threading.Event()
        self._lock = threading.Lock()
        self._started = False

    def start(self) -> None:
        """Start the threads, unless they run."""
        with self._lock:
            if not self._started:
                self._started = True
                for name, target in (("callbacks", self._run), ("resend", self._repeat)):
                    threading.Thread(target=target, name=f"treeviewer-{name}", daemon=True).start()

    @property
    def waiting(self) -> int:
        """Number of calls that have not begun."""
        return self._calls.qsize()

    def call(self, function: Callable[[], Any]) -> None:
        """Call a function in the thread. An exception is logged."""
        self._calls.put(function)

    def resend_now(self) -> None:
        """Send the subscriptions at once, in the thread that repeats them."""
        self._resend_event.set()

    def close(self) -> None:
        """End the threads without waiting for them. A running callback is not interrupted."""
        self._closed.set()
        self._resend_event.set()
        self._calls.put(None)

    def _run(self) -> None:
        while (call := self._calls.get()) is not None and not self._closed.is_set():
            try:
                call()
            except Exception:  # one callback must not end the others  # noqa: BLE001
                _log.exception("A callback of the tree viewer has failed")

    def _repeat(self) -> None:
        while True:
            self._resend_event.wait(RESEND_SECONDS)
            if self._closed.is_set():
                return
            self._resend_event.clear()
            self._resend()


def check_callback(callback: object, method: str) -> None:
    """Raise TypeError if a callback is a coroutine function, or cannot be called."""
    if inspect.iscoroutinefunction(callback):
        raise TypeError(f"a callback of TreeViewer.{method} must not be a coroutine; AsyncTreeViewer takes both")
    if not callable(callback):
        raise TypeError(f"a callback of {method} must be a function, not {describe(callback)}")


class ClickListener:
    """Callbacks of one client for clicks on geometry in the browser."""

    def __init__(self, threads: CallbackThreads) -> None:
        self._threads = threads
        self._callbacks: list[tuple[Path, Callback]] = []
        self._lock = threading.Lock()

    def add(self, path: Path, callback: Callback) -> Callable[[], None]:
        """Add a callback for clicks at and below a path; return the function that removes it. Raises TypeError."""
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
