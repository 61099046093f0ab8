"""What every HTTP request gets: an id, a log line, its figures; and a place to wait until the gateway has started."""

from __future__ import annotations

import asyncio
import random
import re
import time
from collections.abc import Callable, Collection

import structlog
from starlette.middleware import body_limit
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.runtime.metrics_registry import Metrics

_log = structlog.get_logger("gateway.http")
_ID = re.compile(r"[A-Za-z0-9._:/+=-]{1,128}")
"""What a client may send as X-Request-ID; anything else could forge log lines and is replaced."""

_TOO_LARGE = tuple(
    found
    for name in ("_RequestBodyTooLarge", "_RequestBodyLimitResponseSent")
    if (found := getattr(body_limit, name, None)) is not None
)
"""How the framework's bound on bodies says that it answers, or has answered; there are no public names."""


def request_id(sent: bytes) -> str:
    """The id of a request: what its X-Request-ID says, or a new one where that is missing or unfit; ASCII."""
    text = sent.decode("latin-1")
    return text if _ID.fullmatch(text) else f"{random.getrandbits(128):032x}"


class Requests:
    """ASGI middleware: X-Request-ID in and out, bound to every log line; counts and durations; one line a request."""

    def __init__(self, app: ASGIApp, *, metrics: Metrics, quiet: Collection[str] = ()) -> None:
        self._app = app
        self._metrics = metrics
        self._quiet = quiet

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        identity = request_id(dict(scope["headers"]).get(b"x-request-id", b""))
        status = 0

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message["headers"] = [*message.get("headers", ()), (b"x-request-id", identity.encode())]
            await send(message)

        start = time.perf_counter()
        with structlog.contextvars.bound_contextvars(request_id=identity), self._metrics.in_flight.track_inprogress():
            try:
                await self._app(scope, receive, send_with_id)
            except _TOO_LARGE:
                status = 413
                raise
            except Exception as error:  # a defect of ours; Drake prints the body, so it is one line
                _log.exception("unhandled", path=scope["path"])
                if status:
                    raise  # the answer has begun: the connection must break, or a cut picture looks whole
                text = f"Internal error: {type(error).__name__}: {error}"[:1000] + f" (request {identity})\n"
                await PlainTextResponse(text, status_code=500)(scope, receive, send_with_id)
            finally:
                seconds = time.perf_counter() - start
                # The route's template, never the path as sent: a scanner must not fill the registry with labels.
                route = getattr(scope.get("route"), "path", "(none)")
                self._metrics.answered(route, scope["method"], status or "aborted", seconds)
                note = _log.debug if scope["path"] in self._quiet else _log.info
                note("request", method=scope["method"], path=scope["path"], status=status, ms=round(seconds * 1e3, 1))


class Gate:
    """ASGI middleware: requests that come before the interfaces have started wait for it, ``open_paths`` apart."""

    def __init__(
        self, app: ASGIApp, *, started: asyncio.Event, problem: Callable[[], str], open_paths: Collection[str]
    ) -> None:
        self._app = app
        self._started = started
        self._problem = problem
        self._open = open_paths

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan" or scope["path"] in self._open:
            await self._app(scope, receive, send)
            return
        if not self._started.is_set():
            await self._started.wait()
        if scope["type"] == "http" and (problem := self._problem()):
            await PlainTextResponse(f"The gateway did not start: {problem}\n", status_code=503)(scope, receive, send)
            return
        await self._app(scope, receive, send)
