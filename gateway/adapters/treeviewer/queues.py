"""Queues of requests that wait for an earlier request of their client. Other clients do not wait for it."""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Hashable
from dataclasses import dataclass, field

from gateway.adapters.treeviewer.delivery import OVERHEAD_BYTES, Recipient
from gateway.runtime.lcm.tcpq_hub import HubConnection
from scenegate.lcm.transport import LcmMessage
from scenegate.messages import wire


@dataclass(frozen=True, slots=True, eq=False)
class ReceivedRequest:
    """A request, and where its response goes."""

    message: LcmMessage
    comms: wire.Comms
    """The decoded message."""
    recipient: Recipient
    """Kept by what waits, without the data of the request."""
    client: Hashable
    """Identifies the client, whose requests are handled in order."""
    sender: HubConnection | None
    """Connection that is paused while many of its requests wait; None: clients of the network cannot be paused."""

    @property
    def memory(self) -> int:
        """Memory that the request takes in a queue, in bytes."""
        return len(self.message.data) + OVERHEAD_BYTES


@dataclass(slots=True, eq=False)
class _ClientQueue:
    """Requests of one client, oldest first. The oldest is being handled, the others wait."""

    requests: deque[ReceivedRequest] = field(default_factory=deque)
    size: int = 0
    """Memory of all requests in the queue, in bytes."""


class ClientQueues:
    """Handles the requests of each client in order, one after the other. Runs in the event loop's thread."""

    def __init__(
        self, handle: Callable[[ReceivedRequest], Awaitable[None]], arrivals: dict[Hashable, int], client_bytes: int
    ) -> None:
        """``handle`` handles a request, and never raises. ``arrivals`` gets the arrivals of waiting requests; see
        ``LiveTree.unapplied_arrivals``. A client whose requests take more than ``client_bytes`` is paused.
        """
        self._handle = handle
        self._arrivals = arrivals
        self._client_bytes = client_bytes
        self.clients: dict[Hashable, _ClientQueue] = {}
        """Queues that are not empty, by client."""
        self._tasks: set[asyncio.Task[None]] = set()
        self.waiting_bytes = 0
        """Bytes in all queues."""

    def __len__(self) -> int:
        """Return the number of requests in all queues."""
        return sum(len(queue.requests) for queue in self.clients.values())

    def add(self, request: ReceivedRequest) -> None:
        """Handle a request after the earlier ones of its client."""
        queue = self.clients.get(request.client)
        if queue is None:
            queue = self.clients[request.client] = _ClientQueue()
            task = asyncio.get_running_loop().create_task(self._handle_all(request.client, queue))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        queue.requests.append(request)
        queue.size += request.memory
        self.waiting_bytes += request.memory
        self._arrivals[request] = request.message.arrival
        if request.sender is not None and queue.size > self._client_bytes:
            request.sender.pause_reading()

    async def close(self) -> list[ReceivedRequest]:
        """Stop handling requests, and return those that were not handled."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        queues, self.clients = self.clients, {}
        remaining = [request for queue in queues.values() for request in queue.requests]
        for request in remaining:
            del self._arrivals[request]
        self.waiting_bytes = 0
        return remaining

    async def _handle_all(self, client: Hashable, queue: _ClientQueue) -> None:
        """Handle a client's requests until its queue is empty, or ``close`` cancels the task."""
        while queue.requests:
            request = queue.requests[0]
            await self._handle(request)
            queue.requests.popleft()
            queue.size -= request.memory
            self.waiting_bytes -= request.memory
            del self._arrivals[request]
            if request.sender is not None and queue.size < self._client_bytes // 2:
                request.sender.resume_reading()
        del self.clients[client]
