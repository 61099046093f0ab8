"""Head and body of a response in one system call."""

import asyncio
from typing import Final

_MAX_HEAD_BYTES: Final = 64 << 10
"""Bytes in which the length of a response is searched."""


class JoinedHead:
    """The transport of responses: the head of one with a length waits for its body, so that one system call sends both.

    The head of a stream does not wait.
    """

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        self._head = b""
        self.is_closing = transport.is_closing

    def write(self, data: bytes) -> None:
        """Send the head and ``data``, or keep ``data`` if it is a head."""
        head, self._head = self._head, b""
        if head:
            self._transport.writelines([head, data])
        elif data.startswith(b"HTTP/1.1 ") and b"\r\ncontent-length: " in data[:_MAX_HEAD_BYTES]:
            self._head = data
        else:
            self._transport.write(data)

    def close(self) -> None:
        """Close the connection after what was written."""
        self.flush()
        self._transport.close()

    def flush(self) -> None:
        """Send a head that has no body."""
        if self._head:
            self.write(b"")
