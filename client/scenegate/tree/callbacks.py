"""Threads of a client for messages of the page: one runs callbacks in order, the other repeats subscriptions."""

from __future__ import annotations

import inspect
import logging
import queue
import threading
from collections.abc import Callable
from typing import Any, Final

from scenegate.messages.field_kinds import describe

RESEND_SECONDS: Final = 10.0
"""Interval of repeated subscriptions. A viewer drops the subscription of a client after 30 s without one."""

_log = logging.getLogger(__name__)


class CallbackThreads:
    """Both threads. They start with the first subscription."""

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
