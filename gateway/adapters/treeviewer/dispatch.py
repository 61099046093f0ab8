"""Pass messages from the transports on: requests are refused, executed at once or queued; others have listeners.

Small requests are read and applied at once on the event loop, big ones and those with images in worker threads.
"""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Hashable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Final

import structlog

from gateway.adapters.treeviewer import responses
from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.context import ThreadRequired
from gateway.adapters.treeviewer.delivery import OVERHEAD_BYTES, Counters, Delivery, DurableStore, Publish, Recipient
from gateway.adapters.treeviewer.protocol import REQUEST, RequestRefused, TreeViewerProtocol
from gateway.adapters.treeviewer.responses import AnyResponse
from gateway.runtime.lcm.listener import ChannelListener
from gateway.runtime.lcm.tcpq_hub import HubConnection
from gateway.runtime.logs.tracing import lcm_message_span
from gateway.runtime.workers.pool_errors import UnavailableErrors
from gateway.runtime.workers.worker_pool import WorkerPool
from renderers.compiler.pending import any_pending
from scenegate.lcm.transport import LcmMessage
from scenegate.messages import wire

_log = structlog.get_logger("gateway.treeviewer")

_MESSAGEPACK_SLOWNESS: Final = 4
"""Ratio of the time to read a MessagePack request to that of a JSON request of the same size; see ``offload_bytes``."""
MAX_LOGGED: Final = 10
"""Number of undecodable messages that are all logged. Of later ones every thousandth is logged."""


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


class Dispatcher:
    """Receives messages of all transports. All methods run in the event loop's thread."""

    def __init__(
        self,
        protocol: TreeViewerProtocol,
        config: TreeViewerConfig,
        pool: WorkerPool,
        store: DurableStore | None = None,
        listeners: Sequence[ChannelListener] = (),
    ) -> None:
        """``pool`` reads what the event loop does not. ``store`` None: responses do not wait. ``listeners`` get other
        channels."""
        self._protocol, self._config, self._pool = protocol, config, pool
        self._store, self._listeners = store, tuple(listeners)
        self._apply_lock = asyncio.Lock()
        """Held while a big request is applied: merging two of them would block the event loop."""
        self._closing = False
        self.counters = Counters()
        self._delivery = Delivery(self.counters, store)
        self.queues = ClientQueues(self._handle, protocol.live.unapplied_arrivals, config.client_waiting_bytes)
        self._last_undecodable = ""
        """Channel and fault of the last undecodable message."""

    def receive(self, publish: Publish, message: LcmMessage, sender: HubConnection | None = None) -> None:
        """Handle a request at once, or put it into the client's queue. Pass another message to its listeners.

        ``publish`` sends the response. ``sender`` is a connection that is paused while many of its requests wait; None:
        the network cannot pause clients.
        """
        if not message.channel.startswith(REQUEST):
            for listener in self._listeners:
                if message.channel.startswith(listener.prefixes):
                    listener.on_message(message)
            return
        nbytes = len(message.data)
        self.counters.received += 1
        self.counters.received_bytes += nbytes
        try:
            comms = wire.decode(message.data)
        except wire.WireError as error:
            self._count_undecodable(message.channel, error)
            return
        client = (sender, message.channel, message.is_local)
        request = ReceivedRequest(message, comms, Recipient(publish, message.channel, comms.format), client, sender)
        storage_full = self._store is not None and self._store.full
        response: AnyResponse | None = None
        if self._closing:
            self._delivery.refuse(request.recipient, comms.utime, "the viewer is shutting down")
        elif client not in self.queues.clients and not storage_full and (response := self._respond_at_once(request)):
            self._delivery.send_when_stored(request.recipient, response)
        elif storage_full or self.queues.waiting_bytes + request.memory > self._config.waiting_bytes:
            self.counters.dropped += 1
            self.counters.dropped_bytes += nbytes
            self._delivery.refuse(request.recipient, comms.utime, "too many messages are waiting; send slower")
        else:
            self.queues.add(request)

    def status(self) -> dict[str, object]:
        """Return the counters as plain JSON values."""
        return {
            **asdict(self.counters),
            "waiting": len(self.queues),
            "waiting_bytes": self.queues.waiting_bytes,
            **({"last_undecodable": self._last_undecodable} if self._last_undecodable else {}),
        }

    async def close(self) -> None:
        """Refuse the requests in the queues and later ones, and send all responses. Transports close afterwards."""
        self._closing = True
        for request in await self.queues.close():
            self._delivery.refuse(request.recipient, request.comms.utime, "the viewer is shutting down")
        self._delivery.flush()

    async def _handle(self, request: ReceivedRequest) -> None:
        """Respond to the oldest request in a client's queue."""
        self._delivery.send_when_stored(request.recipient, await self._respond(request))

    def _respond_at_once(self, request: ReceivedRequest) -> AnyResponse | None:
        """Read and apply a small request on the event loop; return None if a thread must read it."""
        message, comms = request.message, request.comms
        slowness = _MESSAGEPACK_SLOWNESS if comms.format == wire.BINARY else 1
        if len(message.data) > self._config.offload_bytes // slowness or any_pending():
            return None
        try:
            applier = self._protocol.read(comms, at_once=True)
            with lcm_message_span(message.channel, len(message.data)):
                applier.apply(message.arrival)
                return self._protocol.respond(applier, self._delivery.page_client(request.recipient), comms.utime)
        except ThreadRequired:
            return None
        except Exception as error:  # one request must not end the transport  # noqa: BLE001
            return self._failure(request, error)

    async def _respond(self, request: ReceivedRequest) -> AnyResponse:
        """Read and apply a request: on the event loop if that is quick, else in a thread and in slices on the loop."""
        if response := self._respond_at_once(request):
            return response
        message, comms = request.message, request.comms
        try:
            with lcm_message_span(message.channel, len(message.data)):
                applier = await self._pool.run(self._protocol.read, comms, message.is_local)
                async with self._apply_lock:
                    for _ in applier.slices(self._config.slice_commands, message.arrival):
                        await asyncio.sleep(0)
                return self._protocol.respond(applier, self._delivery.page_client(request.recipient), comms.utime)
        except Exception as error:  # noqa: BLE001 - as in _respond_at_once
            return self._failure(request, error)

    def _failure(self, request: ReceivedRequest, error: Exception) -> AnyResponse:
        """Return the response to a request that could not be read or applied. Log an unexpected error."""
        if isinstance(error, RequestRefused):
            return error.response
        if isinstance(error, UnavailableErrors):
            return responses.failed(request.comms.utime, str(error))
        self.counters.internal_errors += 1
        _log.error("A request could not be handled", channel=request.message.channel, exc_info=error)
        return responses.failed(request.comms.utime, "internal error; the viewer's log says more")

    def _count_undecodable(self, channel: str, error: wire.WireError) -> None:
        """Count a message to which no response is possible, and log it unless there are many."""
        self.counters.undecodable += 1
        self._last_undecodable = f"{channel}: {error}"
        if self.counters.undecodable <= MAX_LOGGED or self.counters.undecodable % 1000 == 0:
            _log.warning("An undecodable message was ignored", channel=channel, reason=str(error))
