"""Ending work before it is done: a flag that kernels read by its address, and Python by ``check_stop``.

The flag of the work in progress is a context variable. A parameter would have to pass through some forty functions of
the glTF reader, the renderer and the looks, of which nearly all would only hand it on.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextvars import ContextVar
from ctypes import addressof, c_int64
from typing import Final, TypeVar

T = TypeVar("T")


class StopFlag:
    """Set once, from any thread; the work that runs under it then ends with the error that it was set with."""

    __slots__ = ("_error", "_word", "address")

    def __init__(self) -> None:
        self._word = c_int64(0)
        self._error: Exception | None = None
        self.address: Final = addressof(self._word)
        """Address of an int64 that is not 0 once the flag is set; valid while this object is alive."""

    @property
    def is_set(self) -> bool:
        """True once the flag is set: the work should end."""
        return self._error is not None

    def set(self, error: Exception) -> None:
        """Ends the work; the first error given counts.

        Args:
            error: what ``check`` raises, as a new exception of the same type and arguments every time.
        """
        if self._error is None:
            self._error = error
        self._word.value = 1  # after the error: who sees this looks for it

    def check(self) -> None:
        """Raises the error that the flag was set with, if it was set."""
        if self._error is not None:
            # Not the same object: its traceback would keep the frames of the work alive as long as the flag.
            raise type(self._error)(*self._error.args)

    def run(self, call: Callable[[], T]) -> T:
        """Calls ``call`` with this flag as the current one, and returns its result."""
        token = _current.set(self)
        try:
            return call()
        finally:
            _current.reset(token)


def run_within(seconds: float, call: Callable[[], T], error: Exception) -> T:
    """Call ``call`` under a flag that is set with ``error`` after ``seconds``; 0: it may take any time."""
    flag = StopFlag()
    if seconds <= 0.0:
        return flag.run(call)
    timer = threading.Timer(seconds, flag.set, (error,))
    timer.daemon = True
    timer.start()
    try:
        return flag.run(call)
    finally:
        timer.cancel()


_current: ContextVar[StopFlag] = ContextVar("stop_flag", default=StopFlag())  # noqa: B039 - the default is never set


def current_stop() -> StopFlag:
    """The flag of the work in progress; one that is never set where there is none. Threads that are started have none:
    hand it to them."""
    return _current.get()


def check_stop() -> None:
    """Raises the error that the current flag was set with, if it was set. Takes 0.1 us."""
    _current.get().check()
