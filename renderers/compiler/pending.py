"""Kernels that are compiled in the background, in parts, while the server already runs.

The server announces the parts that are not compiled yet; a kernel of such a part waits when it is called. In other
programs no part is ever pending: Numba compiles a kernel at its first call.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Final

from renderers.stop import current_stop

_changed: Final = threading.Condition()
PENDING: Final[dict[str, _Part]] = {}
"""Parts that are not loaded, by name; only this module changes it."""


class KernelsPending(Exception):  # noqa: N818 - an expected outcome, not a fault
    """A call under a ``StopFlag`` that does not wait needs kernels that are being compiled: call it again later."""

    def __init__(self, part: str) -> None:
        super().__init__(part)
        self.part = part


class KernelsDelayed(Exception):  # noqa: N818 - as above
    """Kernels of the background are not loaded yet, because of an error. Clients get the message: it has no reason."""

    def __init__(self, retry_after: int) -> None:
        super().__init__(retry_after)
        self.retry_after = retry_after
        """Seconds until loading is tried again."""

    def __str__(self) -> str:
        return "kernels that this needs could not be loaded, which is tried again; the server's log has the reason"


class _Part:
    """A part that is being compiled or loaded, or has failed to be."""

    def __init__(self, has_kernel: Callable[[str], bool]) -> None:
        self.has_kernel = has_kernel
        self.retry_after: int | None = None
        """Seconds until loading is tried again after an error; None: no error."""


@contextmanager
def announced(parts: Mapping[str, Callable[[str], bool]]) -> Iterator[None]:
    """Announce that parts are being compiled. At the end none of them is pending, compiled or not.

    Args:
        parts: for each part, a function that returns True for the full names of its kernels.
    """
    with _changed:
        PENDING.update({part: _Part(has_kernel) for part, has_kernel in parts.items()})
    try:
        yield
    finally:
        with _changed:
            for part in parts:
                PENDING.pop(part, None)
            _changed.notify_all()


def finish(part: str) -> None:
    """Announce that a part is loaded."""
    with _changed:
        del PENDING[part]
        _changed.notify_all()


def fail(retry_after: int | None) -> None:
    """Announce that the pending parts could not be loaded. Calls that need them raise KernelsDelayed.

    Args:
        retry_after: seconds until loading is tried again; None: it is tried now, and calls wait.
    """
    with _changed:
        for part in PENDING.values():
            part.retry_after = retry_after
        _changed.notify_all()


def is_pending(part: str) -> bool:
    """Return True for a part that is not loaded yet."""
    return part in PENDING


def any_pending() -> bool:
    """Return True while kernels of any part are not loaded: calls may wait, and must not be made on an event loop."""
    return bool(PENDING)


def is_compiling(part: str) -> bool:
    """Return True for a part that is not loaded yet, unless loading it has failed."""
    state = PENDING.get(part)
    return state is not None and state.retry_after is None


def wait_for_kernel(name: str) -> None:
    """Return once the kernel of this full name can be called, at once if its part is not pending.

    Raises:
        KernelsPending: the current ``StopFlag`` does not wait.
        KernelsDelayed: the part could not be loaded.
    """
    for part, state in tuple(PENDING.items()):
        if state.has_kernel(name):
            if not current_stop().waits and state.retry_after is None:
                raise KernelsPending(part)
            with _changed:
                while is_compiling(part):
                    _changed.wait()
                failed = PENDING.get(part)
            if failed is not None and failed.retry_after is not None:
                raise KernelsDelayed(failed.retry_after)
