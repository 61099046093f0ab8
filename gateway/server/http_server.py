"""HTTP servers: the gateway's own, ended by a signal, and further ports for parts of it."""

from __future__ import annotations

import signal
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import uvicorn
from fastapi import FastAPI

from gateway.runtime import process_tuning
from gateway.server.http_protocol import BoundedHttpProtocol
from gateway.server.websocket_protocol import BoundedWebSocketProtocol

MAX_WEBSOCKET_BYTES: Final = 64 << 10
"""Of a message from a client; the browser view has nothing longer than 16 characters to say."""
KEEP_ALIVE_SECONDS: Final = 60
"""For the next request on a connection."""


def config(app: Any, grace_seconds: float, *, lifespan: bool, tls: tuple[Path, Path] | None = None) -> uvicorn.Config:
    """How all our servers are run. ``tls``: certificate and key, PEM."""
    return uvicorn.Config(
        app,
        http=BoundedHttpProtocol,
        ws=BoundedWebSocketProtocol,
        ws_max_size=MAX_WEBSOCKET_BYTES,
        ssl_certfile=tls[0] if tls is not None else None,
        ssl_keyfile=tls[1] if tls is not None else None,
        ws_per_message_deflate=False,  # floats do not compress, the CPU time is gone all the same
        lifespan="on" if lifespan else "off",
        log_config=None,
        access_log=False,  # gateway.server.middleware writes one with the request's id
        server_header=False,
        timeout_keep_alive=KEEP_ALIVE_SECONDS,
        timeout_graceful_shutdown=grace_seconds,  # type: ignore[arg-type]  # a float does as well
        backlog=2048,
    )


class MainServer(uvicorn.Server):
    """Ends with exit code 0 after SIGTERM or SIGINT; uvicorn would raise the signal once more."""

    def __init__(self, config: uvicorn.Config, leave: Callable[[], None] = lambda: None) -> None:
        """
        Args:
            leave: called in the event loop when the end begins, before connections are waited for.
        """
        super().__init__(config)
        self._leave = leave

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Takes no new connection, lets requests finish, then ends the application."""
        self._leave()
        await super().shutdown(sockets)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        before = {number: signal.signal(number, self.handle_exit) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


class _GuestServer(uvicorn.Server):
    """Leaves signals to the main server."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class PortService:
    """A further port in the same event loop, as a service: it serves ``app`` until cancelled."""

    def __init__(self, app: FastAPI, host: str, port: int, tls: tuple[Path, Path] | None = None) -> None:
        self._app = app
        self._host = host
        self._port = port
        self._tls = tls
        self._server: uvicorn.Server | None = None
        self._bound = 0

    @property
    def ready(self) -> bool:
        """Whether it listens."""
        return self._server is not None and self._server.started

    def status(self) -> Mapping[str, Any]:
        """Plain JSON values."""
        return {"port": self._bound}

    async def run(self) -> None:
        """Serves until cancelled.

        Raises:
            OSError: the port cannot be used; one sentence.
        """
        try:
            listener = process_tuning.listen(self._host, self._port)
        except OSError as error:
            raise OSError(f"cannot listen: {process_tuning.listen_error(error, self._host, self._port)}") from None
        self._bound = _port_of(listener)
        self._server = server = _GuestServer(config(self._app, 1.0, lifespan=False, tls=self._tls))
        try:
            await server.serve(sockets=[listener])
        finally:
            if server.started:
                await server.shutdown([listener])
            listener.close()
            self._server = None


def _port_of(listener: socket.socket) -> int:
    return int(listener.getsockname()[1])
