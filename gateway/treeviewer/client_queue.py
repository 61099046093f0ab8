"""Requests as transports receive them, and the queue of one client's requests while one of them is read in a thread."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gateway.lcm.tcpq_hub import HubConnection
from scenegate.lcm.transport import LcmMessage
from scenegate.messages import wire
from scenegate.messages.wire import Comms

Publish = Callable[[str, bytes], None]
"""Function that publishes a message: (channel, message)."""
OVERHEAD_BYTES: Final = 256
"""Memory of a queued message besides its data."""


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """A request, and where its response goes."""

    message: LcmMessage
    comms: Comms
    """The decoded message."""
    publish: Publish
    """Publishes the response; raises OSError or ValueError if it cannot be sent."""

    @property
    def is_binary(self) -> bool:
        """True for MessagePack, False for JSON; the response has the same format."""
        return self.comms.format == wire.BINARY

    @property
    def memory(self) -> int:
        """Memory that the request takes in a queue, in bytes."""
        return size_of(len(self.message.data))


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


def size_of(nbytes: int) -> int:
    """Return the memory that a queued message of ``nbytes`` bytes takes, in bytes."""
    return nbytes + OVERHEAD_BYTES
