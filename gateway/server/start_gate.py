"""ASGI middleware for requests that arrive before the gateway has started."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection

from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from gateway.runtime.kernel_progress import Progress
from gateway.server.starting_page import starting_page


class StartGate:
    """Respond to requests until the interfaces have started.

    A browser gets a page that shows the progress and opens the requested one afterwards. Other requests get 503 with
    Retry-After while kernels are compiled (tens of seconds), and wait while they are loaded (a second).
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        started: asyncio.Event,
        problem: Callable[[], str],
        open_paths: Collection[str],
        compiling: Callable[[], Progress | None] = lambda: None,
    ) -> None:
        """
        Args:
            started: set when the interfaces have started, or when the start has failed.
            problem: returns why the gateway failed to start, or an empty string.
            open_paths: paths of requests that need no interface.
            compiling: returns the progress of compiling kernels, None if none are compiled.
        """
        self._app = app
        self._started = started
        self._problem = problem
        self._open_paths = open_paths
        self._compiling = compiling

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan" or scope["path"] in self._open_paths:
            await self._app(scope, receive, send)
            return
        if not self._started.is_set():
            if (response := self._response(scope)) is not None:
                await response(scope, receive, send)
                return
            await self._started.wait()
        if scope["type"] == "http" and (problem := self._problem()):
            await PlainTextResponse(f"The gateway did not start: {problem}\n", status_code=503)(scope, receive, send)
            return
        await self._app(scope, receive, send)

    def _response(self, scope: Scope) -> Response | None:
        """Return the response before the start, or None if the request waits."""
        progress = self._compiling()
        if scope["type"] == "http" and scope["method"] == "GET" and _accepts_html(scope):
            return HTMLResponse(starting_page(progress), 503, {"Retry-After": "1", "Cache-Control": "no-store"})
        if progress is None:
            return None
        text = f"Scenegate is starting: {progress}. Try again in {progress.retry_after} s.\n"
        return PlainTextResponse(text, 503, {"Retry-After": str(progress.retry_after)})


def _accepts_html(scope: Scope) -> bool:
    """Return whether a person reads the response: browsers name HTML when they open a page, programs do not."""
    return any(name == b"accept" and b"text/html" in value for name, value in scope["headers"])
