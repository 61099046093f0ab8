"""Access control over HTTP: tokens, cross-site requests (CSRF), headers for browsers, trusted hosts (DNS rebinding)."""

from __future__ import annotations

import ipaddress
import time
from collections.abc import Awaitable, Callable, Collection
from typing import Final
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.server.error_handlers import redirect
from gateway.server.tokens import COOKIE_SECONDS, Tokens

COOKIE_NAME: Final = "scenegate"
"""Name of the cookie for browsers."""
TOKEN_PARAMETER: Final = "token"  # noqa: S105 - a name
"""Query parameter: ``/view?token=…`` sets the cookie and redirects to the URL without the token."""
LOCAL_ORIGINS: Final = ("http://localhost:*", "http://127.0.0.1:*")
"""Origins of pages of the browser's own machine, as a content security policy names them."""
CORS_EXPOSED: Final = ("X-Request-ID", "X-Scene-Revision", "X-Frame", "Retry-After", "ETag")
"""Response headers that pages of the allowed origins may read."""
AUTHORIZED: Final = "scenegate.authorized"
"""Key of the scope on open paths: True if the client sent a token. Missing if the gateway has no tokens."""
_SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that do not change anything."""
_DEFAULT_PORTS: Final = {"http": 80, "https": 443}
"""Default ports, which browsers omit in Origin and Host."""
_MAX_ECHO: Final = 100
"""Maximum number of characters of a header in a response."""
_POLICY_VIOLATION: Final = 1008
"""WebSocket close code; before the handshake is complete the client gets 403."""


class Access:
    """ASGI middleware: respond with 401 without a token, before the body is read."""

    def __init__(
        self,
        app: ASGIApp,
        *,
        tokens: Tokens,
        open_paths: Collection[str] = (),
        cookie_path: str = "/",
        clock: Callable[[], float] = time.time,
    ) -> None:
        """
        Args:
            open_paths: paths that need no token, such as health; ``AUTHORIZED`` in the scope says if there was one.
            cookie_path: path for which browsers send the cookie: that of the gateway on the host that they see.
            clock: returns Unix time in seconds, for the age of cookies.
        """
        self._app = app
        self._tokens = tokens
        self._open_paths = open_paths
        self._cookie_path = cookie_path
        self._clock = clock

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] == "lifespan":
            return self._app(scope, receive, send)
        headers = Headers(scope=scope)
        authorized = self._tokens.accept_header(headers.get("authorization", "")) or self._tokens.accept_cookie(
            _cookie(headers), self._clock()
        )
        is_open = scope["path"] in self._open_paths
        if is_open:
            scope[AUTHORIZED] = authorized
        if is_open or authorized:
            return self._app(scope, receive, send)
        if scope["type"] == "websocket":
            return send({"type": "websocket.close", "code": _POLICY_VIOLATION, "reason": "a token is needed"})
        return self._redirect_or_reject(scope)(scope, receive, send)

    def _redirect_or_reject(self, scope: Scope) -> Response:
        """Return a redirect that sets the cookie if the query has a valid token, else 401."""
        query = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)
        tokens = [value for name, value in query if name == TOKEN_PARAMETER]
        if scope["method"] == "GET" and tokens and self._tokens.accept(tokens[0]):
            other_parameters = urlencode([(name, value) for name, value in query if name != TOKEN_PARAMETER])
            # The last part only, after "./": "//host" and "name:" would be other places.
            response = redirect(f"./{quote(scope['path'].rpartition('/')[2])}", other_parameters, 303)
            secure = scope.get("scheme") == "https"
            cookie = self._tokens.cookie(tokens[0], self._clock())
            response.set_cookie(
                COOKIE_NAME,
                cookie,
                COOKIE_SECONDS,
                path=self._cookie_path,
                httponly=True,
                samesite="lax",
                secure=secure,
            )
            response.headers["Cache-Control"] = "no-store"
            response.headers["Referrer-Policy"] = "no-referrer"
            return response
        return PlainTextResponse(
            "A token is needed: 'Authorization: Bearer TOKEN', or ?token=TOKEN once in a browser.\n",
            401,
            {"WWW-Authenticate": 'Bearer realm="scenegate"', "Cache-Control": "no-store"},
        )


def _cookie(headers: Headers) -> str:
    """Return the value of the gateway's cookie; empty if there is none."""
    for part in headers.get("cookie", "").split(";"):
        name, _, value = part.strip().partition("=")
        if name == COOKIE_NAME:
            return value
    return ""


class CsrfProtection:
    """ASGI middleware: reject requests with side effects from pages of other sites with 403.

    Browsers let any page send a POST to any host, including services on localhost. They add its origin: in
    ``Sec-Fetch-Site`` for HTTPS and localhost, in ``Origin`` always. Other programs send neither.
    """

    def __init__(self, app: ASGIApp, *, origins: Collection[str] = ()) -> None:
        """``origins``: origins that may send such requests, such as ``https://example.org``; ``*`` for any."""
        self._app = app
        self._origins = frozenset(origins)

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] == "http" and scope["method"] not in _SAFE_METHODS and (page := self._foreign_page(scope)):
            text = f"{scope['method']} refused: it was sent by a page of another site ({page}).\n"
            text += "To allow that site, add its origin to --cors-origins.\n"
            return PlainTextResponse(text, 403)(scope, receive, send)
        return self._app(scope, receive, send)

    def _foreign_page(self, scope: Scope) -> str:
        """Return the header that identifies a page of another site, for messages; empty if it is not one."""
        headers = Headers(scope=scope)
        origin, site = headers.get("origin"), headers.get("sec-fetch-site")
        if "*" in self._origins or origin in self._origins:
            return ""
        if site is not None:
            allowed = site in ("same-origin", "none")
        else:
            allowed = origin is None or same_origin(origin, headers.get("host", ""), scope.get("scheme", "http"))
        if allowed:
            return ""
        header = f"Origin: {origin}" if origin is not None else f"Sec-Fetch-Site: {site}"
        return ascii(header[:_MAX_ECHO])[1:-1]


class SecurityHeaders:
    """ASGI middleware: headers against guessed content types and against frames on other sites."""

    def __init__(self, app: ASGIApp, *, origins: Collection[str] = ()) -> None:
        """``origins``: origins that may embed the gateway's pages, such as ``https://example.org``; ``*`` for any.

        Pages of programs on the browser's own machine, such as notebooks, may always embed them.
        """
        self._app = app
        embedders = [*LOCAL_ORIGINS, *sorted(origin for origin in origins if origin != "null")]
        ancestors = "*" if "*" in origins else " ".join(["'self'", *embedders])
        self._headers: Final = (
            (b"content-security-policy", f"frame-ancestors {ancestors}".encode()),
            (b"x-content-type-options", b"nosniff"),
        )

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        def send_with_headers(message: Message) -> Awaitable[None]:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *self._headers]
            return send(message)

        return self._app(scope, receive, send_with_headers if scope["type"] == "http" else send)


class TrustedHosts:
    """ASGI middleware: reject requests to unknown host names with 421, against DNS rebinding.

    In this attack a page's own host name is changed to resolve to 127.0.0.1. Numeric addresses are always accepted, and
    requests without a Host header, since browsers send one.
    """

    def __init__(self, app: ASGIApp, *, names: Collection[str] = ()) -> None:
        """``names``: accepted in addition to addresses and localhost; ``*`` for any, ``*.example.org`` for subdomains.

        Without names any is accepted on connections that do not use loopback: the names of this machine are not known,
        and an attacker on the network can connect without the attack.
        """
        self._app = app
        self._names = frozenset(name.lower() for name in names)

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] == "lifespan" or self._trusts(scope):
            return self._app(scope, receive, send)
        if scope["type"] == "websocket":
            reason = "the Host header names another host"
            return send({"type": "websocket.close", "code": _POLICY_VIOLATION, "reason": reason})
        text = "This gateway is not the host that the Host header names; --trusted-hosts adds names.\n"
        return PlainTextResponse(text, 421)(scope, receive, send)

    def _trusts(self, scope: Scope) -> bool:
        hosts = [value for name, value in scope["headers"] if name == b"host"]
        if len(hosts) > 1:  # another reader may use the other one
            return False
        host = hosts[0].decode("latin-1") if hosts else ""
        name = host_name(host)
        if not host or "*" in self._names or name == "localhost" or name.endswith(".localhost") or _is_address(name):
            return True
        if not self._names:
            address = (scope.get("server") or ("", None))[0]
            return not is_loopback(str(address))
        return name in self._names or any(f"*.{domain}" in self._names for domain in _parent_domains(name))


def same_origin(origin: str, host: str, scheme: str) -> bool:
    """Return whether a page of ``origin`` was loaded from the server ``host``.

    An http origin is not the same as an https server. An https origin matches an http server, which may be behind a
    proxy with TLS.

    Args:
        origin: the Origin header, such as ``https://example.org:8443``.
        host: the Host header, such as ``example.org:8443``.
        scheme: scheme of the request: http, https, ws or wss.
    """
    try:
        page, server = urlsplit(origin), urlsplit(f"//{host}")
        default = _DEFAULT_PORTS.get(page.scheme)
        ports = [default if part.port is None else part.port for part in (page, server)]
    except ValueError:  # invalid port or IPv6 address
        return False
    if default is None or page.hostname is None or (page.scheme == "http" and scheme in ("https", "wss")):
        return False
    return page.hostname == server.hostname and ports[0] == ports[1]


def host_name(host: str) -> str:
    """Return a Host header in lower case without port and without brackets of IPv6 addresses."""
    host = host.strip().lower()
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] if host.count(":") == 1 else host


def is_loopback(host: str) -> bool:
    """Return whether ``host`` is a loopback address or ``localhost``."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _parent_domains(name: str) -> list[str]:
    labels = name.split(".")
    return [".".join(labels[index:]) for index in range(1, len(labels))]
