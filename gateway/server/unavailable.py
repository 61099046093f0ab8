"""503 responses for work that was not done: no worker was free, it took too long, or its kernels are not loaded."""

from __future__ import annotations

from fastapi.responses import PlainTextResponse

from gateway.runtime.pool_errors import DeadlineExceeded, QueueFull, UnavailableErrors

__all__ = ["UnavailableErrors", "retry_after", "unavailable", "unavailable_message"]


def retry_after(error: Exception) -> dict[str, str]:
    """Return the Retry-After header for one of ``UnavailableErrors``; none if the same request would fail again."""
    if isinstance(error, DeadlineExceeded):
        return {}
    return {"Retry-After": str(getattr(error, "retry_after", 1))}


def unavailable_message(error: Exception) -> str:
    """Return the text of the 503 response for one of ``UnavailableErrors``."""
    if isinstance(error, QueueFull):
        return f"the server is busy: {error}"
    if isinstance(error, DeadlineExceeded):
        return f"rendering was stopped: {error}"
    return str(error)


def unavailable(error: Exception) -> PlainTextResponse:
    """Return a 503 response for one of ``UnavailableErrors``."""
    return PlainTextResponse(unavailable_message(error), 503, retry_after(error))
