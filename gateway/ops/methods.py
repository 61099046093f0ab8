"""Answers for requests that no route takes: no such path, no such method.

405 names all methods that a path has (RFC 9110, 15.5.6); frameworks tell those of the first route only.
"""

from __future__ import annotations

from typing import Final

from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Match

_METHODS: Final = ("DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT")
_SHOWN: Final = 200
"""Characters of a path that the answer repeats."""


async def not_allowed(request: Request, error: Exception) -> PlainTextResponse:
    """The answer to a method that no route of the path has."""
    allowed = [
        method
        for method in _METHODS
        if any(route.matches({**request.scope, "method": method})[0] is Match.FULL for route in request.app.routes)
    ]
    methods = ", ".join(allowed)
    headers = {"Allow": methods} if methods else getattr(error, "headers", None)
    return PlainTextResponse(f"{request.method} is not possible here; {methods or 'nothing'} is.\n", 405, headers)


async def not_found(request: Request, error: Exception) -> PlainTextResponse:
    """The answer to a path that no route has."""
    path = request.url.path[:_SHOWN]
    return PlainTextResponse(
        f"Nothing is at {path} here. /docs describes what there is; /healthz tells which interfaces run.\n", 404
    )
