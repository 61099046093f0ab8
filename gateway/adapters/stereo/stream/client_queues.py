"""Queues of messages for streaming clients: slow clients lose the oldest ones and delay no others."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

from gateway.adapters.stereo.stream.subscriptions import LimitError, StreamError


class ClientQueue:
    """Messages that wait for one client.

    Limits count items: a message with one image set is one item, a message with a batch of samples one item per sample.
    """

    def __init__(self, max_items: int) -> None:
        """
        Args:
            max_items: maximum number of items; beyond it the oldest messages are dropped.
        """
        self._max_items = max_items
        self._messages: deque[tuple[bytes, int]] = deque()
        """Messages, each with its number of items."""
        self._item_count = 0
        """Number of items in the queue."""
        self._lost = 0
        """Number of items dropped since the last ``get``."""
        self._close_reason = ""
        """Reason for the end of the stream; empty while it is open."""
        self._changed = asyncio.Event()

    def put(self, message: bytes, items: int) -> None:
        """Add a message with a number of items. Drop the oldest messages beyond the limit."""
        self._messages.append((message, items))
        self._item_count += items
        while self._item_count > self._max_items:
            _, dropped = self._messages.popleft()
            self._item_count -= dropped
            self._lost += dropped
        self._changed.set()

    def close(self, reason: str) -> None:
        """End the stream when the queue is empty."""
        self._close_reason = reason
        self._changed.set()

    async def get(self) -> tuple[int, list[bytes]]:
        """Wait for messages, and return the number of items lost before them, and all messages, oldest first.

        Raises:
            StreamError: the stream has ended, and the queue is empty.
        """
        while not self._messages and not self._lost:  # losses only: one message had more items than the limit
            if self._close_reason:
                raise StreamError(self._close_reason)
            self._changed.clear()
            await self._changed.wait()
        lost, messages = self._lost, [message for message, _ in self._messages]
        self._messages.clear()
        self._item_count = self._lost = 0
        return lost, messages


class MessageHub:
    """Queues of all clients of one stream."""

    def __init__(self, name: str, max_clients: int, max_items: int) -> None:
        """
        Args:
            name: name of the stream, for errors.
            max_clients: maximum number of clients.
            max_items: maximum number of items in a client's queue.
        """
        self.has_clients = asyncio.Event()
        """Set while there are clients."""
        self._name = name
        self._max_clients = max_clients
        self._max_items = max_items
        self._queues: set[ClientQueue] = set()
        self._close_reason = ""
        """Reason for refusing new clients; empty while streams are open."""

    def __len__(self) -> int:
        return len(self._queues)

    @contextmanager
    def subscribe(self) -> Iterator[ClientQueue]:
        """Return a queue for the duration of the block.

        Raises:
            LimitError: too many clients.
            StreamError: the stream is closed.
        """
        if self._close_reason:
            raise StreamError(self._close_reason)
        if len(self._queues) >= self._max_clients:
            raise LimitError(f"{self._max_clients} {self._name} streams are open already, the limit (max_clients)")
        queue = ClientQueue(self._max_items)
        self._queues.add(queue)
        self.has_clients.set()
        try:
            yield queue
        finally:
            self._queues.discard(queue)
            if not self._queues:
                self.has_clients.clear()

    def put(self, message: bytes, items: int = 1) -> None:
        """Add a message with a number of items to every client's queue."""
        for queue in self._queues:
            queue.put(message, items)

    def close(self, reason: str) -> None:
        """End all streams and refuse new ones."""
        self._close_reason = reason
        self.end_streams(reason)

    def end_streams(self, reason: str) -> None:
        """End all streams."""
        for queue in self._queues:
            queue.close(reason)
