"""Cancellation of long calls: a flag that kernels read by its address, and Python code by ``check_stop``.

The current flag is a context variable. Passed as a parameter, it would go through some forty functions that do not use
it.
"""

import threading
from collections.abc import Callable
from contextvars import ContextVar
from ctypes import addressof, c_int64
from typing import Final, TypeVar

T = TypeVar("T")


class StopFlag:
    """Flag that cancels a call with an error. Any thread may set it."""

    __slots__ = ("_error", "_value", "address", "waits")

    def __init__(self, *, waits: bool = True) -> None:
        """
        Args:
            waits: False: calls raise KernelsPending instead of waiting for kernels that are being compiled.
        """
        self.waits = waits
        self._value = c_int64(0)
        self._error: Exception | None = None
        self.address: Final = addressof(self._value)
        """Address of an int64 that is 0 until the flag is set. Valid while this object is alive."""

    @property
    def is_set(self) -> bool:
        """True once the flag is set."""
        return self._error is not None

    def set(self, error: Exception) -> None:
        """Set the flag. Only the first call has an effect.

        Args:
            error: ``check`` raises new exceptions of this type with these arguments.
        """
        if self._error is None:
            self._error = error
        self._value.value = 1  # after the error, which threads read once they see the value

    def check(self) -> None:
        """Raise the error of the flag if it is set."""
        if self._error is not None:
            # A new object: the traceback of ``_error`` would keep frames alive as long as the flag.
            raise type(self._error)(*self._error.args)

    def run(self, call: Callable[[], T]) -> T:
        """Call ``call`` with this flag as the current one, and return its result."""
        token = _current.set(self)
        try:
            return call()
        finally:
            _current.reset(token)


def run_within(seconds: float, call: Callable[[], T], error: Exception) -> T:
    """Call ``call`` and return its result. After ``seconds``, cancel it with ``error``; 0: no limit."""
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


current_stop: Final = _current.get
"""Returns the current flag. Outside of ``StopFlag.run`` and in new threads, this is a flag that is never set."""


def check_stop() -> None:
    """Raise the error of the current flag if it is set. Takes 0.1 us."""
    current_stop().check()
