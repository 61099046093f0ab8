"""Image events: who listens is told when the images for a depth image are taken, before depth is computed from them."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager

from gateway.generated import image_interface_pb2 as pb
from gateway.stereo.hub import FullError
from gateway.stereo.messages import time_of


class EventHub:
    """All listeners, each with a short queue: who does not read misses the oldest events and costs nobody anything."""

    def __init__(self, max_clients: int, length: int) -> None:
        """
        Args:
            max_clients: listeners at a time.
            length: events that wait for one listener.
        """
        self._max_clients = max_clients
        self._length = length
        self._queues: set[asyncio.Queue[bytes]] = set()
        self._silent: set[asyncio.Queue[bytes]] = set()
        """Of those who asked for no event."""

    def __len__(self) -> int:
        return len(self._queues)

    @contextmanager
    def subscribe(self, *, depth_acquisition_done: bool) -> Iterator[asyncio.Queue[bytes]]:
        """Serialised ``ImageEvents`` for the time of the block.

        Raises:
            FullError: there are too many listeners.
        """
        if len(self._queues) >= self._max_clients:
            raise FullError(f"{self._max_clients} event streams are open already, the limit (max_clients)")
        queue: asyncio.Queue[bytes] = asyncio.Queue(self._length)
        self._queues.add(queue)
        self._silent |= {queue} if not depth_acquisition_done else set()
        try:
            yield queue
        finally:
            self._queues.discard(queue)
            self._silent.discard(queue)

    def depth_acquisition_done(self, imageset: int, now: int) -> None:
        """Tells everybody.

        Args:
            imageset: timestamp of the set that it belongs to, nanoseconds.
            now: timestamp of the event.
        """
        if not self._queues:
            return
        event = pb.ImageEvents(
            imageset_timestamp=time_of(imageset), depth_acquisition_done=pb.Event(timestamp=time_of(now))
        )
        data = event.SerializeToString()
        for queue in self._queues - self._silent:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(data)
