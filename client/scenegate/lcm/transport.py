"""Interface and limits of all LCM transports, and the queue of received messages before their callback.

``network.open_transport`` returns an implementation for a URL.
"""

import asyncio
import time
from collections import deque
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


MAX_HANDLED: Final = 16
"""Maximum number of messages handled before the event loop continues: 16 small ones take about 0.5 ms."""
OVERHEAD_BYTES: Final = 256
"""Memory of a queued message besides its data."""


class ReceiveQueue:
    """Queue of messages that the event loop handles a few at a time. A full queue drops messages."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._messages: deque[LcmMessage] = deque()
        self._on_message: OnMessage | None = None
        self._resume_scheduled = False
        self.waiting_bytes = 0
        """Memory of the queued messages, in bytes."""
        self.dropped = 0
        """Number of dropped messages."""
        self.dropped_bytes = 0
        """Bytes of data in the dropped messages."""

    def start(self, on_message: OnMessage) -> None:
        """Set the callback that handles the messages."""
        self._on_message = on_message

    def put(self, message: LcmMessage) -> None:
        """Add a message, or drop it if the queue is full."""
        size = len(message.data) + OVERHEAD_BYTES
        if self.waiting_bytes + size > self._max_bytes:
            self.dropped += 1
            self.dropped_bytes += len(message.data)
            return
        self._messages.append(message)
        self.waiting_bytes += size

    def handle_some(self) -> None:
        """Handle up to ``MAX_HANDLED`` messages, and schedule the handling of the others."""
        for _ in range(MAX_HANDLED):
            if not self._messages:
                break
            message = self._messages.popleft()
            self.waiting_bytes -= len(message.data) + OVERHEAD_BYTES
            if self._on_message is not None:
                self._on_message(message)
        if self._messages and not self._resume_scheduled:
            self._resume_scheduled = True
            asyncio.get_running_loop().call_soon(self._resume)

    def close(self) -> None:
        """Discard all messages."""
        self._on_message = None
        self._messages.clear()
        self.waiting_bytes = 0

    def status(self) -> dict[str, object]:
        """Return the counters as plain JSON values."""
        return {"waiting_bytes": self.waiting_bytes, "dropped": self.dropped, "dropped_bytes": self.dropped_bytes}

    def _resume(self) -> None:
        self._resume_scheduled = False
        self.handle_some()
