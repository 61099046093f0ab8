"""Requests of one client that wait for an earlier one of the same client."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

Message = bytes | memoryview
Publish = Callable[[str, bytes], None]
"""Publishes a response: (channel, message)."""
OVERHEAD_BYTES: Final = 256
"""Memory of a waiting message besides its data."""


@dataclass(slots=True, eq=False)
class ClientQueue:
    """Waiting requests, oldest first; the first one is being handled."""

    channel: str
    publish: Publish
    on_drained: Callable[[], None] | None = None
    """Called when the queue gets short; None: the transport cannot pause the client."""
    size: int = 0
    """Bytes of all messages, with their overhead."""
    _messages: deque[Message] = field(default_factory=deque)

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, message: Message) -> int:
        """Add a message; return its bytes."""
        size = size_of(message)
        self._messages.append(message)
        self.size += size
        return size

    def first(self) -> Message:
        """Return the oldest message and keep it in the queue."""
        return self._messages[0]

    def pop(self) -> int:
        """Remove the oldest message; return its bytes."""
        size = size_of(self._messages.popleft())
        self.size -= size
        return size


def size_of(message: Message) -> int:
    """Return the bytes that a waiting message counts."""
    return len(message) + OVERHEAD_BYTES
