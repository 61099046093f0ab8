"""HTTP/1.1 connections with limits on what a client may send, and how slowly, before the application sees a request.

uvicorn has no limits on the size and duration of heads, on stalled bodies and on connections. Its protocol class is
extended here; docs/decisions/0012-bounded-http-protocol.md says why, and which of its internals are used.
"""

import asyncio
import re
from collections.abc import Callable
from enum import Enum, auto
from http import HTTPStatus
from typing import Final

import httptools
from starlette.types import Scope
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from gateway.runtime.http.body_receiver import BodyConnection, BodyReceiver, OnBytes
from gateway.runtime.http.joined_head import JoinedHead
from gateway.runtime.http.sliced_reads import SlicedReads

MAX_HEAD_BYTES: Final = 64 << 10
"""Request line and headers together: Drake's client sends 200 bytes, browsers a few thousand. Also the limit for chunk
extensions, and for trailers."""
MAX_PIPELINED: Final = 64
"""Requests of a connection that wait for the response to an earlier one; more close the connection."""
SLICE_BYTES: Final = 16 << 10
"""Bytes of heads and chunked bodies, which the parser reads byte by byte, per iteration of the event loop: a chunk may
have 6 bytes and takes a microsecond."""
FIRST_REQUEST_SECONDS: Final = 0.5
"""Time at shutdown for the first request of a connection: its client may have sent it already."""
HEAD_SECONDS: Final = 30.0
"""Time for a head to arrive, from the connection or from its first byte."""
BODY_SECONDS: Final = 90.0
"""Time without a byte of an incomplete body, not counted while the gateway itself has paused reading."""
MAX_CONNECTIONS: Final = 8192
"""HTTP and WebSocket connections per port; each takes a file descriptor and about 20 kB. More get 503."""
DISCARD_SECONDS: Final = 30.0
"""Time to read an early response (503, 413) before the connection closes in the middle of the body."""
DISCARD_BYTES: Final = 512 << 20
"""Bytes of such a body that are discarded, so that clients that send everything first can read the response."""

_H2C: Final = re.compile(rb"(?i)\r\nupgrade(: ?h2c(?=\r\n|\Z))")
"""Header that offers HTTP/2 beside HTTP/1.1, as Java's HttpClient does in each request. The parser would take what
comes after the request for HTTP/2, so the header gets another name."""
CONNECTION: Final = "scenegate.connection"
"""Key of the protocol in the scope of its requests."""
_WHOLE_READ_BYTES: Final = 1 << 20
"""Bytes; more than a transport reads at once."""
MAX_BUFFER_BYTES: Final = 32 << 20
"""Maximum size of such a buffer: clearing 32 MB blocks the event loop for some milliseconds. Scenes of Drake's users
have 20 to 30 MB with textures."""


class State(Enum):
    """Next data that a connection expects to receive.

    Each request takes a connection from HEAD through BODY to IDLE. DISCARD and REFUSED are the last state of a
    connection, except that a body may still end in DISCARD. After ``connection_made``, ``_enter`` makes all changes.
    """

    IDLE = auto()
    """A new request; the previous one is complete."""
    HEAD = auto()
    """The request line or headers."""
    BODY = auto()
    """A body, or what frames its chunks."""
    DISCARD = auto()
    """The rest of a body whose response is complete."""
    REFUSED = auto()
    """Data that is not parsed any more; the connection closes when the client does, or at a limit."""


class BoundedHttpProtocol(BodyConnection, SlicedReads, HttpToolsProtocol):
    """uvicorn's HTTP protocol with a state, one timer for it, and limits."""

    state = State.HEAD
    _timer: asyncio.TimerHandle | None = None
    _chunked = False
    """True if the current body has a Transfer-Encoding."""
    _skipping = False
    """True while the parser gets bytes that ``receive_body`` has received already."""
    _content_length = 0
    """Size of the current body in bytes, if it is not chunked."""
    on_disconnect: Callable[[], object] | None = None
    """Called when a response cannot be sent any more."""
    _disconnected = False
    _bytes_without_progress = 0
    """Bytes received since the last complete head or piece of a body."""
    _discarded_bytes = 0
    body_progressed = False
    _unanswered = 0
    """Requests without a complete response."""
    _refusal = b""
    """Response to send after those to earlier requests."""
    _cut_line = b""
    """Last line of a head that is not complete: what the parser gets has whole headers, for ``_H2C``."""
    _stop_reason = ""
    """Reason why the parser was stopped."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # uvicorn's is narrower
        """Refuse the connection if there are too many; else start the timer for the first head."""
        super().connection_made(transport)
        self._responses = JoinedHead(transport)
        self._enter(State.HEAD)
        if len(self.connections) > MAX_CONNECTIONS:
            self._refuse(503, f"There are {MAX_CONNECTIONS} connections already.")
            self.transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timer."""
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(exc)
        self._disconnect()

    def shutdown(self) -> None:
        """Finish the request, or close the connection. The head of a first request may be on its way."""
        if self.state is State.HEAD:
            self.loop.call_later(FIRST_REQUEST_SECONDS, super().shutdown)
        else:
            super().shutdown()

    def reading_paused(self) -> bool:
        """Return whether a request waits for its predecessor, or the application is slower than the client."""
        return self.flow.read_paused

    def slice_received(self, data: bytes) -> None:
        """Feed the parser, unless the connection is refused, and check the limits on sizes."""
        state_before = self.state
        if state_before in (State.DISCARD, State.REFUSED):
            self._discarded_bytes += len(data)
            if self._discarded_bytes > DISCARD_BYTES:
                self.transport.close()
                return
        if state_before is State.REFUSED:
            return
        self.body_progressed = True
        self._bytes_without_progress += len(data)
        if state_before in (State.IDLE, State.HEAD):
            data, self._cut_line = self._cut_line + data, b""
            if b"\r\n\r\n" not in data and (end := data.rfind(b"\r\n")) >= 0:
                data, self._cut_line = data[:end], data[end:]
            if b"h2c" in data[:SLICE_BYTES]:
                head, blank_line, rest = data.partition(b"\r\n\r\n")
                data = _H2C.sub(rb"\r\nignored\1", head) + blank_line + rest
        HttpToolsProtocol.data_received(self, data)  # not super(): the method of SlicedReads calls this one
        if self._bytes_without_progress > MAX_HEAD_BYTES and self.state is not State.REFUSED:
            in_body = self.state in (State.BODY, State.DISCARD)
            subject = "chunk extensions or trailers" if in_body else "headers"
            self._refuse(431, f"The {subject} are longer than {MAX_HEAD_BYTES} bytes.")

    def on_message_begin(self) -> None:
        """Start the timer of a head on a connection that is kept alive."""
        super().on_message_begin()
        if self.state is State.IDLE:
            self._enter(State.HEAD)

    def on_headers_complete(self) -> None:
        """Start the application, or queue the request behind an earlier one."""
        self._bytes_without_progress = 0
        headers = dict(self.headers)
        self._chunked = b"transfer-encoding" in headers
        self._content_length = int(headers.get(b"content-length", b"0"))  # the parser accepts digits only
        # uvicorn ignores the body of a WebSocket handshake.
        if self.parser.should_upgrade() and (self._chunked or headers.get(b"content-length", b"0") != b"0"):
            self._stop_parser("A request with a body cannot ask for another protocol (Upgrade) here.")
        if len(self.pipeline) >= MAX_PIPELINED:  # no response: those to the earlier requests are due before
            self.transport.abort()
            self._stop_parser("Too many pipelined requests.")
        self.scope["headers"] = [*self.headers]  # without trailers, since a proxy may not have checked them
        self.scope[CONNECTION] = self  # type: ignore[typeddict-unknown-key]  # a key of our own
        super().on_headers_complete()
        if self.cycle is not None:  # not a WebSocket handshake
            self.cycle.transport = self._responses  # type: ignore[assignment]  # the part of it that a cycle uses
        self._unanswered += 1
        self._enter(State.BODY)

    def on_body(self, body: bytes) -> None:
        """Hand a piece of the body to the application."""
        self._bytes_without_progress = 0
        if not self._skipping:
            super().on_body(body)

    async def receive_body(self, scope: Scope, on_bytes: OnBytes) -> bytearray | None:
        """Return the whole body of a request, read from the socket into one buffer without the parser.

        Returns:
            None for a body that is chunked or larger than ``MAX_BUFFER_BYTES``, and for a request that is not the
            newest one of its connection.

        Raises:
            ClientDisconnect: the client disconnected.
            Exception: raised by ``on_bytes``.
        """
        cycle = self.cycle
        if self._chunked or self._content_length > MAX_BUFFER_BYTES:
            return None
        # Middleware may have replaced the scope, but not its headers.
        if cycle.scope["headers"] is not scope["headers"] or cycle.disconnected:
            return None
        parsed, cycle.body = cycle.body, bytearray()
        if not cycle.more_body:
            on_bytes(parsed, len(parsed))
            return parsed
        length = self._content_length
        missing = length - len(parsed)
        receiver = BodyReceiver(self, parsed, self._backlog[:missing], length, on_bytes)
        self._backlog = self._backlog[missing:]
        self.flow.resume_reading()
        if cycle.waiting_for_100_continue:
            self.transport.write(b"HTTP/1.1 100 Continue\r\n\r\n")
            cycle.waiting_for_100_continue = False
        receiver.start()
        try:
            return await receiver.body
        finally:
            receiver.stop()
            del receiver.body  # the traceback of its exception refers to the receiver

    def skip_to_end(self) -> None:
        """Go on behind the end of a body that the parser has not seen."""
        self.parser = httptools.HttpRequestParser(self)
        self.parser.set_dangerous_leniencies(lenient_data_after_close=True)  # as uvicorn does
        self.on_message_complete()

    def skip(self, piece: memoryview) -> None:
        """Go on behind a piece of a body that the parser has not seen; the application gets nothing of it."""
        self._skipping = True
        for start in range(0, len(piece), _WHOLE_READ_BYTES):
            self.parser.feed_data(piece[start : start + _WHOLE_READ_BYTES])
        self._skipping = False

    def on_message_complete(self) -> None:
        """Wait for the next request."""
        self._bytes_without_progress = self._discarded_bytes = 0
        super().on_message_complete()
        self._enter(State.IDLE)

    def on_response_complete(self) -> None:
        """Start the next request of the pipeline, or a refusal that waited for this response."""
        self._responses.flush()
        super().on_response_complete()
        self._unanswered -= 1
        if self.transport.is_closing():
            return
        if self._refusal and self._unanswered == 0:
            self._send_refusal()
        elif self.state is State.BODY and self.cycle.response_complete:  # the newest request's
            self._enter(State.DISCARD)
        elif self.state is State.IDLE:
            self._enter(State.IDLE)  # the time to keep the connection begins now

    def handle_websocket_upgrade(self) -> None:
        """Hand the connection over to the WebSocket protocol."""
        if self._timer is not None:
            self._timer.cancel()
        self._backlog = b""  # sent before the handshake, which RFC 6455 (4.1) forbids
        super().handle_websocket_upgrade()

    def send_400_response(self, msg: str) -> None:
        """Refuse what the parser does not accept."""
        self._refuse(400, self._stop_reason or msg)

    def _stop_parser(self, reason: str) -> None:
        """Stop the parser by an exception in its callback; uvicorn then calls ``send_400_response``."""
        self._stop_reason = reason
        raise ValueError(reason)

    def _refuse(self, status: int, sentence: str) -> None:
        """Respond, after the responses to earlier requests, and close; what is received until then is discarded."""
        if self.transport.is_closing():
            return
        if self.state is State.DISCARD or (self.state is State.BODY and self.cycle.response_started):
            self.transport.abort()  # the request has its response, or a part of it
            return
        if self.state is State.BODY:
            self._drop_newest_request()
        self._enter(State.REFUSED)
        body = f"{sentence}\n".encode()
        head = f"HTTP/1.1 {status} {HTTPStatus(status).phrase}\r\ncontent-type: text/plain; charset=utf-8\r\n"
        self._refusal = f"{head}content-length: {len(body)}\r\nconnection: close\r\n\r\n".encode() + body
        if self._unanswered == 0:
            self._send_refusal()

    def _drop_newest_request(self) -> None:
        """Take the request that is being received out of the queue, or send its application a disconnect."""
        self._unanswered -= 1
        if self.pipeline:
            self.pipeline.popleft()  # uvicorn appends left
        else:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
            self._disconnect()

    def is_disconnected(self) -> bool:
        """Return True if a response cannot be sent any more."""
        return self._disconnected

    def _disconnect(self) -> None:
        self._disconnected = True
        if self.on_disconnect is not None:
            self.on_disconnect()

    def _send_refusal(self) -> None:
        """Respond and close the sending side only: closing both could discard the response on its way to the client."""
        self.transport.write(self._refusal)
        self._refusal = b""
        if self.transport.can_write_eof():
            self.transport.write_eof()
        self.flow.resume_reading()  # what the client still sends is discarded
        self._enter(State.REFUSED)  # its time starts when the response is sent

    def _enter(self, state: State) -> None:
        """Set the state and start its timer."""
        self.state = state
        parsed_bytewise = state in (State.IDLE, State.HEAD) or (self._chunked and state is not State.REFUSED)
        self.slice_bytes = SLICE_BYTES if parsed_bytewise else _WHOLE_READ_BYTES
        if self._timer is not None:
            self._timer.cancel()
        self.body_progressed = False
        seconds = {State.IDLE: self.timeout_keep_alive, State.HEAD: HEAD_SECONDS, State.BODY: BODY_SECONDS}.get(
            state, DISCARD_SECONDS
        )
        self._timer = self.loop.call_later(seconds, self._on_timeout)

    def _on_timeout(self) -> None:
        """Close the connection unless the gateway is what takes so long, or the body is still arriving."""
        if self.state is State.BODY:
            keep_waiting = self.body_progressed or self.flow.read_paused
        else:
            keep_waiting = self._unanswered > 0
        if keep_waiting:
            self._enter(self.state)
        else:
            self.transport.close()
