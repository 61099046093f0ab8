"""Handle requests from transports: small ones at once on the event loop, big ones and images in worker threads.

Requests of one client are handled in order: later ones wait for one in a thread. Other clients do not wait for it.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Final, NamedTuple

import structlog

from gateway.adapters.treeviewer import responses
from gateway.adapters.treeviewer.apply import PageClient, RequestApplier, update_page
from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.delivery import OVERHEAD_BYTES, Counters, Delivery, DurableStore, Publish, Recipient
from gateway.adapters.treeviewer.protocol import (
    REQUEST,
    RequestRefused,
    TreeViewerProtocol,
    client_of,
    response_channel,
)
from gateway.adapters.treeviewer.responses import AnyResponse
from gateway.runtime.lcm.listener import ChannelListener
from gateway.runtime.lcm.tcpq_hub import HubConnection, TcpqHub
from gateway.runtime.logs.tracing import lcm_message_span
from gateway.runtime.workers.pool_errors import UnavailableErrors
from gateway.runtime.workers.worker_pool import WorkerPool
from scenegate.lcm.transport import LcmMessage
from scenegate.messages import wire

_log = structlog.get_logger("gateway.treeviewer")

_MESSAGEPACK_SLOWNESS: Final = 4
"""Ratio of the time to read a MessagePack request to that of a JSON request of the same size; see ``offload_bytes``."""
_TOO_MANY: Final = "too many messages are waiting; send slower"
_SHUTTING_DOWN: Final = "the viewer is shutting down"
MAX_LOGGED: Final = 10
"""Number of undecodable messages that are all logged. Of later ones every thousandth is logged."""

_QueueKey = tuple[HubConnection | None, str, bool]
"""Identifies a client's queue: its connection, the channel of its requests, ``LcmMessage.is_local``."""


class _ClientKey(NamedTuple):
    """Identifies a client that receives messages of the page."""

    publish: Publish
    channel: str
    """Channel of its requests."""


@dataclass(frozen=True, slots=True, eq=False)
class _Received:
    """A request, and where its response goes."""

    message: LcmMessage
    comms: wire.Comms
    """The decoded message."""
    recipient: Recipient
    """Kept by what waits, without the data of the request."""

    @property
    def memory(self) -> int:
        """Memory that the request takes in a queue, in bytes."""
        return len(self.message.data) + OVERHEAD_BYTES


@dataclass(slots=True, eq=False)
class _ClientQueue:
    """Requests of one client, oldest first. The oldest is being handled, the others wait."""

    sender: HubConnection | None
    """Connection that is paused while the queue is long; None: clients of the network cannot be paused."""
    requests: deque[_Received] = field(default_factory=deque)
    size: int = 0
    """Memory of all requests in the queue, in bytes."""


class Dispatcher:
    """Handles requests, and passes other messages to their listeners. All methods run in the event loop's thread."""

    def __init__(
        self,
        protocol: TreeViewerProtocol,
        config: TreeViewerConfig,
        pool: WorkerPool,
        store: DurableStore | None = None,
        listeners: Sequence[ChannelListener] = (),
    ) -> None:
        """
        Args:
            pool: its threads read big requests and those that ``read_at_once`` leaves to them.
            store: storage of the tree; None: responses do not wait for storage.
            listeners: receive the messages of other channels.
        """
        self._protocol = protocol
        self._unapplied_arrivals = protocol.live.unapplied_arrivals
        self._config = config
        self._pool = pool
        self._store = store
        self._listeners = tuple(listeners)
        self._queues: dict[_QueueKey, _ClientQueue] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._apply_lock = asyncio.Lock()
        """Held while a big request is applied: merging two of them would block the event loop."""
        self._closing = False
        self.counters = Counters()
        self._delivery = Delivery(self.counters, store)
        self.waiting_bytes = 0
        """Bytes in all client queues."""
        self._last_undecodable = ""
        """Channel and fault of the last undecodable message."""

    def receive(self, publish: Publish, message: LcmMessage, sender: HubConnection | None = None) -> None:
        """Handle a request at once, or put it into the client's queue. Pass another message to its listeners.

        Args:
            publish: sends the response.
            message: a viewer2_comms_t, or a message of a listener.
            sender: connection that is paused while many of its requests wait; None: the network cannot pause clients.
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
        request = _Received(message, comms, Recipient(publish, message.channel, comms.format))
        if self._closing:
            self._refuse(request, _SHUTTING_DOWN)
            return
        key = (sender, message.channel, message.is_local)
        queue = self._queues.get(key)
        storage_full = self._store is not None and self._store.full
        if queue is None and not storage_full and self._handle_at_once(request):
            return
        if storage_full or self.waiting_bytes + request.memory > self._config.waiting_bytes:
            self.counters.dropped += 1
            self.counters.dropped_bytes += nbytes
            self._refuse(request, _TOO_MANY)
            return
        if queue is None:
            queue = self._queues[key] = _ClientQueue(sender)
            task = asyncio.get_running_loop().create_task(self._handle_queue(key, queue))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        queue.requests.append(request)
        queue.size += request.memory
        self._unapplied_arrivals[request] = message.arrival
        self.waiting_bytes += request.memory
        if sender is not None and queue.size > self._config.client_waiting_bytes:
            sender.pause_reading()

    def forget_clients(self, hub: TcpqHub, lost: HubConnection) -> None:
        """Remove clickable paths and controls of programs that received their responses by a lost connection."""

        def is_gone(key: object) -> bool:
            if not isinstance(key, _ClientKey):
                return False
            responses_to = response_channel(key.channel)
            return (
                key.publish == hub.publish
                and lost.subscriptions.match(responses_to)
                and not hub.has_subscriber(responses_to)
            )

        self._protocol.page.forget(is_gone)

    def status(self) -> dict[str, object]:
        """Return the counters as plain JSON values."""
        return {
            **asdict(self.counters),
            "waiting": sum(len(queue.requests) for queue in self._queues.values()),
            "waiting_bytes": self.waiting_bytes,
            **({"last_undecodable": self._last_undecodable} if self._last_undecodable else {}),
        }

    async def close(self) -> None:
        """Refuse the requests in the queues and later ones, and send all responses. Transports close afterwards."""
        self._closing = True
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for queue in self._queues.values():
            while queue.requests:
                self._refuse(queue.requests[0], _SHUTTING_DOWN)
                self._remove_first(queue)
        self._queues.clear()
        self._delivery.flush()

    async def _handle_queue(self, key: _QueueKey, queue: _ClientQueue) -> None:
        """Handle the requests in a client's queue, in order, until it is empty, or ``close`` refuses the rest."""
        while queue.requests:
            request = queue.requests[0]
            if not self._handle_at_once(request):
                await self._handle_in_thread(request)
            self._remove_first(queue)
            if queue.sender is not None and queue.size < self._config.client_waiting_bytes // 2:
                queue.sender.resume_reading()
        del self._queues[key]

    def _remove_first(self, queue: _ClientQueue) -> None:
        """Remove the oldest request of a queue, which was handled."""
        request = queue.requests.popleft()
        queue.size -= request.memory
        self.waiting_bytes -= request.memory
        del self._unapplied_arrivals[request]

    def _handle_at_once(self, request: _Received) -> bool:
        """Read and apply a small request on the event loop, and respond; return False if a thread must read it."""
        slowness = _MESSAGEPACK_SLOWNESS if request.comms.format == wire.BINARY else 1
        if len(request.message.data) > self._config.offload_bytes // slowness:
            return False
        try:
            applier = self._protocol.read_at_once(request.comms)
            if applier is None:
                return False
            with lcm_message_span(request.message.channel, len(request.message.data)):
                applier.apply(request.message.arrival)
                response = self._finish_applied(request, applier)
        except Exception as error:  # one request must not end the transport  # noqa: BLE001
            response = self._failure(request, error)
        self._delivery.send_when_stored(request.recipient, response)
        return True

    async def _handle_in_thread(self, request: _Received) -> None:
        """Read a request in a worker thread, apply it in slices on the event loop, and respond."""
        message = request.message
        try:
            with lcm_message_span(message.channel, len(message.data)):
                applier = await self._pool.run(self._protocol.read, request.comms, message.is_local)
                async with self._apply_lock:
                    for _ in applier.slices(self._config.slice_commands, message.arrival):
                        await asyncio.sleep(0)
                response = self._finish_applied(request, applier)
        except Exception as error:  # noqa: BLE001 - as in _handle_at_once
            response = self._failure(request, error)
        self._delivery.send_when_stored(request.recipient, response)

    def _finish_applied(self, request: _Received, applier: RequestApplier) -> AnyResponse:
        """Execute the commands for the page, and return the response to a request that was applied."""
        utime = request.comms.utime
        if applier.request.newer_commands:
            recipient = request.recipient
            key = _ClientKey(recipient.publish, recipient.channel) if client_of(recipient.channel) else None
            client = PageClient(key, partial(self._delivery.send, recipient))
            update_page(self._protocol.page, applier.request, client, utime)
        return applier.response(utime)

    def _failure(self, request: _Received, error: Exception) -> AnyResponse:
        """Return the response to a request that could not be read or applied. Log an unexpected error."""
        if isinstance(error, RequestRefused):
            return error.response
        if isinstance(error, UnavailableErrors):
            return responses.failed(request.comms.utime, str(error))
        self.counters.internal_errors += 1
        _log.error("A request could not be handled", channel=request.message.channel, exc_info=error)
        return responses.failed(request.comms.utime, "internal error; the viewer's log says more")

    def _refuse(self, request: _Received, reason: str) -> None:
        """Respond to a request that is not handled."""
        self._delivery.send_in_order(request.recipient, responses.failed(request.comms.utime, reason))

    def _count_undecodable(self, channel: str, error: wire.WireError) -> None:
        """Count a message to which no response is possible, and log it unless there are many."""
        self.counters.undecodable += 1
        self._last_undecodable = f"{channel}: {error}"
        if self.counters.undecodable <= MAX_LOGGED or self.counters.undecodable % 1000 == 0:
            _log.warning("An undecodable message was ignored", channel=channel, reason=str(error))
