"""Receives a body of known length into one buffer."""

import asyncio
from collections.abc import Callable
from typing import Final

from starlette.requests import ClientDisconnect

_BUFFER_GROWTH: Final = 16
"""Maximum size of a body's buffer per byte that has arrived: a client that only announces bytes gets no memory. The
first read of a large body brings 256 kB."""
_MIN_BUFFER_BYTES: Final = 64 << 10
"""Minimum size of such a buffer, unless the body is smaller."""

OnBytes = Callable[[bytearray, int], None]
"""Called with a body's buffer and the number of bytes in it whenever some have arrived. Raises to end the reception."""


class BodyConnection(asyncio.Protocol):
    """Base of an HTTP protocol whose place a ``BodyReceiver`` takes."""

    loop: asyncio.AbstractEventLoop
    transport: asyncio.Transport
    body_progressed: bool
    """True if bytes of the body have arrived since its timer started."""

    def skip(self, piece: memoryview) -> None:
        """Go on behind a piece of a body that the parser has not seen; the application gets nothing of it."""
        raise NotImplementedError

    def skip_to_end(self) -> None:
        """Go on behind the end of a body that the parser has not seen."""
        raise NotImplementedError


class BodyReceiver(asyncio.BufferedProtocol):
    """Receives a body of known length into one buffer, in place of the HTTP protocol of the connection.

    The parser does not see these bytes. It goes on behind the body, or behind what has arrived if the application needs
    no more.
    """

    def __init__(
        self, http: BodyConnection, parsed: bytearray, unparsed: bytes, length: int, on_bytes: OnBytes
    ) -> None:
        """
        Args:
            parsed: bytes of the body that the parser has seen.
            unparsed: further bytes that have arrived.
            length: size of the whole body.
        """
        self._http = http
        self._transport = http.transport
        self._on_bytes = on_bytes
        self._length = length
        self._parsed_count = len(parsed)
        self._count = len(parsed) + len(unparsed)
        self._buffer = bytearray()
        self._grow()
        self._buffer[: len(parsed)] = parsed
        self._buffer[len(parsed) : self._count] = unparsed
        self._is_receiving = False
        self.body: asyncio.Future[bytearray] = http.loop.create_future()
        """The whole body, or the reason why it is not received."""

    def start(self) -> None:
        """Take the place of the HTTP protocol."""
        self._is_receiving = True
        self._replace_protocol(self)
        self.buffer_updated(0)

    def stop(self) -> None:
        """End the reception, if it has not ended."""
        if self._is_receiving:
            self._http.skip(memoryview(self._buffer)[self._parsed_count : self._count])
            self._end()

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return the free part of the buffer."""
        return memoryview(self._buffer)[self._count :]

    def buffer_updated(self, nbytes: int) -> None:
        """Count received bytes; end the reception after the last one."""
        self._http.body_progressed = True
        self._count += nbytes
        try:
            self._on_bytes(self._buffer, self._count)
        except Exception as error:  # noqa: BLE001 - for the application
            self.stop()
            if not self.body.done():  # the application is cancelled
                self.body.set_exception(error)
            return
        if self._count == self._length:
            if not self.body.done():
                self.body.set_result(self._buffer)
            self._end()
            self._http.skip_to_end()
        elif self._count == len(self._buffer):
            self._grow()

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass the end of the connection on."""
        self._is_receiving = False
        self._http.connection_lost(exc)
        if not self.body.done():
            self.body.set_exception(ClientDisconnect())

    def eof_received(self) -> None:
        """Close the connection, as the HTTP protocol does."""
        self._http.eof_received()

    def pause_writing(self) -> None:
        """Pass on; the response to an earlier request may still be on its way."""
        self._http.pause_writing()

    def resume_writing(self) -> None:
        """Pass on."""
        self._http.resume_writing()

    def _grow(self) -> None:
        """Replace the buffer by a larger one."""
        size = max(_BUFFER_GROWTH * self._count, _MIN_BUFFER_BYTES)
        larger = bytearray(min(self._length, size))
        larger[: len(self._buffer)] = self._buffer
        self._buffer = larger

    def _end(self) -> None:
        """Give the transport back to the HTTP protocol. Release the body: uvloop's transport keeps this object."""
        self._is_receiving = False
        self._replace_protocol(self._http)
        self._buffer, self._on_bytes = bytearray(), lambda buffer, count: None

    def _replace_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        """Change the protocol of the transport, which may not read meanwhile."""
        self._transport.pause_reading()
        self._transport.set_protocol(protocol)
        self._transport.resume_reading()
