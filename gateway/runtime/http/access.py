"""Access control over HTTP: tokens, and what ``Origin`` and ``Host`` of a request say."""

import ipaddress
import time
from collections.abc import Callable, Collection
from typing import Final
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, Response
from starlette.types import Scope

from gateway.runtime.http.error_handlers import redirect
from gateway.runtime.http.tokens import COOKIE_SECONDS, Tokens

COOKIE_NAME: Final = "scenegate"
"""Name of the cookie for browsers."""
TOKEN_PARAMETER: Final = "token"  # noqa: S105 - a name
"""Query parameter: ``/view?token=…`` sets the cookie and redirects to the URL without the token."""
CORS_EXPOSED: Final = ("X-Request-ID", "X-Scene-Revision", "X-Frame", "Retry-After", "ETag")
"""Response headers that pages of the allowed origins may read."""
AUTHORIZED: Final = "scenegate.authorized"
"""Key of the scope on open paths: True if the client sent a token. Missing if the gateway has no tokens."""
_DEFAULT_PORTS: Final = {"http": 80, "https": 443}
"""Default ports, which browsers omit in Origin and Host."""
POLICY_VIOLATION: Final = 1008
"""WebSocket close code; before the handshake is complete the client gets 403."""


_NO_TOKEN: Final = PlainTextResponse(
    "A token is needed: 'Authorization: Bearer TOKEN', or ?token=TOKEN once in a browser.\n",
    401,
    {"WWW-Authenticate": 'Bearer realm="scenegate"', "Cache-Control": "no-store"},
)


class Access:
    """Refuses requests without a token: 401."""

    def __init__(
        self,
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
        self._tokens = tokens
        self._open_paths = open_paths
        self._cookie_path = cookie_path
        self._clock = clock

    def refusal(self, scope: Scope) -> Response | None:
        """Return the response to a request or WebSocket handshake that is refused; None if it is not."""
        headers = Headers(scope=scope)
        authorized = self._tokens.accept_header(headers.get("authorization", "")) or self._tokens.accept_cookie(
            _cookie(headers), self._clock()
        )
        is_open = scope["path"] in self._open_paths
        if is_open:
            scope[AUTHORIZED] = authorized
        if is_open or authorized:
            return None
        return _NO_TOKEN if scope["type"] == "websocket" else self._redirect_or_reject(scope)

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
        return _NO_TOKEN


def _cookie(headers: Headers) -> str:
    """Return the value of the gateway's cookie; empty if there is none."""
    for part in headers.get("cookie", "").split(";"):
        name, _, value = part.strip().partition("=")
        if name == COOKIE_NAME:
            return value
    return ""


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
        default_port = _DEFAULT_PORTS.get(page.scheme)
        page_port, server_port = (default_port if url.port is None else url.port for url in (page, server))
    except ValueError:  # invalid port or IPv6 address
        return False
    if default_port is None or page.hostname is None or (page.scheme == "http" and scheme in ("https", "wss")):
        return False
    return page.hostname == server.hostname and page_port == server_port


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
