"""Interface and limits of all LCM transports. ``network.open_transport`` returns an implementation for a URL."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

import msgspec

MIB: Final = 1 << 20
MAX_HEADER_BYTES: Final = 1024
"""Bytes of a message that do not count towards ``TransportLimits.message_bytes``: the fields around its payload."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TransportLimits:
    """Limits of a transport."""

    message_bytes: int = 256 * MIB
    """Maximum size of one LCM message; liblcm itself refuses more than 2^28 bytes."""
    receive_buffer_bytes: int = 64 * MIB
    """Receive buffer requested for the UDP socket. Datagrams that do not fit are lost: a 16 MB message needs 64 MB."""
    queued_bytes: int = 1024 * MIB
    """Maximum bytes of received messages that are incomplete or not handled yet. Further messages are dropped."""
    unsent_bytes: int = 64 * MIB
    """Maximum bytes of messages that the UDP socket does not accept yet. Further messages fail."""


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

        ``on_connect`` is called whenever a connection is made; a transport without connections calls it at once.
        """

    def publish(self, channel: str, message: bytes | bytearray) -> None:
        """Send a message, or queue it. Must not block.

        Raises OSError if not connected, or too many bytes are queued; ValueError if the channel name or the message is
        too long for the network.
        """

    async def drain(self, max_bytes: int) -> None:
        """Wait until at most ``max_bytes`` are queued for sending. Raises OSError if the connection is lost."""

    async def finish(self) -> None:
        """Wait until all published messages are sent. Nothing can be published afterwards."""

    async def close(self) -> None:
        """Disconnect from the network."""

    def status(self) -> dict[str, object]:
        """Return the URL, counters and, if there is one, a ``warning``, as plain JSON values."""
