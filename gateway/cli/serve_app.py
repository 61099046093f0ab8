"""Serve one application in this process, for ``scenegate serve`` and for each process of ``--workers``."""

from __future__ import annotations

import asyncio
import os
import socket
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import structlog
import uvloop

from gateway.cli.first_line import STOPPED
from gateway.runtime.http import http_server
from gateway.runtime.workers import process_tuning

if TYPE_CHECKING:
    from fastapi import FastAPI

    from gateway.wiring.context import Context


NOT_STARTED: Final = 3
"""Exit code of a process that could not start, as uvicorn's own."""
RESPONSE_SECONDS: Final = 1.0
"""Time after ``--shutdown-seconds`` for the responses to requests that have ended with it, before uvicorn closes their
connections."""
CLOSE_SECONDS: Final = 0.5
"""Time after that for the application to close, before the process ends although threads still run."""


def serve_app(create: Callable[..., FastAPI], listener: socket.socket) -> int:
    """Serve an application until a signal. Return 0, 1 after a fatal error, or 3 if it could not start.

    ``create`` is ``create_app`` with all arguments but ``on_started`` and ``on_fatal``.
    """
    log = structlog.get_logger("gateway")
    fatal = False

    def stop_with_error() -> None:
        nonlocal fatal
        fatal = server.should_exit = True

    app = create(on_started=process_tuning.freeze_gc, on_fatal=stop_with_error)
    context: Context = app.state.context
    seconds = context.settings.shutdown_seconds

    def begin_shutdown() -> None:
        log.info("Scenegate stops; requests that it has accepted may finish", seconds=seconds)
        watchdog.start()
        context.begin_shutdown()

    def end_now() -> None:
        """End the process although threads still load kernels or read a file."""
        log.info(STOPPED)
        os._exit(int(fatal))

    config = http_server.server_config(app, seconds + RESPONSE_SECONDS, lifespan=True, tls=context.security.tls)
    server = http_server.MainServer(config, begin_shutdown)
    watchdog = threading.Timer(seconds + RESPONSE_SECONDS + CLOSE_SECONDS, end_now)
    watchdog.daemon = True
    app.state.closing = lambda: server.should_exit  # endless responses (MJPEG) end by it
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(server.serve(sockets=[listener]))
    watchdog.cancel()
    if fatal:
        return 1
    return 0 if server.started else NOT_STARTED
