"""Parts of the kernels that are compiled in the background while the server already runs.

The server announces the parts that are not compiled yet; a worker thread that needs one waits for it. In other programs
no part is ever pending: Numba compiles a kernel at its first call.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from renderers.stop import current_stop

_POLL_SECONDS: Final = 0.1
"""Time between two checks of the stop flag."""
_changed: Final = threading.Condition()
_thread: Final = threading.local()
_pending: Final[dict[str, Exception | None]] = {}
"""By part, None while it is being compiled or loaded, or the error of that."""


@contextmanager
def announced(parts: tuple[str, ...]) -> Iterator[None]:
    """Announce that parts are being compiled. At the end none of them is pending, compiled or not."""
    with _changed:
        _pending.update(dict.fromkeys(parts))
    try:
        yield
    finally:
        with _changed:
            for part in parts:
                _pending.pop(part, None)
            _changed.notify_all()


def finish(part: str) -> None:
    """Announce that a part is loaded."""
    with _changed:
        del _pending[part]
        _changed.notify_all()


def fail(error: Exception | None) -> None:
    """Announce that the pending parts could not be loaded. Calls that need them raise a copy of the error.

    Args:
        error: None: loading them is tried again, and calls wait.
    """
    with _changed:
        for part in _pending:
            _pending[part] = error
        _changed.notify_all()


@contextmanager
def loading() -> Iterator[None]:
    """Let the calling thread use pending parts, since it is the one that loads them."""
    _thread.is_loading = True
    try:
        yield
    finally:
        _thread.is_loading = False


def is_pending(part: str) -> bool:
    """Return whether a call that needs a part would wait."""
    return part in _pending


def is_compiling(part: str) -> bool:
    """Return whether a part is pending and loading it has not failed."""
    return part in _pending and _pending[part] is None


def wait_until_compiled(part: str) -> None:
    """Return once a part is compiled, at once if it is not pending. The wait is not part of the call's time limit.

    Raises:
        Exception: the part could not be compiled, or the current ``StopFlag`` was set. The message says so.
    """
    if not _pending or getattr(_thread, "is_loading", False):
        return
    stop = current_stop()
    with stop.waiting(), _changed:
        while part in _pending:
            if (error := _pending[part]) is not None:
                raise type(error)(*error.args)
            try:
                stop.check()
            except Exception as stopped:  # noqa: BLE001 - raised again
                raise type(stopped)(f"{stopped}, waiting for kernels that are being compiled") from None
            _changed.wait(_POLL_SECONDS)
