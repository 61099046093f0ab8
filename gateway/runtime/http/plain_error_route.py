"""Routes whose expected errors become responses, such as 503 for work that was not done: plain text, unless a subclass
has another form.
"""

from collections.abc import Callable, Coroutine, Mapping
from typing import Any, ClassVar

from fastapi import Request, Response
from fastapi.responses import PlainTextResponse
from fastapi.routing import APIRoute
from starlette.requests import ClientDisconnect

from gateway.runtime.http.disconnect import CLIENT_GONE
from gateway.runtime.workers.pool_errors import DeadlineExceeded, QueueFull, UnavailableErrors
from gateway.scene.tree.timeline import FileTooLargeError
from renderers.drawlist import ImageError


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


class PlainErrorRoute(APIRoute):
    """A route whose expected errors become responses in plain text. Subclasses have more of them."""

    statuses: ClassVar[Mapping[type[Exception], int]] = {FileTooLargeError: 413, ImageError: 500}
    """Status by class of the error; of several, the first that holds. 503 for ``UnavailableErrors`` is always there."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handle = super().get_route_handler()

        async def handle_with_errors(request: Request) -> Response:
            try:
                return await handle(request)
            except ClientDisconnect:
                return Response(status_code=CLIENT_GONE)
            except UnavailableErrors as error:
                return self.error_response(503, unavailable_message(error), retry_after(error))
            except tuple(self.statuses) as error:
                status = next(status for kind, status in self.statuses.items() if isinstance(error, kind))
                text = f"a texture of the scene cannot be decoded: {error}" if status == 500 else str(error)
                headers = retry_after(error) if status == 503 else None
                return self.error_response(status, text, headers)

        return handle_with_errors

    def error_response(self, status: int, text: str, headers: Mapping[str, str] | None) -> Response:
        """Return the response to an error, whose text is one sentence."""
        return PlainTextResponse(text.encode("utf-8", "backslashreplace"), status, headers)
