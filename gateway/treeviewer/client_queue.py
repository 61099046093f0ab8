"""Requests as transports receive them, and the queue of one client's requests while one of them is read in a thread."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from gateway.lcm.tcpq_hub import HubConnection
from scenegate.lcm.transport import LcmMessage
from scenegate.messages.wire import Comms

Publish = Callable[[str, bytes], None]
"""Function that publishes a message: (channel, message)."""
OVERHEAD_BYTES: Final = 256
"""Memory of a queued message besides its data."""


class Recipient(NamedTuple):
    """Receives the response to a request, and messages of the page."""

    publish: Publish
    """Publishes a message; raises OSError or ValueError if it cannot be sent."""
    channel: str
    """Channel of the request, which names the client."""
    format: str
    """Format of the request: ``wire.JSON``, ``wire.BINARY``, or an unknown one."""


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """A request, and where its response goes."""

    message: LcmMessage
    comms: Comms
    """The decoded message."""
    recipient: Recipient
    """Kept by what waits, without the data of the request."""

    @property
    def memory(self) -> int:
        """Memory that the request takes in a queue, in bytes."""
        return len(self.message.data) + OVERHEAD_BYTES


@dataclass(slots=True, eq=False)
class ClientQueue:
    """Requests of one client, oldest first. The oldest is being handled, the others wait."""

    sender: HubConnection | None = None
    """Connection that is paused while the queue is long; None: clients of the network cannot be paused."""
    size: int = 0
    """Memory of all requests in the queue, in bytes."""
    _requests: deque[Received] = field(default_factory=deque)

    def __len__(self) -> int:
        return len(self._requests)

    def put(self, request: Received) -> None:
        """Add a request."""
        self._requests.append(request)
        self.size += request.memory

    def first(self) -> Received:
        """Return the oldest request without removing it."""
        return self._requests[0]

    def pop(self) -> int:
        """Remove the oldest request; return its memory in bytes."""
        memory = self._requests.popleft().memory
        self.size -= memory
        return memory
