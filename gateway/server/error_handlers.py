"""Responses to requests that reach no route (404, 405, invalid parameters), and HEAD for every route with GET."""

from __future__ import annotations

from collections.abc import Awaitable
from typing import Final
from urllib.parse import quote

from fastapi.exceptions import RequestValidationError
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send


class HeadAsGet:
    """ASGI middleware: run GET for HEAD and omit the body, so that status and headers are the same (RFC 9110, 9.3.2).

    The response ends at the first piece of the body. The application of a stream then gets a disconnect, and stops.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        is_head = scope["type"] == "http" and scope["method"] == "HEAD"
        return (self._respond if is_head else self._app)(scope, receive, send)

    async def _respond(self, scope: Scope, receive: Receive, send: Send) -> None:
        complete = False

        async def send_head(message: Message) -> None:
            nonlocal complete
            if message["type"] != "http.response.body":
                await send(message)
            elif not complete:
                complete = True
                await send({"type": "http.response.body", "body": b"", "more_body": False})

        get_scope = {**scope, "method": "GET"}
        try:
            await self._app(get_scope, receive, send_head)
        finally:
            if "route" in get_scope:  # metrics use it
                scope["route"] = get_scope["route"]


_METHODS: Final = ("DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT")
_MAX_ECHO: Final = 200
"""Maximum number of characters of a path or a value in a response."""
JSON_PATHS: Final = ("/api/", "/stereo/")
"""Beginnings of the paths whose error responses are JSON, as the stereo camera's; all others are text."""


def redirect(path: str, query: str, status: int) -> Response:
    """Return a redirect to a path relative to that of the request: a proxy may have removed the beginning of it."""
    return Response(status_code=status, headers={"Location": f"{path}?{query}" if query else path})


async def not_allowed(request: Request, error: Exception) -> PlainTextResponse:
    """Return 405 with all methods of the path in Allow (RFC 9110, 15.5.6); Starlette has those of one route only."""
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


async def not_found(request: Request, error: Exception) -> Response:
    """Return 404 for a path without a route; one with a slash at its end is redirected to the path without it."""
    path = request.url.path
    if (name := path.rstrip("/").rpartition("/")[2]) and path.endswith("/"):
        return redirect(f"../{quote(name)}", request.url.query, 307)
    path = path[:_MAX_ECHO]
    return PlainTextResponse(
        f"Nothing is at {path} here. /docs describes what there is; /healthz tells which interfaces run.\n", 404
    )


async def invalid_parameters(request: Request, error: Exception) -> Response:
    """Return 422 with one sentence that names every invalid parameter, its limit and its value."""
    assert isinstance(error, RequestValidationError)
    problems = (f"{fault['loc'][-1]}: {fault['msg']}, got {fault['input']!r}"[:_MAX_ECHO] for fault in error.errors())
    sentence = f"{'; '.join(problems)}."
    if request.url.path.startswith(JSON_PATHS):
        return JSONResponse({"message": sentence}, 422)
    return PlainTextResponse(f"{sentence}\n", 422)
