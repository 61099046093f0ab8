"""503 responses for work that the worker pool did not do."""

from __future__ import annotations

from fastapi.responses import PlainTextResponse

from gateway.runtime.worker_pool import Busy, Closed, TooSlow

PoolErrors = (Busy, Closed, TooSlow)
"""What ``WorkerPool.run`` raises for calls that it rejects or stops."""


def unavailable(error: Busy | Closed | TooSlow) -> PlainTextResponse:
    """Return a 503 response; without Retry-After if the same request would take too long again."""
    if isinstance(error, TooSlow):
        return PlainTextResponse(f"rendering was stopped: {error}", 503)
    return PlainTextResponse(str(error), 503, {"Retry-After": str(getattr(error, "retry_after", 1))})
