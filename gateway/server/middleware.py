"""ASGI middleware for every HTTP request: ids, log lines, metrics, and a limit on URLs."""

from __future__ import annotations

import random
import re
import time
from collections.abc import Awaitable, Collection
from typing import Final

import structlog
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.runtime.metrics_registry import Metrics

MAX_TARGET_BYTES: Final = 8 << 10
"""Maximum length of path and query of a URL. RFC 9110 asks for at least 8000; parsing 64 kB takes 20 ms."""

_log = structlog.get_logger("gateway.http")
_ID = re.compile(r"[A-Za-z0-9._:/+=-]{1,128}")
"""Valid X-Request-ID of a client. Others are replaced, since they could forge log lines."""


class RequestContext:
    """Gives each request an id (X-Request-ID) for its log lines and its response; counts, times and logs it."""

    def __init__(self, app: ASGIApp, *, metrics: Metrics, quiet_paths: Collection[str] = ()) -> None:
        """``quiet_paths``: paths whose requests are logged at debug level."""
        self._app = app
        self._metrics = metrics
        self._quiet_paths = quiet_paths

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request_id = _request_id(dict(scope["headers"]).get(b"x-request-id", b""))
        status = 0

        def send_with_id(message: Message) -> Awaitable[None]:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message["headers"] = [*message.get("headers", ()), (b"x-request-id", request_id.encode())]
            return send(message)

        start = time.perf_counter()
        with structlog.contextvars.bound_contextvars(request_id=request_id), self._metrics.in_flight.track_inprogress():
            try:
                await self._app(scope, receive, send_with_id)
            except Exception as error:
                _log.exception("unhandled", path=scope["path"])
                if status:
                    raise  # closes the connection: a truncated body must not look complete
                # One line, since Drake prints it.
                text = f"Internal error: {type(error).__name__}: {error}"[:1000] + f" (request {request_id})\n"
                await PlainTextResponse(text, status_code=500)(scope, receive, send_with_id)
            finally:
                seconds = time.perf_counter() - start
                # The route's template, not the path: a scanner must not fill the registry with labels.
                route = getattr(scope.get("route"), "path", "(none)")
                self._metrics.count_request(route, scope["method"], status or "aborted", seconds)
                log = _log.debug if scope["path"] in self._quiet_paths else _log.info
                log("request", method=scope["method"], path=scope["path"], status=status, ms=round(seconds * 1e3, 1))


def _request_id(sent: bytes) -> str:
    """Return a client's X-Request-ID, or a new one if it is missing or not valid."""
    text = sent.decode("latin-1")
    return text if _ID.fullmatch(text) else f"{random.getrandbits(128):032x}"


class TargetLimit:
    """Rejects requests whose path and query are longer than ``MAX_TARGET_BYTES`` with 414."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] == "http" and len(scope["raw_path"]) + len(scope["query_string"]) > MAX_TARGET_BYTES:
            text = f"The path with its query is longer than {MAX_TARGET_BYTES} bytes.\n"
            return PlainTextResponse(text, status_code=414)(scope, receive, send)
        return self._app(scope, receive, send)
