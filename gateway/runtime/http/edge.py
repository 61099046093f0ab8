"""Edge of the HTTP server: handling that every request gets once, around the routes.

From the outside inwards: the id of the request, its log line and metrics; protection from pages of other sites; CORS;
the token; the start of the gateway. Responses get the headers of all of it at once.
"""

from __future__ import annotations

import asyncio
import re
import secrets
import time
from collections.abc import Awaitable, Callable, Collection
from contextlib import suppress
from typing import Final

import structlog
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.runtime.http.access import POLICY_VIOLATION, Access
from gateway.runtime.http.http_protocol import CONNECTION, DISCARD_BYTES, DISCARD_SECONDS, BoundedHttpProtocol, State
from gateway.runtime.http.protection import Protection
from gateway.runtime.http.start_gate import StartGate
from gateway.runtime.logs.metrics_registry import Metrics

_log = structlog.get_logger("gateway.http")
_CONNECTION_CLOSE: Final = (b"connection", b"close")
_VALID_REQUEST_ID: Final = re.compile(r"[A-Za-z0-9._:/+=-]{1,128}")
"""X-Request-ID of a client that is accepted. Others are replaced, since they could forge log lines."""


class Edge:
    """ASGI middleware: ids, log lines and metrics of requests; refusals; HEAD; early responses. Every part is optional.

    - A request has an id (X-Request-ID) in its log lines and its response.
    - HEAD runs GET without the body, so that status and headers are the same (RFC 9110, 9.3.2). The response ends at
      the first piece of the body. The application of a stream then gets a disconnect, and stops.
    - The rest of a body is received before the end of its response closes the connection. A connection that closes with
      unread bytes is reset, and a reset discards the response on its way to the client. Connections that stay open do
      without: ``BoundedHttpProtocol`` discards what follows.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        metrics: Metrics | None = None,
        quiet_paths: Collection[str] = (),
        protection: Protection | None = None,
        cors: Callable[[ASGIApp], ASGIApp] | None = None,
        access: Access | None = None,
        gate: StartGate | None = None,
    ) -> None:
        """
        Args:
            metrics: count and time requests; None: they are not logged either, and have no ids.
            quiet_paths: paths whose requests are logged at debug level.
            cors: returns the middleware around an application. It is outside of the token check: browsers send
                preflight requests without it.
        """
        self._app = app
        self._metrics = metrics
        self._quiet_paths = quiet_paths
        self._protection = protection
        self._access = access
        self._gate = gate
        self._admit: ASGIApp = cors(self._check_access) if cors is not None else self._check_access
        self.headers: Final = protection.headers if protection is not None else ()
        """Headers of every response."""

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] == "lifespan":
            return self._app(scope, receive, send)
        if scope["type"] == "websocket":
            return self._protect(scope, receive, send)
        response = _Response(scope, receive, send, self.headers)
        inner_scope = {**scope, "method": "GET"} if scope["method"] == "HEAD" else scope
        if self._metrics is None:
            return self._protect(inner_scope, receive, response.send)
        return self._run_logged(self._metrics, scope["method"], inner_scope, response)

    async def _run_logged(self, metrics: Metrics, method: str, scope: Scope, response: _Response) -> None:
        """Run a request with an id, a log line and metrics."""
        request_id = dict(scope["headers"]).get(b"x-request-id", b"").decode("latin-1")
        if not _VALID_REQUEST_ID.fullmatch(request_id):
            request_id = secrets.token_hex(16)
        response.headers += ((b"x-request-id", request_id.encode()),)
        structlog.contextvars.bind_contextvars(request_id=request_id)
        start = time.perf_counter()
        metrics.requests_in_flight += 1
        try:
            await self._protect(scope, response.receive, response.send)
        except Exception as error:
            _log.exception("unhandled", path=scope["path"])
            if response.status:
                raise  # closes the connection: a truncated body must not look complete
            # One line, since Drake prints it.
            text = f"Internal error: {type(error).__name__}: {error}"[:1000] + f" (request {request_id})\n"
            await PlainTextResponse(text, status_code=500)(scope, response.receive, response.send)
        finally:
            metrics.requests_in_flight -= 1
            seconds = time.perf_counter() - start
            # The route's template, not the path: a scanner must not fill the registry with labels.
            route = getattr(scope.get("route"), "path", "(none)")
            metrics.request(route, method, response.status or "aborted").inc()
            metrics.request_seconds(route).observe(seconds)
            log = _log.debug if scope["path"] in self._quiet_paths else _log.info
            log("request", method=method, path=scope["path"], status=response.status, ms=round(seconds * 1e3, 1))
            structlog.contextvars.unbind_contextvars("request_id")

    def _protect(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        """Refuse what may come from a page of another site."""
        refusal = self._protection.refusal(scope) if self._protection is not None else None
        if refusal is None:
            return self._admit(scope, receive, send)
        if scope["type"] == "http":
            return refusal(scope, receive, send)
        return _close(send, "the Host header names another host")

    def _check_access(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        """Refuse requests without a token, before their body is read. Hold them until the gateway has started."""
        refusal = self._access.refusal(scope) if self._access is not None else None
        if refusal is not None:
            is_websocket = scope["type"] == "websocket"
            return _close(send, "a token is needed") if is_websocket else refusal(scope, receive, send)
        if self._gate is not None and not self._gate.is_open(scope):
            return self._hold(self._gate, scope, receive, send)
        return self._app(scope, receive, send)

    async def _hold(self, gate: StartGate, scope: Scope, receive: Receive, send: Send) -> None:
        """Run a request once the gateway has started."""
        refusal = await gate.refusal(scope)
        await (refusal if refusal is not None else self._app)(scope, receive, send)


def _close(send: Send, reason: str) -> Awaitable[None]:
    """Refuse a WebSocket handshake."""
    return send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": reason})


class _Response:
    """A response on its way out: adds headers, omits the body for HEAD, receives the rest of an unread body."""

    __slots__ = ("_connection", "_is_complete", "_is_head", "_send", "headers", "receive", "status")

    def __init__(self, scope: Scope, receive: Receive, send: Send, headers: tuple[tuple[bytes, bytes], ...]) -> None:
        self.receive = receive
        self.headers = headers
        self.status = 0
        """HTTP status; 0: no response yet."""
        self._send = send
        self._is_head = scope["method"] == "HEAD"
        self._is_complete = False
        self._connection: BoundedHttpProtocol | None = None
        """The connection, if it closes after the response."""
        if _CONNECTION_CLOSE in scope["headers"]:
            self._connection = scope.get(CONNECTION)

    async def send(self, message: Message) -> None:
        """Send a message of the application."""
        if message["type"] == "http.response.start":
            self.status = message["status"]
            message["headers"] = [*message.get("headers", ()), *self.headers]
        elif self._is_complete:  # the rest of the body of a HEAD request
            return
        elif message["type"] == "http.response.body":
            if self._is_head:
                message = {"type": "http.response.body", "body": b"", "more_body": False}
            self._is_complete = not message.get("more_body", False)
            if self._is_complete and self._connection is not None and self._connection.state is State.BODY:
                await self._send({**message, "more_body": True})
                await self._discard_body()
                message = {"type": "http.response.body", "body": b"", "more_body": False}
        await self._send(message)

    async def _discard_body(self) -> None:
        """Receive the rest of the request's body."""
        discarded_bytes, has_body = 0, True
        with suppress(TimeoutError):
            async with asyncio.timeout(DISCARD_SECONDS):
                while has_body and discarded_bytes <= DISCARD_BYTES:
                    piece = await self.receive()
                    discarded_bytes += len(piece.get("body", b""))
                    has_body = piece.get("more_body", False)
