"""The path prefix of a gateway behind a proxy."""

from collections.abc import Awaitable
from urllib.parse import quote

from starlette.types import ASGIApp, Receive, Scope, Send

from gateway.runtime.http.error_handlers import redirect


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
