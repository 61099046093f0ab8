"""Protection of browsers from pages of other sites, and of the gateway from long URLs."""

from collections.abc import Collection
from contextlib import suppress
from functools import lru_cache
from ipaddress import ip_address
from typing import Final

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, Response
from starlette.types import Scope

from gateway.runtime.http.access import host_name, is_loopback, same_origin

MAX_TARGET_BYTES: Final = 8 << 10
"""Maximum length of path and query of a URL. RFC 9110 asks for at least 8000; parsing 64 kB takes 20 ms."""

LOCAL_ORIGINS: Final = ("http://localhost:*", "http://127.0.0.1:*")
"""Origins of pages of the browser's own machine, as a content security policy names them."""

_SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that do not change anything."""
_MAX_ECHO: Final = 100
"""Maximum number of characters of a header in a response."""
_MAX_CACHED_HOSTS: Final = 64
"""Number of Host headers, of at most 64 kB, whose check is remembered."""


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
        self, *, hosts: Collection[str] = (), origins: Collection[str] = (), frame_origins: Collection[str] = ()
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
        self._hosts = frozenset(name.lower() for name in hosts)
        self._origins = frozenset(origins)
        embedders = {*origins, *frame_origins} - {"null"}
        ancestors = "*" if "*" in embedders else " ".join(["'self'", *LOCAL_ORIGINS, *sorted(embedders)])
        self.headers: Final = (
            (b"content-security-policy", f"frame-ancestors {ancestors}".encode()),
            (b"x-content-type-options", b"nosniff"),
            (b"cross-origin-resource-policy", b"cross-origin" if self._origins else b"same-site"),
        )
        self._trusts = lru_cache(maxsize=_MAX_CACHED_HOSTS)(self._is_trusted)

    def refusal(self, scope: Scope) -> Response | None:
        """Return the response to a request or WebSocket handshake that is refused; None if it is not."""
        if scope["type"] == "http" and len(scope["raw_path"]) + len(scope["query_string"]) > MAX_TARGET_BYTES:
            return PlainTextResponse(f"The path with its query is longer than {MAX_TARGET_BYTES} bytes.\n", 414)
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        host = hosts[0] if hosts else ""
        # With several Host headers, another reader may use the other one.
        if len(hosts) > 1 or not self._trusts(host, (scope.get("server") or ("",))[0]):
            text = "This gateway is not the host that the Host header names; --trusted-hosts adds names.\n"
            return PlainTextResponse(text, 421)
        if scope["type"] == "websocket":
            return None
        # Several headers are joined as in RFC 9110, section 5.2. The result is no origin that is allowed.
        origin = ", ".join(headers.getlist("origin")) if "origin" in headers else None
        fetch_site = ", ".join(headers.getlist("sec-fetch-site")) if "sec-fetch-site" in headers else None
        has_effects = scope["method"] not in _SAFE_METHODS
        if (has_effects and self._is_foreign(scope, host, origin, fetch_site)) or (
            fetch_site == "cross-site" and headers.get("sec-fetch-mode") != "navigate" and not self._origins
        ):
            header = f"Origin: {origin}" if origin is not None else f"Sec-Fetch-Site: {fetch_site}"
            page = ascii(header[:_MAX_ECHO])[1:-1]
            text = f"{scope['method']} refused: it was sent by a page of another site ({page}).\n"
            return PlainTextResponse(f"{text}To allow that site, add its origin to --cors-origins.\n", 403)
        return None

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
