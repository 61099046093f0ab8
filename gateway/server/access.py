"""Access over HTTP: the token, the Host header against DNS rebinding, pages of other sites (CSRF)."""

from __future__ import annotations

import ipaddress
import time
from collections.abc import Callable, Collection
from functools import lru_cache
from typing import Final
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.server.tokens import COOKIE_SECONDS, Tokens

COOKIE: Final = "scenegate"
QUERY: Final = "token"
"""``/view?token=…`` gives a browser the cookie and goes on without the token in the address."""
CORS_EXPOSED: Final = ("X-Request-ID", "X-Scene-Revision", "X-Frame", "Retry-After", "ETag")
"""Headers of answers that pages of the allowed origins may read."""
ADMITTED: Final = "scenegate.admitted"
"""Key of the scope on open paths: whether the client has shown a token. Missing where none is asked for."""
_SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing."""
_PORTS: Final = {"http": 80, "https": 443}
"""Ports that browsers leave out of Origin and Host."""
_SHOWN: Final = 100
"""Characters of a header that an answer repeats."""
_REFUSED: Final = 1008
"""WebSocket close code; before the connection is accepted the client sees 403."""


class Access:
    """ASGI middleware: 401 without the token, before anything of the body is read."""

    def __init__(
        self,
        app: ASGIApp,
        *,
        tokens: Tokens,
        open_paths: Collection[str] = (),
        clock: Callable[[], float] = time.time,
    ) -> None:
        """
        Args:
            open_paths: answered without a token (health, for monitoring); ``ADMITTED`` tells them whether there is one.
            clock: seconds since 1970, for the age of cookies.
        """
        self._app = app
        self._tokens = tokens
        self._open = open_paths
        self._clock = clock

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        admitted = self._tokens.accept_header(headers.get("authorization", "")) or self._tokens.accept_cookie(
            _cookie(headers), self._clock()
        )
        if scope["path"] in self._open:
            scope[ADMITTED] = admitted
            await self._app(scope, receive, send)
        elif admitted:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": _REFUSED, "reason": "a token is needed"})
        else:
            await self._answer(scope)(scope, receive, send)

    def _answer(self, scope: Scope) -> Response:
        query = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)
        sent = [value for name, value in query if name == QUERY]
        if scope["method"] == "GET" and sent and self._tokens.accept(sent[0]):
            rest = urlencode([(name, value) for name, value in query if name != QUERY])
            # One slash: "//host" would lead to another host.
            path = "/" + quote(scope["path"].lstrip("/"))
            answer = Response(status_code=303, headers={"Location": f"{path}?{rest}" if rest else path})
            secure = scope.get("scheme") == "https"
            cookie = self._tokens.cookie(sent[0], self._clock())
            answer.set_cookie(COOKIE, cookie, COOKIE_SECONDS, httponly=True, samesite="lax", secure=secure)
            answer.headers["Cache-Control"] = "no-store"
            answer.headers["Referrer-Policy"] = "no-referrer"
            return answer
        return PlainTextResponse(
            "A token is needed: 'Authorization: Bearer TOKEN', or ?token=TOKEN once in a browser.\n",
            401,
            {"WWW-Authenticate": 'Bearer realm="scenegate"', "Cache-Control": "no-store"},
        )


def _cookie(headers: Headers) -> str:
    for part in headers.get("cookie", "").split(";"):
        name, _, value = part.strip().partition("=")
        if name == COOKIE:
            return value
    return ""


class CsrfProtection:
    """ASGI middleware: refuse requests that change something and come from a page of another site with 403.

    Browsers let any page send a POST to any host, this machine's services among them. They say where it comes from: by
    ``Sec-Fetch-Site`` to hosts that they reach by HTTPS or as localhost, by ``Origin`` to all. Programs send neither.
    """

    def __init__(self, app: ASGIApp, *, origins: Collection[str] = ()) -> None:
        """``origins``: pages that may send such requests, as ``https://example.org``; ``*`` for any."""
        self._app = app
        self._origins = frozenset(origins)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["method"] not in _SAFE and (page := self._foreign_page(scope)):
            text = f"{scope['method']} refused: it was sent by a page of another site ({page}).\n"
            text += "To allow that site, add its origin to --cors-origins.\n"
            await PlainTextResponse(text, 403)(scope, receive, send)
        else:
            await self._app(scope, receive, send)

    def _foreign_page(self, scope: Scope) -> str:
        """The header that tells a page of another site, for messages; empty: it is not one."""
        headers = Headers(scope=scope)
        origin, site = headers.get("origin"), headers.get("sec-fetch-site")
        if "*" in self._origins or origin in self._origins:
            return ""
        if site is not None:
            own = site in ("same-origin", "none")
        else:
            own = origin is None or same_origin(origin, headers.get("host", ""), scope.get("scheme", "http"))
        if own:
            return ""
        shown = f"Origin: {origin}" if origin is not None else f"Sec-Fetch-Site: {site}"
        return ascii(shown[:_SHOWN])[1:-1]


class SecurityHeaders:
    """ASGI middleware: tell browsers not to guess content types, nor to show answers in frames of other sites."""

    def __init__(self, app: ASGIApp, *, origins: Collection[str] = ()) -> None:
        """``origins``: pages that may show ours in a frame, as ``https://example.org``; ``*`` for any."""
        self._app = app
        named = sorted(origin for origin in origins if origin != "null")
        ancestors = "*" if "*" in origins else " ".join(["'self'", *named])
        self._headers: Final = (
            (b"content-security-policy", f"frame-ancestors {ancestors}".encode()),
            (b"x-content-type-options", b"nosniff"),
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *self._headers]
            await send(message)

        await self._app(scope, receive, send_with_headers if scope["type"] == "http" else send)


class TrustedHosts:
    """ASGI middleware: a page of another site that has its name point to 127.0.0.1 (DNS rebinding) gets 421.

    Numbers are always right: only a name can be made to point elsewhere. Programs that send no Host are no browsers.
    """

    def __init__(self, app: ASGIApp, *, names: Collection[str] = ()) -> None:
        """``names``: accepted besides numbers and localhost; ``*`` for any, ``*.example.org`` for those below.

        Without names any is accepted on connections that come from other machines: their addresses are not ours to
        know, and the attack is worth nothing where the attacker can connect by himself.
        """
        self._app = app
        self._names = frozenset(name.lower() for name in names)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan" or self._trusts(scope):
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": _REFUSED, "reason": "the Host header names another host"})
        else:
            text = "This gateway is not the host that the Host header names; --trusted-hosts adds names.\n"
            await PlainTextResponse(text, 421)(scope, receive, send)

    def _trusts(self, scope: Scope) -> bool:
        hosts = [value for name, value in scope["headers"] if name == b"host"]
        if len(hosts) > 1:  # whoever reads the other one believes something else
            return False
        host = hosts[0].decode("latin-1") if hosts else ""
        name = host_name(host)
        if not host or "*" in self._names or name == "localhost" or name.endswith(".localhost") or _is_number(name):
            return True
        if not self._names:
            here = (scope.get("server") or ("", None))[0]
            return not is_loopback(str(here))
        return name in self._names or any(f"*.{tail}" in self._names for tail in _tails(name))


def same_origin(origin: str, host: str, scheme: str) -> bool:
    """Return whether a page of ``origin`` was loaded from the server that requests name ``host``.

    An origin without TLS is foreign to a server with TLS. A server without TLS may stand behind a proxy that has it.

    Args:
        origin: the header, as ``https://example.org:8443``.
        host: the header, as ``example.org:8443``.
        scheme: of the request: http, https, ws or wss.
    """
    try:
        page, server = urlsplit(origin), urlsplit(f"//{host}")
        usual = _PORTS.get(page.scheme)
        ports = [usual if part.port is None else part.port for part in (page, server)]
    except ValueError:  # no port, or brackets that are no address
        return False
    if usual is None or page.hostname is None or (page.scheme == "http" and scheme in ("https", "wss")):
        return False
    return page.hostname == server.hostname and ports[0] == ports[1]


def host_name(host: str) -> str:
    """A Host header without its port, in lower case; brackets of IPv6 addresses are taken off."""
    host = host.strip().lower()
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] if host.count(":") == 1 else host


def is_loopback(host: str) -> bool:
    """Whether an address, or ``localhost``, is of this machine alone."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


@lru_cache(64)
def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _tails(name: str) -> list[str]:
    labels = name.split(".")
    return [".".join(labels[index:]) for index in range(1, len(labels))]
