"""Interface of all LCM transports. ``network.open_transport`` returns an implementation for a URL."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

import msgspec


class LcmMessage(msgspec.Struct, frozen=True, gc=False):
    """A received message."""

    channel: str
    data: bytes | memoryview
    is_local: bool = False
    """True if a program on this machine sent it directly. A hub may have relayed it from anywhere, and UDP beyond this
    machine (``ttl`` above 0) hides no sender: then it is False."""
    arrival: int = msgspec.field(default_factory=time.time_ns)
    """Nanoseconds since the epoch."""


OnMessage = Callable[[LcmMessage], None]
"""Called with each received message."""


class LcmUnavailableError(ConnectionError):
    """A transport cannot be opened; the message has the reason and, if there is one, a remedy."""


class Transport(Protocol):
    """A connection to an LCM network, used in one event loop."""

    url: str

    @property
    def is_connected(self) -> bool:
        """True if messages can be published. Any thread may read it."""

    def start(self, on_message: OnMessage, on_connect: Callable[[], None]) -> None:
        """Connect, and receive messages in the running event loop.

        Args:
            on_message: called with each received message.
            on_connect: called whenever a connection is made. A transport without connections calls it at once.
        """

    def publish(self, channel: str, message: bytes | bytearray) -> None:
        """Send a message, or queue it. Must not block.

        Raises:
            OSError: not connected, or too many bytes are queued.
            ValueError: the channel name or the message is too long for the network.
        """

    async def drain(self, max_bytes: int) -> None:
        """Wait until at most ``max_bytes`` are queued for sending.

        Raises:
            OSError: the connection is lost.
        """

    async def finish(self) -> None:
        """Wait until all published messages are sent. Nothing can be published afterwards."""

    async def close(self) -> None:
        """Disconnect from the network."""

    def status(self) -> dict[str, object]:
        """Return the URL, counters and, if there is one, a ``warning``, as plain JSON values."""
