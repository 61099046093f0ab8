"""Error responses and limited request bodies of the device's REST interface."""

from __future__ import annotations

from typing import Any, Final

from fastapi import Request
from fastapi.responses import JSONResponse

ERROR_SCHEMA: Final[dict[str, Any]] = {
    "type": "object",
    "required": ["message", "return_code"],
    "properties": {
        "message": {"type": "string"},
        "return_code": {
            "type": "object",
            "required": ["value", "message"],
            "properties": {"value": {"type": "integer"}, "message": {"type": "string"}},
        },
    },
}
"""JSON schema of an error response."""


class RestError(Exception):
    """A request is refused."""

    def __init__(self, status: int, message: str) -> None:
        """
        Args:
            status: HTTP status.
            message: one sentence.
        """
        super().__init__(message)
        self.status = status

    def response(self) -> JSONResponse:
        """Return the response. Roboception's clients read ``return_code`` before the HTTP status."""
        message = str(self)
        return JSONResponse({"message": message, "return_code": {"value": -1, "message": message}}, self.status)


async def read_body(request: Request, limit: int) -> bytes:
    """Return the body.

    Raises:
        RestError: it has more than ``limit`` bytes.
    """
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > limit:
            raise RestError(413, f"the body is larger than {limit} bytes")
    return bytes(body)
