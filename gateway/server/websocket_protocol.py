"""One WebSocket connection: bounds on what its client can make us keep and do."""

from __future__ import annotations

from typing import Any, Final

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import CloseCode, Frame

from gateway.server.paced import Paced

MAX_FRAGMENTS: Final = 64
"""Of a message; empty ones would not count against its size, and are kept all the same."""
PIECE_BYTES: Final = 2 << 10
"""Read at a time: it can hold 300 frames, each of which takes some 5 us."""


class BoundedWebSocket(WebSocketsSansIOProtocol):
    """A message has so many fragments at most; who sends pings without reading gets the newest answer only."""

    _pong: bytes = b""
    """Held back until the client has read what was sent before."""

    def handle_cont(self, event: Frame) -> None:
        """A further fragment."""
        if len(self.frames) >= MAX_FRAGMENTS:
            self._fail(CloseCode.MESSAGE_TOO_BIG, f"a message of more than {MAX_FRAGMENTS} fragments")
            return
        super().handle_cont(event)

    def send_receive_event_to_app(self) -> None:
        """A message is complete. Text that is not UTF-8 ends the connection (RFC 6455, 8.1); the log has no line."""
        if self.curr_msg_data_type == "text" and not self.close_sent:
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError as error:
                self._fail(CloseCode.INVALID_DATA, f"a text message that is not UTF-8 at byte {error.start}")
                return
        super().send_receive_event_to_app()

    def _fail(self, code: CloseCode, reason: str) -> None:
        self.frames = []
        self.conn.fail(code, reason)
        if self.conn.close_sent is None:  # it did not wait for our answer to the handshake (RFC 6455, 4.1)
            self.close_sent = True
            self.transport.abort()
        else:
            self.handle_parser_exception()

    def handle_ping(self) -> None:
        """RFC 6455, 5.5.3: only the newest of several pings has to be answered."""
        output = b"".join(self.conn.data_to_send())
        if self.writable.is_set():
            self.transport.write(output)
        else:
            self._pong = output

    def resume_writing(self) -> None:
        """The client reads again."""
        super().resume_writing()
        if self._pong and not self.transport.is_closing():
            pong, self._pong = self._pong, b""
            self.transport.write(pong)


class PacedWebSocket(Paced[BoundedWebSocket]):
    """Read in small pieces: pages of the browser view have hardly anything to say."""

    def __init__(self, **given: Any) -> None:
        super().__init__(BoundedWebSocket(**given))

    def piece(self) -> int:
        """Always as small."""
        return PIECE_BYTES

    def may_read(self) -> bool:
        """Whether no message waits to be taken."""
        return not self.inner.read_paused
