"""ASGI middleware that holds requests until the gateway has started."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection

from starlette.responses import HTMLResponse, PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from gateway.server.starting_page import Progress, starting_page


class StartGate:
    """Holds requests until the interfaces have started, because Drake's client does not retry.

    A browser that opens a page gets the starting page instead (``starting_page``).
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        started: asyncio.Event,
        problem: Callable[[], str],
        open_paths: Collection[str],
        progress: Callable[[], Progress | None] = lambda: None,
    ) -> None:
        """
        Args:
            started: set when the interfaces have started, or when the start has failed.
            problem: returns why the gateway failed to start, or an empty string.
            open_paths: paths of requests that are served during the start.
            progress: returns the progress of what takes long, if anything does.
        """
        self._app = app
        self._started = started
        self._problem = problem
        self._open_paths = open_paths
        self._progress = progress

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] == "lifespan" or scope["path"] in self._open_paths:
            return self._app(scope, receive, send)
        if not self._started.is_set():
            return self._respond_after_start(scope, receive, send)
        if scope["type"] == "http" and (problem := self._problem()):
            text = f"The gateway did not start: {problem}\n"
            return PlainTextResponse(text, status_code=503)(scope, receive, send)
        return self._app(scope, receive, send)

    async def _respond_after_start(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["method"] == "GET" and _accepts_html(scope):
            headers = {"Retry-After": "1", "Cache-Control": "no-store"}
            await HTMLResponse(starting_page(self._progress()), 503, headers)(scope, receive, send)
            return
        await self._started.wait()
        await self(scope, receive, send)


def _accepts_html(scope: Scope) -> bool:
    """Return True for a browser that opens a page: other clients do not list HTML in Accept."""
    return any(name == b"accept" and b"text/html" in value for name, value in scope["headers"])
