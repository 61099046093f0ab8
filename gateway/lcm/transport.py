"""The interface that all LCM transports share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

OnMessage = Callable[[str, "bytes | memoryview"], None]
"""Called with channel and data of each received message."""


class LcmUnavailableError(RuntimeError):
    """A transport cannot be opened; the message is one sentence with the reason and a remedy."""


class Transport(Protocol):
    """A connection to an LCM network, used in one event loop."""

    url: str

    def start(self, on_message: OnMessage, on_connect: Callable[[], None]) -> None:
        """Receive messages from now on, in the running event loop.

        Args:
            on_connect: called after every connect; at once if the transport is connectionless.
        """

    def publish(self, channel: str, message: bytes) -> None:
        """Send a message, or queue it; never block.

        Raises:
            OSError: not connected, or too many bytes are queued.
            ValueError: the network cannot carry such a channel name or message.
        """

    async def drain(self, max_bytes: int) -> None:
        """Wait until at most ``max_bytes`` are queued for sending.

        Raises:
            OSError: the connection is lost.
        """

    async def finish(self) -> None:
        """Wait until the network has taken all published messages. Publish nothing afterwards."""

    async def close(self) -> None:
        """Disconnect from the network."""

    def status(self) -> dict[str, object]:
        """Return the URL, counters and, if there is one, a ``warning``, as plain JSON values."""
