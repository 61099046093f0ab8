"""Requests as transports receive them, and the queue of one client's requests while one of them is read in a thread."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from scenegate.lcm.arrival import arrival_time
from scenegate.messages.wire import Comms

Publish = Callable[[str, bytes], None]
"""Function that publishes a message: (channel, message)."""
OVERHEAD_BYTES: Final = 256
"""Memory of a queued message besides its data."""


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """A request, and where its response goes."""

    channel: str
    """Channel of the request."""
    comms: Comms
    nbytes: int
    """Bytes of the whole message."""
    publish: Publish
    """Publishes the response; raises OSError or ValueError if it cannot be sent."""
    is_local: bool = False
    """True for a program on this machine, which may name files in more folders."""


@dataclass(slots=True, eq=False)
class ClientQueue:
    """Requests of one client, oldest first. The oldest is being handled, the others wait."""

    on_drained: Callable[[], None] | None = None
    """Resumes a paused client when its queue is short; None: the transport cannot pause clients."""
    size: int = 0
    """``size_of`` all requests in the queue, in bytes."""
    _requests: deque[tuple[Received, int]] = field(default_factory=deque)

    def __len__(self) -> int:
        return len(self._requests)

    def put(self, request: Received) -> int:
        """Add a request; return its ``size_of``."""
        self._requests.append((request, arrival_time()))
        self.size += size_of(request.nbytes)
        return size_of(request.nbytes)

    def first(self) -> tuple[Received, int]:
        """Return the oldest request and its arrival, nanoseconds since the epoch, without removing it."""
        return self._requests[0]

    def pop(self) -> int:
        """Remove the oldest request; return its ``size_of``."""
        size = size_of(self._requests.popleft()[0].nbytes)
        self.size -= size
        return size


def size_of(nbytes: int) -> int:
    """Return the memory that a queued message of ``nbytes`` bytes takes, in bytes."""
    return nbytes + OVERHEAD_BYTES
