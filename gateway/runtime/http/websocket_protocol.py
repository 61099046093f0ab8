"""WebSocket connections with limits on what a client can make the gateway store and do.

uvicorn's protocol class is extended; docs/decisions/0012-bounded-http-protocol.md says why.
"""

from typing import Final

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import CloseCode, Frame

from gateway.runtime.http.sliced_reads import SlicedReads

MAX_FRAGMENTS: Final = 64
"""Fragments of a message: empty ones take memory too, and do not count against its size."""
SLICE_BYTES: Final = 2 << 10
"""Bytes parsed per iteration of the event loop: they can hold 300 frames of about 5 µs each."""


class BoundedWebSocketProtocol(SlicedReads, WebSocketsSansIOProtocol):
    """uvicorn's WebSocket protocol with limits on fragments and on pings."""

    slice_bytes = SLICE_BYTES
    _pong = b""
    """Response to the newest ping, held back while the client does not read."""

    def slice_received(self, data: bytes) -> None:
        """Feed the parser."""
        WebSocketsSansIOProtocol.data_received(self, data)

    def reading_paused(self) -> bool:
        """Return whether a message waits for the application."""
        return self.read_paused

    def handle_cont(self, event: Frame) -> None:
        """Add a fragment, or close the connection with 1009 (message too big)."""
        if len(self.frames) >= MAX_FRAGMENTS:
            self._fail(CloseCode.MESSAGE_TOO_BIG, f"a message of more than {MAX_FRAGMENTS} fragments")
            return
        super().handle_cont(event)

    def send_receive_event_to_app(self) -> None:
        """Deliver a message, or close with 1007 if it is text but not UTF-8 (RFC 6455, 8.1); uvicorn raises there."""
        if self.curr_msg_data_type == "text" and not self.close_sent:
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError as error:
                self._fail(CloseCode.INVALID_DATA, f"a text message that is not UTF-8 at byte {error.start}")
                return
        super().send_receive_event_to_app()

    def handle_ping(self) -> None:
        """Respond now, or to the newest ping once the client reads again (RFC 6455, 5.5.3)."""
        output = b"".join(self.conn.data_to_send())
        if self.writable.is_set():
            self.transport.write(output)
        else:
            self._pong = output

    def resume_writing(self) -> None:
        """Send the pong that was held back."""
        super().resume_writing()
        if self._pong and not self.transport.is_closing():
            pong, self._pong = self._pong, b""
            self.transport.write(pong)

    def handle_parser_exception(self) -> None:
        """Close the connection, at once if the client has not waited for the handshake (RFC 6455, 4.1)."""
        if self.conn.close_sent is None:
            self.close_sent = True
            self.transport.abort()
        else:
            super().handle_parser_exception()

    def _fail(self, code: CloseCode, reason: str) -> None:
        self.frames = []
        self.conn.fail(code, reason)
        self.handle_parser_exception()
