"""Writing an answer's head and body at once."""

from __future__ import annotations

import asyncio
import os

_DIRECT_FROM = 256 << 10
"""Bytes. Handing fewer to the system takes less time than another thread needs to take the interpreter and to give it
back."""


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
            if len(data) < _DIRECT_FROM or not self._hand_over(head, data):
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

    def _hand_over(self, head: bytes, data: bytes) -> bool:
        """Whether both were written: a large picture is given to the system without the interpreter, which uvloop would
        hold meanwhile, a quarter of a millisecond for each MB. What the system does not take waits as ever."""
        transport = self._transport
        if transport.get_write_buffer_size() or transport.get_extra_info("sslcontext") is not None:
            return False  # others come first; it is not what the connection is to carry
        connection = transport.get_extra_info("socket")
        try:
            written = os.writev(connection.fileno(), (head, data))
        except (AttributeError, OSError):  # it takes nothing for now, or the client has left: the transport sees to it
            return False
        if written < len(head):
            transport.write(head[written:])
            transport.write(data)
        elif written < len(head) + len(data):
            transport.write(memoryview(data)[written - len(head) :])
        return True
