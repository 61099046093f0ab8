"""HTTP servers: the gateway's own, ended by a signal, and further ports for parts of it."""

from __future__ import annotations

import asyncio
import signal
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from gateway.ops import process

MAX_HEAD_BYTES: Final = 64 << 10
"""Request line and headers; Drake's client sends 200 bytes, browsers a few thousand. The parser has no bound."""
HEAD_SECONDS: Final = 30.0
"""Time for them to arrive whole; a connection that sends nothing after connecting ends as well."""
BODY_SECONDS: Final = 90.0
"""Without a byte of a body that is not complete; what the gateway itself does not read for now does not count. The
render endpoint asks earlier, with a sentence."""
MAX_CONNECTIONS: Final = 8192
"""HTTP and WebSocket connections of one port; beyond it 503 at once. Each takes a descriptor and some 20 kB."""
MAX_WEBSOCKET_BYTES: Final = 64 << 10
"""Of a message from a client; the browser view has nothing longer than 16 characters to say."""
KEEP_ALIVE_SECONDS: Final = 60
"""For the next request on a connection."""
LINGER_SECONDS: Final = 5.0
"""For a client that was turned away in the middle of its body to read why: what it sends is thrown away."""
LINGER_PAUSE: Final = 0.1
"""Of them without reading: a client that looks for answers while it sends has left by then, and need not send more."""
LINGER_BYTES: Final = 64 << 20
"""Thrown away of one such body; then the connection ends."""


@dataclass(frozen=True, slots=True)
class TurnedAway:
    """The answer to a request that there is no place for: 503."""

    sentence: str
    retry_after: int
    """Seconds."""


Door = Callable[[bytes, bytes], TurnedAway | None]
"""Asked with method and target of every request that has a body, when its head has arrived; must return at once."""


class BoundedHttp(HttpToolsProtocol):
    """Bounds what comes before the application, and turns away by ``app.state.door`` without asking the application.

    Headers without end are refused (431), connections whose headers never come to an end are ended. Turning away where
    the head is read costs a tenth of an answer of the application, so that those who are let in do not notice it.
    """

    _turned_away = False
    _lingered = 0
    _linger_timer: asyncio.TimerHandle | None = None
    _head_bytes = 0
    _in_head = True
    _head_timer: asyncio.TimerHandle | None = None
    _body_timer: asyncio.TimerHandle | None = None
    _received = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # uvicorn names it narrower
        """Starts the clock of the first request."""
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS:
            self._refuse(503, "Service Unavailable", f"There are {MAX_CONNECTIONS} connections already.")
            return
        self._head_timer = self.loop.call_later(HEAD_SECONDS, self._too_late)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stops the clocks."""
        self._stop_timer()
        self._stop_body_timer()
        if self._linger_timer is not None:
            self._linger_timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Counts while the head is not complete; what a head shares a piece with is the body's business."""
        if self._turned_away:
            self._lingered += len(data)
            if self._lingered > LINGER_BYTES:
                self.transport.close()
            return
        self._received += 1
        if self._in_head and self._head_bytes > MAX_HEAD_BYTES:
            self._refuse(431, "Request Header Fields Too Large", f"The headers are longer than {MAX_HEAD_BYTES} bytes.")
            return
        if self._in_head:
            self._head_bytes += len(data)
        super().data_received(data)

    def on_message_begin(self) -> None:
        """A request starts; one on a kept connection gets a clock of its own."""
        super().on_message_begin()
        if self._head_timer is None:
            self._head_timer = self.loop.call_later(HEAD_SECONDS, self._too_late)

    def on_headers_complete(self) -> None:
        """The head has arrived whole."""
        self._in_head = False
        self._head_bytes = 0
        self._stop_timer()
        if self._turned_away or self._turn_away():
            return
        super().on_headers_complete()
        self._watch_body()

    def on_body(self, body: bytes) -> None:
        """What belongs to a request that was turned away is nobody's."""
        if not self._turned_away:
            super().on_body(body)

    def on_message_complete(self) -> None:
        """The next thing on this connection is a head again."""
        if self._turned_away:
            self.transport.close()  # nothing is unread, so the answer arrives
            return
        self._in_head = True
        self._stop_body_timer()
        super().on_message_complete()

    def _turn_away(self) -> bool:
        """Whether the door is shut for the request whose head has arrived; then it has been told so."""
        if self.cycle is not None and not self.cycle.response_complete:
            return False  # the answer to the one before comes first; the application refuses this one in its turn
        door: Door | None = getattr(self.config.app.state, "door", None)  # type: ignore[union-attr]  # a FastAPI
        if door is None or (turned_away := door(self.parser.get_method(), self.url)) is None:
            return False
        self._turned_away = True
        self._unset_keepalive_if_required()
        body = (turned_away.sentence + "\n").encode()
        head = (
            "HTTP/1.1 503 Service Unavailable\r\ncontent-type: text/plain; charset=utf-8\r\nconnection: close\r\n"
            f"retry-after: {turned_away.retry_after}\r\ncontent-length: {len(body)}\r\n\r\n"
        )
        self.transport.write(head.encode() + body)
        # Closing now would have the system answer what is still coming with a reset, which can overtake the sentence.
        self._linger_timer = self.loop.call_later(LINGER_PAUSE, self._linger)
        self.flow.pause_reading()
        return True

    def _linger(self) -> None:
        self._linger_timer = self.loop.call_later(LINGER_SECONDS, self.transport.close)
        self.flow.resume_reading()

    def _stop_timer(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None

    def _watch_body(self) -> None:
        self._stop_body_timer()
        self._body_timer = self.loop.call_later(BODY_SECONDS, self._look_at_body, self._received)

    def _look_at_body(self, received: int) -> None:
        self._body_timer = None
        if self._received == received and not self.flow.read_paused:
            self._too_late()
        else:
            self._watch_body()

    def _stop_body_timer(self) -> None:
        if self._body_timer is not None:
            self._body_timer.cancel()
            self._body_timer = None

    def _too_late(self) -> None:
        self._head_timer = None
        if not self.transport.is_closing():
            self.transport.close()

    def _refuse(self, status: int, phrase: str, sentence: str) -> None:
        if not self.transport.is_closing():
            head = f"HTTP/1.1 {status} {phrase}\r\ncontent-type: text/plain; charset=utf-8\r\nconnection: close\r\n"
            self.transport.write(f"{head}content-length: {len(sentence) + 1}\r\n\r\n{sentence}\n".encode())
            self.transport.close()


def config(app: Any, grace_seconds: float, *, lifespan: bool, tls: tuple[Path, Path] | None = None) -> uvicorn.Config:
    """How all our servers are run. ``tls``: certificate and key, PEM."""
    return uvicorn.Config(
        app,
        http=BoundedHttp,
        ws="websockets-sansio",
        ws_max_size=MAX_WEBSOCKET_BYTES,
        ssl_certfile=tls[0] if tls is not None else None,
        ssl_keyfile=tls[1] if tls is not None else None,
        ws_per_message_deflate=False,  # floats do not compress, the CPU time is gone all the same
        lifespan="on" if lifespan else "off",
        log_config=None,
        access_log=False,  # gateway.ops.requests writes one with the request's id
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
            listener = process.listen(self._host, self._port)
        except OSError as error:
            raise OSError(f"cannot listen: {process.why_not_listening(error, self._host, self._port)}") from None
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
