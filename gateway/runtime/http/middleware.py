"""ASGI middleware for every HTTP request: ids, logs, metrics, protection of browsers, HEAD, early responses."""

from __future__ import annotations

import asyncio
import re
import secrets
import time
from collections.abc import Awaitable, Collection
from contextlib import suppress
from functools import lru_cache
from ipaddress import ip_address
from typing import Final

import structlog
from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.runtime.http.access import POLICY_VIOLATION, host_name, is_loopback, same_origin
from gateway.runtime.http.http_protocol import CONNECTION, DISCARD_BYTES, DISCARD_SECONDS, BoundedHttpProtocol, State
from gateway.runtime.logs.metrics_registry import Metrics

MAX_TARGET_BYTES: Final = 8 << 10
"""Maximum length of path and query of a URL. RFC 9110 asks for at least 8000; parsing 64 kB takes 20 ms."""

LOCAL_ORIGINS: Final = ("http://localhost:*", "http://127.0.0.1:*")
"""Origins of pages of the browser's own machine, as a content security policy names them."""

_log = structlog.get_logger("gateway.http")
_CONNECTION_CLOSE: Final = (b"connection", b"close")
_SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that do not change anything."""
_MAX_ECHO: Final = 100
"""Maximum number of characters of a header in a response."""
_MAX_CACHED_HOSTS: Final = 64
"""Number of Host headers, of at most 64 kB, whose check is remembered."""
_VALID_REQUEST_ID: Final = re.compile(r"[A-Za-z0-9._:/+=-]{1,128}")
"""X-Request-ID of a client that is accepted. Others are replaced, since they could forge log lines."""


class RequestContext:
    """Gives each request an id (X-Request-ID) for its log lines and its response; counts, times and logs it."""

    def __init__(self, app: ASGIApp, *, metrics: Metrics, quiet_paths: Collection[str] = ()) -> None:
        """``quiet_paths``: paths whose requests are logged at debug level."""
        self._app = app
        self._metrics = metrics
        self._quiet_paths = quiet_paths

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        return (self._handle_request if scope["type"] == "http" else self._app)(scope, receive, send)

    async def _handle_request(self, scope: Scope, receive: Receive, send: Send) -> None:
        request_id = dict(scope["headers"]).get(b"x-request-id", b"").decode("latin-1")
        if not _VALID_REQUEST_ID.fullmatch(request_id):
            request_id = secrets.token_hex(16)
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


class Protection:
    """Protects the gateway from pages of other sites in a browser, and from long URLs.

    - A URL longer than ``MAX_TARGET_BYTES`` gets 414.
    - A request to an unknown host name gets 421, against DNS rebinding: there, a page's own host name is changed to
      resolve to 127.0.0.1. Numeric addresses are always accepted, and requests without a Host header, since browsers
      send one.
    - A request with side effects from a page of another site (CSRF) gets 403. Browsers let any page send a POST to any
      host, including services on localhost. They add its origin: in ``Sec-Fetch-Site`` for HTTPS and localhost, in
      ``Origin`` always. Other programs send neither.
    - A page of another site gets nothing to show either (403), unless there are ``origins``: an image costs the gateway
      more than the page. Links to the gateway work.
    - Headers of responses forbid guessed content types, frames on other sites, and use by pages of other sites.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        hosts: Collection[str] = (),
        origins: Collection[str] = (),
        frame_origins: Collection[str] = (),
    ) -> None:
        """
        Args:
            hosts: names accepted in addition to addresses and localhost; ``*`` for any, ``*.example.org`` for
                subdomains. Without names any is accepted on connections that do not use loopback: the names of this
                machine are not known, and an attacker on the network can connect without the attack.
            origins: origins that may send requests with side effects and embed the gateway's pages, such as
                ``https://example.org``; ``*`` for any.
            frame_origins: origins that may only embed pages. Pages of programs on the browser's own machine, such as
                notebooks, always may.
        """
        self._app = app
        self._hosts = frozenset(name.lower() for name in hosts)
        self._origins = frozenset(origins)
        embedders = {*origins, *frame_origins} - {"null"}
        ancestors = "*" if "*" in embedders else " ".join(["'self'", *LOCAL_ORIGINS, *sorted(embedders)])
        self._headers: Final = (
            (b"content-security-policy", f"frame-ancestors {ancestors}".encode()),
            (b"x-content-type-options", b"nosniff"),
            (b"cross-origin-resource-policy", b"cross-origin" if self._origins else b"same-site"),
        )
        self._trusts = lru_cache(maxsize=_MAX_CACHED_HOSTS)(self._is_trusted)

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] == "lifespan":
            return self._app(scope, receive, send)
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        host = hosts[0] if hosts else ""
        # Several headers are joined as in RFC 9110, section 5.2. The result is no origin that is allowed.
        origin = ", ".join(headers.getlist("origin")) if "origin" in headers else None
        fetch_site = ", ".join(headers.getlist("sec-fetch-site")) if "sec-fetch-site" in headers else None
        # With several Host headers, another reader may use the other one.
        trusted = len(hosts) < 2 and self._trusts(host, (scope.get("server") or ("",))[0])
        if scope["type"] == "websocket":
            if trusted:
                return self._app(scope, receive, send)
            reason = "the Host header names another host"
            return send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": reason})

        def send_with_headers(message: Message) -> Awaitable[None]:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *self._headers]
            return send(message)

        app: ASGIApp = self._app
        has_effects = scope["method"] not in _SAFE_METHODS
        if len(scope["raw_path"]) + len(scope["query_string"]) > MAX_TARGET_BYTES:
            app = PlainTextResponse(f"The path with its query is longer than {MAX_TARGET_BYTES} bytes.\n", 414)
        elif not trusted:
            text = "This gateway is not the host that the Host header names; --trusted-hosts adds names.\n"
            app = PlainTextResponse(text, 421)
        elif (has_effects and self._is_foreign(scope, host, origin, fetch_site)) or (
            fetch_site == "cross-site" and headers.get("sec-fetch-mode") != "navigate" and not self._origins
        ):
            header = f"Origin: {origin}" if origin is not None else f"Sec-Fetch-Site: {fetch_site}"
            page = ascii(header[:_MAX_ECHO])[1:-1]
            text = f"{scope['method']} refused: it was sent by a page of another site ({page}).\n"
            app = PlainTextResponse(f"{text}To allow that site, add its origin to --cors-origins.\n", 403)
        return app(scope, receive, send_with_headers)

    def _is_foreign(self, scope: Scope, host: str, origin: str | None, fetch_site: str | None) -> bool:
        """Return True for a request from a page of another site; False if no page sent it: both headers are missing."""
        if "*" in self._origins or origin in self._origins:
            return False
        if fetch_site is not None:
            return fetch_site not in ("same-origin", "none")
        return origin is not None and not same_origin(origin, host, scope.get("scheme", "http"))

    def _is_trusted(self, host: str, address: str) -> bool:
        """Return True for a Host header that may be used on connections to ``address``; both may be empty."""
        name = host_name(host)
        if not host or "*" in self._hosts or name == "localhost" or name.endswith(".localhost"):
            return True
        with suppress(ValueError):
            ip_address(name)
            return True
        if not self._hosts:
            return not is_loopback(address)
        parts = name.split(".")
        return name in self._hosts or any(f"*.{'.'.join(parts[i:])}" in self._hosts for i in range(1, len(parts)))


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


class EarlyResponse:
    """ASGI middleware: receive the rest of a body before the end of its response closes the connection.

    A connection that closes with unread bytes is reset, and a reset discards the response on its way to the client.
    Connections that stay open do without: ``BoundedHttpProtocol`` discards what follows.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        connection: BoundedHttpProtocol | None = scope.get(CONNECTION)
        if connection is None or _CONNECTION_CLOSE not in scope["headers"]:
            return self._app(scope, receive, send)

        async def send_last(message: Message) -> None:
            is_last = message["type"] == "http.response.body" and not message.get("more_body", False)
            if not (is_last and connection.state is State.BODY):
                await send(message)
                return
            await send({**message, "more_body": True})
            discarded_bytes, has_body = 0, True
            with suppress(TimeoutError):
                async with asyncio.timeout(DISCARD_SECONDS):
                    while has_body and discarded_bytes <= DISCARD_BYTES:
                        piece = await receive()
                        discarded_bytes += len(piece.get("body", b""))
                        has_body = piece.get("more_body", False)
            await send({"type": "http.response.body", "body": b"", "more_body": False})

        return self._app(scope, receive, send_last)
