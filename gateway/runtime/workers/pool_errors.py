"""Errors of ``WorkerPool.run`` for calls that it rejects or stops."""

from typing import Final

from renderers.compiler.pending import KernelsDelayed


class QueueFull(Exception):  # noqa: N818 - an expected outcome, not a fault
    """The queue or the memory is full."""

    def __init__(self, reason: str, retry_after: int) -> None:
        super().__init__(f"{reason}; try again in {retry_after} s")
        self.retry_after = retry_after
        """Estimated seconds until a place is free, at least 1."""


class PoolClosed(Exception):  # noqa: N818 - as above
    """The pool is shutting down: the call was not accepted, or was ended."""


class DeadlineExceeded(Exception):  # noqa: N818 - as above
    """The call was ended at its deadline."""


class CallerCancelled(Exception):  # noqa: N818 - as above
    """The call was ended because its caller was cancelled."""


UnavailableErrors: Final = (QueueFull, PoolClosed, DeadlineExceeded, KernelsDelayed)
"""Errors of ``WorkerPool.run`` for calls that it rejects or stops, and of kernels that could not be loaded yet."""
