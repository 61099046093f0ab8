"""Bounded queue of received messages between a transport and its callback ``on_message``."""

import asyncio
from collections import deque
from typing import Final

from scenegate.lcm.transport import LcmMessage, OnMessage

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
