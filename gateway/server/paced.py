"""Reading a connection a piece at a time, so that nobody's bytes hold the event loop."""

from __future__ import annotations

import asyncio
from typing import Final, Generic, Protocol, TypeVar

LARGEST_PIECE: Final = 1 << 20
"""Bytes. Each piece takes the interpreter twice more; to compare or to hash so much takes less than a millisecond."""


class Inner(Protocol):
    """What is read for: a protocol as uvicorn's."""

    loop: asyncio.AbstractEventLoop

    def connection_made(self, transport: asyncio.Transport, /) -> None: ...
    def connection_lost(self, exc: Exception | None, /) -> None: ...
    def data_received(self, data: bytes, /) -> None: ...
    def pause_writing(self) -> None: ...
    def resume_writing(self) -> None: ...


T = TypeVar("T", bound=Inner)


class Paced(asyncio.BufferedProtocol, Generic[T]):
    """Hands what comes to ``inner``. After a full piece others have their turn: libuv would read on 32 times."""

    _buffer: Final = bytearray(LARGEST_PIECE)
    _scratch: Final = memoryview(_buffer)
    """What was just received, of any connection: it is dealt with or copied before anything else can happen."""

    def __init__(self, inner: T) -> None:
        self.inner = inner
        self._transport: asyncio.Transport | None = None

    def piece(self) -> int:
        """The most bytes to read now."""
        raise NotImplementedError

    def may_read(self) -> bool:
        """Whether ``inner`` has not stopped reading by itself."""
        raise NotImplementedError

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # it is one
        """A client has come."""
        self._transport = transport
        self.inner.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """It has gone."""
        self._transport = None
        self.inner.connection_lost(exc)

    def pause_writing(self) -> None:
        """It does not read."""
        self.inner.pause_writing()

    def resume_writing(self) -> None:
        """It reads again."""
        self.inner.resume_writing()

    def get_buffer(self, sizehint: int) -> memoryview:
        """Where the next piece goes."""
        return self._scratch[: self.piece()]

    def buffer_updated(self, nbytes: int) -> None:
        """A piece has come."""
        whole = nbytes == self.piece()
        self.take(self._buffer, nbytes)
        if whole and self._transport is not None and not self._transport.is_closing() and self.may_read():
            self._transport.pause_reading()
            self.inner.loop.call_soon(self._read_on)

    def take(self, buffer: bytearray, count: int) -> None:
        """The first ``count`` bytes of ``buffer`` have come."""
        self.data_received(bytes(self._scratch[:count]))

    def data_received(self, data: bytes) -> None:
        """As of protocols that are handed bytes."""
        self.inner.data_received(data)

    def _read_on(self) -> None:
        if self._transport is not None and not self._transport.is_closing() and self.may_read():
            self._transport.resume_reading()
