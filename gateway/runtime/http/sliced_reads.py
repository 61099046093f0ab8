"""Reads of a connection in slices, so that none blocks the event loop."""

import asyncio


class SlicedReads(asyncio.Protocol):
    """Mixin for protocols that handles each read in slices, one per iteration of the event loop.

    A read brings up to 256 kB, which can hold 40,000 HTTP chunks or WebSocket frames of a few microseconds each.
    """

    loop: asyncio.AbstractEventLoop
    transport: asyncio.Transport
    slice_bytes: int
    """Maximum size of the next slice."""
    _backlog = b""
    """Received and not yet handled. While there is some, a call of ``_resume`` is due."""

    def slice_received(self, data: bytes) -> None:
        """Handle one slice."""
        raise NotImplementedError

    def reading_paused(self) -> bool:
        """Return True if the protocol itself has paused reading."""
        raise NotImplementedError

    def data_received(self, data: bytes) -> None:
        """Handle the first slice now and the rest later, unless a slice is waiting already."""
        is_waiting = bool(self._backlog)
        self._backlog += data
        if not is_waiting:
            self._handle_slice()

    def _handle_slice(self) -> None:
        size = self.slice_bytes
        data, self._backlog = self._backlog[:size], self._backlog[size:]
        self.slice_received(data)
        if self.transport.is_closing():
            self._backlog = b""
        elif self._backlog:
            self.transport.pause_reading()
            self.loop.call_soon(self._resume)

    def _resume(self) -> None:
        if self.transport.is_closing():
            self._backlog = b""
            return
        if self._backlog:
            self._handle_slice()
        if not (self._backlog or self.reading_paused() or self.transport.is_closing()):
            self.transport.resume_reading()
