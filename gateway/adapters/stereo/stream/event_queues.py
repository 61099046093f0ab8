"""Queues of image events for streaming clients: slow clients lose the oldest ones and delay no others."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

from gateway.adapters.stereo.stream.subscriptions import LimitError, StreamError


class EventQueue:
    """Serialised events that wait for one client."""

    def __init__(self, max_events: int) -> None:
        """
        Args:
            max_events: maximum number of events; beyond it the oldest ones are dropped.
        """
        self._events: deque[bytes] = deque(maxlen=max_events)
        self._close_reason = ""
        """Reason for the end of the stream; empty while it is open."""
        self._changed = asyncio.Event()

    def put(self, event: bytes) -> None:
        """Add an event."""
        self._events.append(event)
        self._changed.set()

    def close(self, reason: str) -> None:
        """End the stream when the queue is empty."""
        self._close_reason = reason
        self._changed.set()

    async def get(self) -> list[bytes]:
        """Wait for events, and return all of them, oldest first.

        Raises:
            StreamError: the stream has ended, and the queue is empty.
        """
        while not self._events:
            if self._close_reason:
                raise StreamError(self._close_reason)
            self._changed.clear()
            await self._changed.wait()
        events = list(self._events)
        self._events.clear()
        return events


class EventHub:
    """Queues of all clients of the image events."""

    def __init__(self, max_clients: int, max_events: int) -> None:
        """
        Args:
            max_clients: maximum number of clients.
            max_events: maximum number of events in a client's queue.
        """
        self._max_clients = max_clients
        self._max_events = max_events
        self._queues: set[EventQueue] = set()
        self._close_reason = ""
        """Reason for refusing new clients; empty while streams are open."""

    def __len__(self) -> int:
        return len(self._queues)

    @contextmanager
    def subscribe(self) -> Iterator[EventQueue]:
        """Return a queue for the duration of the block.

        Raises:
            LimitError: too many clients.
            StreamError: the stream is closed.
        """
        if self._close_reason:
            raise StreamError(self._close_reason)
        if len(self._queues) >= self._max_clients:
            raise LimitError(f"{self._max_clients} event streams are open already, the limit (max_clients)")
        queue = EventQueue(self._max_events)
        self._queues.add(queue)
        try:
            yield queue
        finally:
            self._queues.discard(queue)

    def put(self, event: bytes) -> None:
        """Add an event to every client's queue."""
        for queue in self._queues:
            queue.put(event)

    def close(self, reason: str) -> None:
        """End all streams and refuse new ones."""
        self._close_reason = reason
        self.end_streams(reason)

    def end_streams(self, reason: str) -> None:
        """End all streams."""
        for queue in self._queues:
            queue.close(reason)
