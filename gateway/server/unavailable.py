"""503 responses for work that the worker pool did not do."""

from __future__ import annotations

from fastapi.responses import PlainTextResponse

from gateway.runtime.worker_pool import DeadlineExceeded, PoolClosed, QueueFull

PoolErrors = (QueueFull, PoolClosed, DeadlineExceeded)
"""What ``WorkerPool.run`` raises for calls that it rejects or stops."""


def unavailable(error: QueueFull | PoolClosed | DeadlineExceeded) -> PlainTextResponse:
    """Return a 503 response; without Retry-After if the same request would take too long again."""
    if isinstance(error, DeadlineExceeded):
        return PlainTextResponse(f"rendering was stopped: {error}", 503)
    return PlainTextResponse(str(error), 503, {"Retry-After": str(getattr(error, "retry_after", 1))})
