"""Responses to requests that reach no route: 404, 405, invalid parameters."""

from collections.abc import Mapping
from typing import Any, Final
from urllib.parse import quote

from fastapi.exceptions import RequestValidationError
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Match

_METHODS: Final = ("DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT")
_MAX_ECHO: Final = 200
"""Maximum number of characters of a path or a value in a response."""
JSON_PATHS: Final = ("/api/", "/stereo/")
"""Beginnings of the paths whose error responses are JSON, as the stereo camera's; all others are text."""


def _refusal(request: Request, status: int, sentence: str, headers: Mapping[str, str] | None = None) -> Response:
    if request.url.path.startswith(JSON_PATHS):
        content = {"message": sentence, "return_code": {"value": -1, "message": sentence}}
        return JSONResponse(content, status, headers)
    return PlainTextResponse(f"{sentence}\n", status, headers)


def redirect(path: str, query: str, status: int) -> Response:
    """Return a redirect to a path relative to that of the request: a proxy may have removed the beginning of it."""
    return Response(status_code=status, headers={"Location": f"{path}?{query}" if query else path})


async def not_allowed(request: Request, error: Exception) -> Response:
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
    return _refusal(request, 405, f"{request.method} is not possible here; {methods or 'nothing'} is.", headers)


async def not_found(request: Request, error: Exception) -> Response:
    """Return 404 for a path without a route; one with a slash at its end is redirected to the path without it."""
    path = request.url.path
    if (name := path.rstrip("/").rpartition("/")[2]) and path.endswith("/"):
        return redirect(f"../{quote(name)}", request.url.query, 307)
    sentence = (
        f"Nothing is at {path[:_MAX_ECHO]} here. /docs describes what there is; /healthz tells which interfaces run."
    )
    return _refusal(request, 404, sentence)


async def invalid_parameters(request: Request, error: Exception) -> Response:
    """Return 422 with one sentence that names every invalid parameter, its limit and its value."""
    assert isinstance(error, RequestValidationError)
    return _refusal(request, 422, f"{'; '.join(map(_reason, error.errors()))}.")


def _reason(fault: Mapping[str, Any]) -> str:
    """Return what is invalid; our own checks name parameter and value themselves."""
    if fault["type"] == "value_error":
        return str(fault["msg"]).removeprefix("Value error, ")
    if fault["type"] == "extra_forbidden":
        return f"{fault['loc'][-1]} is no parameter of this URL"[:_MAX_ECHO]
    return f"{fault['loc'][-1]}: {fault['msg']}, got {fault['input']!r}"[:_MAX_ECHO]
