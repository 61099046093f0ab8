"""ASGI middleware for every HTTP request: ids, logs, metrics, limit on URLs, HEAD, path prefix, early responses."""

from __future__ import annotations

import asyncio
import random
import re
import time
from collections.abc import Awaitable, Collection
from typing import Final
from urllib.parse import quote

import structlog
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.runtime.metrics_registry import Metrics
from gateway.server.error_handlers import redirect
from gateway.server.http_protocol import DISCARD_BYTES, DISCARD_SECONDS

MAX_TARGET_BYTES: Final = 8 << 10
"""Maximum length of path and query of a URL. RFC 9110 asks for at least 8000; parsing 64 kB takes 20 ms."""

_log = structlog.get_logger("gateway.http")
_CLOSE: Final = (b"connection", b"close")
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
                self._metrics.requests.labels(route, scope["method"], status or "aborted").inc()
                self._metrics.seconds.labels(route).observe(seconds)
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


class PathPrefix:
    """ASGI middleware: remove the prefix from paths, so that all others see those of a gateway of its own.

    Paths without the prefix are accepted, too: health checks do not come through the proxy. Pages need no prefix, since
    their addresses are relative.
    """

    def __init__(self, app: ASGIApp, *, prefix: str) -> None:
        """``prefix``: such as ``/user/ann/scenegate``, decoded and without a slash at its end."""
        self._app = app
        self._prefix = prefix
        self._raw_prefix = quote(prefix).encode()

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] == "http" and scope["path"] == self._prefix:
            name = quote(self._prefix.rpartition("/")[2])
            to_index = redirect(f"./{name}/", scope["query_string"].decode("latin-1"), 307)
            return to_index(scope, receive, send)
        if scope["type"] != "lifespan" and scope["path"].startswith(f"{self._prefix}/"):
            raw_path = scope["raw_path"].removeprefix(self._raw_prefix)
            scope = {**scope, "path": scope["path"][len(self._prefix) :], "raw_path": raw_path}
        return self._app(scope, receive, send)


class EarlyResponse:
    """ASGI middleware: receive the rest of a body before the end of its response closes the connection.

    A connection that closes with unread bytes is reset, and a reset discards the response on its way to the client.
    Connections that stay open do without: ``BoundedHttpProtocol`` discards what follows.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] != "http" or _CLOSE not in scope["headers"]:
            return self._app(scope, receive, send)
        has_body = True

        async def receive_body() -> Message:
            nonlocal has_body
            message = await receive()
            has_body = message["type"] == "http.request" and message.get("more_body", False)
            return message

        async def send_last(message: Message) -> None:
            is_last = message["type"] == "http.response.body" and not message.get("more_body", False)
            if not (is_last and has_body):
                await send(message)
                return
            await send({**message, "more_body": True})
            discarded_bytes = 0
            try:
                async with asyncio.timeout(DISCARD_SECONDS):
                    while has_body and discarded_bytes <= DISCARD_BYTES:
                        discarded_bytes += len((await receive_body()).get("body", b""))
            except TimeoutError:
                pass
            await send({"type": "http.response.body", "body": b"", "more_body": False})

        return self._app(scope, receive_body, send_last)
