"""Writing an answer's head and body at once."""

from __future__ import annotations

import asyncio


class Joined:
    """What a request's answer is written to: the head, which comes first, waits for the body, until the event loop's
    next turn at most. Apart they would be two packets, and wake the client twice."""

    __slots__ = ("_head", "_loop", "_transport", "_written")

    def __init__(self, transport: asyncio.Transport, loop: asyncio.AbstractEventLoop) -> None:
        self._transport = transport
        self._loop = loop
        self._head = b""
        self._written = False

    def write(self, data: bytes) -> None:
        """As of transports."""
        if self._transport.is_closing():
            self._head = b""
        elif self._head:
            head, self._head = self._head, b""
            self._transport.writelines((head, data))
        elif self._written:
            self._transport.write(data)
        else:
            self._written = True
            self._head = data
            self._loop.call_soon(self.flush)

    def close(self) -> None:
        """As of transports."""
        self.flush()
        self._transport.close()

    def is_closing(self) -> bool:
        """As of transports."""
        return self._transport.is_closing()

    def flush(self) -> None:
        """Writes a head that waits: to be called before something else is written past this."""
        head, self._head = self._head, b""
        if head and not self._transport.is_closing():
            self._transport.write(head)
