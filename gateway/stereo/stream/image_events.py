"""Image events: messages that the images of a depth frame are captured, sent before depth is computed."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager

from gateway.stereo.stream.image_messages import time_message
from gateway.stereo.stream.subscriptions import LimitError
from scenegate.camera import image_interface_pb2 as pb


class EventHub:
    """Event queues of all clients. If a client does not read, the oldest events in its queue are dropped."""

    def __init__(self, max_clients: int, max_events: int) -> None:
        """
        Args:
            max_clients: maximum number of clients.
            max_events: maximum number of events in a client's queue.
        """
        self._max_clients = max_clients
        self._max_events = max_events
        self._queues: dict[asyncio.Queue[bytes], bool] = {}
        """Queues of all clients; True if the client has requested the event ``depth_acquisition_done``."""

    def __len__(self) -> int:
        return len(self._queues)

    @contextmanager
    def subscribe(self, *, depth_acquisition_done: bool) -> Iterator[asyncio.Queue[bytes]]:
        """Return a queue of serialised ``ImageEvents`` for the duration of the block.

        Args:
            depth_acquisition_done: True if the client has requested this event.

        Raises:
            LimitError: too many clients.
        """
        if len(self._queues) >= self._max_clients:
            raise LimitError(f"{self._max_clients} event streams are open already, the limit (max_clients)")
        queue: asyncio.Queue[bytes] = asyncio.Queue(self._max_events)
        self._queues[queue] = depth_acquisition_done
        try:
            yield queue
        finally:
            del self._queues[queue]

    def depth_acquisition_done(self, imageset_timestamp: int, event_timestamp: int) -> None:
        """Send the event that all images for a depth image are captured to every client that has requested it.

        Args:
            imageset_timestamp: timestamp of the image set, nanoseconds.
            event_timestamp: end of the capture, nanoseconds.
        """
        if not self._queues:
            return
        event = pb.ImageEvents(
            imageset_timestamp=time_message(imageset_timestamp),
            depth_acquisition_done=pb.Event(timestamp=time_message(event_timestamp)),
        )
        data = event.SerializeToString()
        for queue, requested in self._queues.items():
            if requested:
                if queue.full():
                    queue.get_nowait()
                queue.put_nowait(data)
