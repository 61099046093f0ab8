"""HTTP servers: the main one, which stops on a signal, and further ports as services."""

import signal
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import uvicorn
from fastapi import FastAPI

from gateway.runtime.http.http_protocol import BoundedHttpProtocol
from gateway.runtime.http.websocket_protocol import BoundedWebSocketProtocol
from gateway.runtime.workers import process_tuning

MAX_WEBSOCKET_BYTES: Final = 64 << 10
"""WebSocket message from a client; those of the browser view have at most 256 characters."""
KEEP_ALIVE_SECONDS: Final = 60
"""Time for the next request on a connection."""


def server_config(
    app: FastAPI, grace_seconds: float, *, lifespan: bool, tls: tuple[Path, Path] | None = None
) -> uvicorn.Config:
    """Return uvicorn's configuration for all servers of the gateway.

    Args:
        grace_seconds: time for requests to finish at shutdown.
        lifespan: False for an application whose lifespan is managed elsewhere.
        tls: certificate and key, PEM.
    """
    return uvicorn.Config(
        app,
        http=BoundedHttpProtocol,
        ws=BoundedWebSocketProtocol,
        ws_max_size=MAX_WEBSOCKET_BYTES,
        ssl_certfile=tls[0] if tls is not None else None,
        ssl_keyfile=tls[1] if tls is not None else None,
        ws_per_message_deflate=False,  # arrays of floats hardly compress
        lifespan="on" if lifespan else "off",
        log_config=None,
        access_log=False,  # gateway.runtime.http.edge logs requests
        server_header=False,
        timeout_keep_alive=KEEP_ALIVE_SECONDS,
        timeout_graceful_shutdown=grace_seconds,  # type: ignore[arg-type]  # a float works
        backlog=2048,
    )


class MainServer(uvicorn.Server):
    """Server that returns after SIGTERM or SIGINT; uvicorn's own raises the signal again."""

    def __init__(self, config: uvicorn.Config, on_shutdown: Callable[[], None] = lambda: None) -> None:
        """
        Args:
            on_shutdown: called in the event loop when the shutdown begins, before connections finish.
        """
        super().__init__(config)
        self._on_shutdown = on_shutdown

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Accept no more connections, finish requests, then end the application."""
        self._on_shutdown()
        await super().shutdown(sockets)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        previous_handlers = {
            number: signal.signal(number, self.handle_exit) for number in (signal.SIGINT, signal.SIGTERM)
        }
        try:
            yield
        finally:
            for number, handler in previous_handlers.items():
                signal.signal(number, handler if handler is not None else signal.SIG_DFL)  # None: set by C code


class _SecondaryServer(uvicorn.Server):
    """Server that does not handle signals."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class PortService:
    """Service that serves an application on a port of its own, in the same event loop."""

    def __init__(self, app: FastAPI, host: str, port: int, tls: tuple[Path, Path] | None = None) -> None:
        self._app = app
        self._host = host
        self._port = port
        self._tls = tls
        self._server: uvicorn.Server | None = None
        self._bound_port = 0

    @property
    def ready(self) -> bool:
        """True while the port is open."""
        return self._server is not None and self._server.started

    def status(self) -> Mapping[str, Any]:
        """Return the port; plain JSON values."""
        return {"port": self._bound_port}

    async def run(self) -> None:
        """Serve until cancelled.

        Raises:
            OSError: the port cannot be used; the message is one sentence.
        """
        try:
            listener = process_tuning.listen(self._host, self._port)
        except OSError as error:
            raise OSError(f"cannot listen: {process_tuning.listen_error(error, self._host, self._port)}") from None
        self._bound_port = int(listener.getsockname()[1])
        self._server = server = _SecondaryServer(
            server_config(self._app, grace_seconds=1.0, lifespan=False, tls=self._tls)
        )
        try:
            await server.serve(sockets=[listener])
        finally:
            if server.started:  # ``serve`` was cancelled before its own shutdown
                await server.shutdown([listener])
            listener.close()
            self._server = None
