"""Requests that go past the router."""

from __future__ import annotations

from collections.abc import Mapping

from starlette.types import ASGIApp, Receive, Scope, Send


class Straight:
    """ASGI middleware, the innermost: a route that is asked for many hundred times a second, and needs the request and
    nothing else, is found at once. On its way through the router, the framework would look for its dependencies and
    provide for what their ends may do, which takes as long as to read a request's head and all of its fields.

    The routes are the router's as well: it describes them, and answers what is not exactly their method and path.
    """

    def __init__(self, app: ASGIApp, *, routes: Mapping[tuple[str, str], ASGIApp]) -> None:
        """``routes``: by method and path; each must set ``scope["route"]``. More may come later."""
        self._app = app
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and not scope.get("root_path"):
            route = self._routes.get((scope["method"], scope["path"]), self._app)
        else:
            route = self._app
        await route(scope, receive, send)
