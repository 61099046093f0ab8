"""Queue of one client's requests, used by ``dispatch`` while a big request of the client is handled."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from scenegate.lcm.arrival import arrival_time

Message = bytes | memoryview
Publish = Callable[[str, bytes], None]
"""Function that publishes a message: (channel, message)."""
OVERHEAD_BYTES: Final = 256
"""Memory of a queued message besides its data."""


@dataclass(slots=True, eq=False)
class ClientQueue:
    """Requests of one client, oldest first. The oldest is being handled, the others wait."""

    channel: str
    """Channel of the requests."""
    publish: Publish
    """Publishes the responses."""
    on_drained: Callable[[], None] | None = None
    """Resumes a paused client when its queue is short; None: the transport cannot pause clients."""
    is_local: bool = False
    """True for a program on this machine, which may name files in more folders."""
    size: int = 0
    """``size_of`` all messages in the queue, in bytes."""
    _messages: deque[tuple[Message, int]] = field(default_factory=deque)

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, message: Message) -> int:
        """Add a message; return its ``size_of``."""
        size = size_of(message)
        self._messages.append((message, arrival_time()))
        self.size += size
        return size

    def first(self) -> Message:
        """Return the oldest message without removing it."""
        return self._messages[0][0]

    def first_arrival(self) -> int:
        """Return the arrival of the oldest message, nanoseconds since the epoch."""
        return self._messages[0][1]

    def pop(self) -> int:
        """Remove the oldest message; return its ``size_of``."""
        size = size_of(self._messages.popleft()[0])
        self.size -= size
        return size


def size_of(message: Message) -> int:
    """Return the bytes of memory that a queued message takes."""
    return len(message) + OVERHEAD_BYTES
