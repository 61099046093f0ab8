"""Answers for requests that no route takes: no such path, no such method; HEAD for every route with GET.

405 names all methods that a path has (RFC 9110, 15.5.6); frameworks tell those of the first route only.
"""

from __future__ import annotations

from typing import Final

from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send


class HeadAsGet:
    """ASGI middleware: answer HEAD as GET, with the same headers and without the body (RFC 9110, 9.3.2).

    The application sees a GET, and makes what it would make for one: only so are status and headers the same. To an
    answer in pieces the client is gone when the first piece has come, so that streams without an end stop there.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return
        complete = False

        async def send_head(message: Message) -> None:
            nonlocal complete
            if message["type"] != "http.response.body":
                await send(message)
            elif not complete:
                complete = True
                await send({"type": "http.response.body", "body": b"", "more_body": False})

        get = {**scope, "method": "GET"}
        try:
            await self._app(get, receive, send_head)
        finally:
            if "route" in get:  # for the metrics
                scope["route"] = get["route"]


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
    if "GET" in allowed and "HEAD" not in allowed:
        allowed.insert(allowed.index("GET") + 1, "HEAD")
    methods = ", ".join(allowed)
    headers = {"Allow": methods} if methods else getattr(error, "headers", None)
    return PlainTextResponse(f"{request.method} is not possible here; {methods or 'nothing'} is.\n", 405, headers)


async def not_found(request: Request, error: Exception) -> PlainTextResponse:
    """The answer to a path that no route has."""
    path = request.url.path[:_SHOWN]
    return PlainTextResponse(
        f"Nothing is at {path} here. /docs describes what there is; /healthz tells which interfaces run.\n", 404
    )
