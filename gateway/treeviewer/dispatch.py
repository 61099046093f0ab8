"""Handle requests from transports: small ones at once on the event loop, big ones and images in worker threads.

Requests of one client are handled in order: later ones wait for one in a thread. Other clients do not wait for it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Final, NamedTuple, Protocol

import structlog

from gateway.lcm.listener import ChannelListener
from gateway.lcm.tcpq_hub import HubConnection, TcpqHub
from gateway.runtime.pool_errors import UnavailableErrors
from gateway.runtime.tracing import lcm_message_span
from gateway.runtime.worker_pool import WorkerPool
from gateway.treeviewer import responses
from gateway.treeviewer.apply import RequestApplier
from gateway.treeviewer.client_queue import OVERHEAD_BYTES, ClientQueue, Publish, Received, Recipient
from gateway.treeviewer.config import TreeViewerConfig
from gateway.treeviewer.delayed_responses import DelayedResponses
from gateway.treeviewer.page_commands import PageClient, update_page
from gateway.treeviewer.protocol import REQUEST, RequestRefused, TreeViewerProtocol, client_of, response_channel
from gateway.treeviewer.responses import AnyResponse, ClickMessage, ControlsMessage, PageMessage, Response
from scenegate.lcm.transport import LcmMessage
from scenegate.messages import wire

_log = structlog.get_logger("gateway.treeviewer")

_MESSAGEPACK_SLOWNESS: Final = 4
"""Ratio of the time to read a MessagePack request to that of a JSON request of the same size; see ``offload_bytes``."""
_PATH_BYTES: Final = 100
"""Memory of one path in a response that waits for the store."""
_TOO_MANY: Final = "too many messages are waiting; send slower"
_SHUTTING_DOWN: Final = "the viewer is shutting down"
MAX_LOGGED: Final = 10
"""Number of undecodable messages that are all logged. Of later ones every thousandth is logged."""


@dataclass(slots=True)
class Counters:
    """Numbers of messages since start."""

    received: int = 0
    received_bytes: int = 0
    answered: int = 0
    """Responses sent."""
    missing: int = 0
    """Responses with missing paths (status 1)."""
    failed: int = 0
    """Responses with a negative status."""
    undecodable: int = 0
    """Messages that are not a viewer2_comms_t, so no response is possible."""
    unanswerable: int = 0
    """Responses that could not be sent (client id too long for an LCM channel name, or client gone)."""
    dropped: int = 0
    """Requests refused because too many were waiting."""
    dropped_bytes: int = 0
    clicks: int = 0
    """Clicks sent to clients."""
    control_messages: int = 0
    """Messages with values of controls sent to clients."""
    internal_errors: int = 0
    """Requests and responses that raised an unexpected exception, which is in the log."""


class DurableStore(Protocol):
    """Storage of the tree. Responses wait until the edits that they confirm are stored."""

    @property
    def full(self) -> bool:
        """True if too many responses wait for the storage to apply further requests."""

    def call_when_stored(self, done: Callable[[str], None], size: int) -> None:
        """Call ``done`` on the event loop when all edits so far are stored, or storing them has failed.

        Args:
            done: called with the reason of a failure, or an empty string.
            size: bytes of memory that the waiting response takes.
        """


_QueueKey = tuple[HubConnection | None, str, bool]
"""Identifies a client's queue: its connection, the channel of its requests, ``LcmMessage.is_local``."""


class _ClientKey(NamedTuple):
    """Identifies a client that receives messages of the page."""

    publish: Publish
    channel: str
    """Channel of its requests."""


class Dispatcher:
    """Handles requests, publishes responses, and passes other messages to their listeners.

    All methods run in the event loop's thread.
    """

    def __init__(
        self,
        protocol: TreeViewerProtocol,
        config: TreeViewerConfig,
        pool: WorkerPool,
        store: DurableStore | None = None,
        listeners: Sequence[ChannelListener] = (),
    ) -> None:
        """Create a dispatcher without requests.

        Args:
            protocol: reads and applies requests.
            config: limits and sizes.
            pool: its threads read big requests and those that ``read_at_once`` leaves to them.
            store: storage of the tree; None: responses do not wait for storage.
            listeners: receive the messages of other channels.
        """
        self._protocol = protocol
        self._unapplied = protocol.live.unapplied_arrivals
        self._config = config
        self._pool = pool
        self._store = store
        self._listeners = tuple(listeners)
        self._queues: dict[_QueueKey, ClientQueue] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._apply_lock = asyncio.Lock()
        """Held while a big request is applied: merging two of them would block the event loop."""
        self._delayed = DelayedResponses()
        self._closing = False
        self.counters = Counters()
        self.waiting_bytes = 0
        """Bytes in all client queues."""
        self._last_undecodable = ""
        """Channel and fault of the last undecodable message."""

    def receive(self, publish: Publish, message: LcmMessage, sender: HubConnection | None = None) -> None:
        """Handle a request at once, or put it into the client's queue. Pass another message to its listeners.

        Args:
            publish: sends the response; raises OSError or ValueError if it cannot be sent.
            message: a viewer2_comms_t, or a message of a listener.
            sender: connection that is paused while many of its requests wait; None: the network cannot pause clients.
        """
        if not message.channel.startswith(REQUEST):
            self._pass_to_listeners(message)
            return
        nbytes = len(message.data)
        self.counters.received += 1
        self.counters.received_bytes += nbytes
        try:
            comms = wire.decode(message.data)
        except wire.WireError as error:
            self._count_undecodable(message.channel, error)
            return
        request = Received(message, comms, Recipient(publish, message.channel, comms.format))
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
            queue = self._queues[key] = ClientQueue(sender)
            task = asyncio.get_running_loop().create_task(self._handle_queue(key, queue))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        queue.put(request)
        self._unapplied[request] = message.arrival
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
            "waiting": sum(map(len, self._queues.values())),
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
            while len(queue):
                self._refuse(queue.first(), _SHUTTING_DOWN)
                self._remove_first(queue)
        self._queues.clear()
        self._delayed.flush()

    def _pass_to_listeners(self, message: LcmMessage) -> None:
        for listener in self._listeners:
            if message.channel.startswith(listener.prefixes):
                listener.on_message(message)

    async def _handle_queue(self, key: _QueueKey, queue: ClientQueue) -> None:
        """Handle the requests in a client's queue, in order, until it is empty, or ``close`` refuses the rest."""
        while len(queue):
            request = queue.first()
            if not self._handle_at_once(request):
                await self._handle_in_thread(request)
            self._remove_first(queue)
            if queue.sender is not None and queue.size < self._config.client_waiting_bytes // 2:
                queue.sender.resume_reading()
        del self._queues[key]

    def _remove_first(self, queue: ClientQueue) -> None:
        """Remove the oldest request of a queue, which was handled."""
        del self._unapplied[queue.first()]
        self.waiting_bytes -= queue.pop()

    def _handle_at_once(self, request: Received) -> bool:
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
        self._send_when_stored(request, response)
        return True

    async def _handle_in_thread(self, request: Received) -> None:
        """Read a request in a worker thread, apply it in slices on the event loop, and respond."""
        try:
            message = request.message
            with lcm_message_span(message.channel, len(message.data)):
                applier = await self._pool.run(self._protocol.read, request.comms, message.is_local)
                async with self._apply_lock:
                    for _ in applier.slices(self._config.slice_commands, message.arrival):
                        await asyncio.sleep(0)
                response = self._finish_applied(request, applier)
        except Exception as error:  # noqa: BLE001 - as in _handle_at_once
            response = self._failure(request, error)
        self._send_when_stored(request, response)

    def _finish_applied(self, request: Received, applier: RequestApplier) -> AnyResponse:
        """Execute the commands for the page, and return the response to a request that was applied."""
        utime = request.comms.utime
        if applier.request.newer_commands:
            publish, channel, _ = recipient = request.recipient
            key = _ClientKey(publish, channel) if client_of(channel) else None
            update_page(self._protocol.page, applier.request, PageClient(key, partial(self._send, recipient)), utime)
        return applier.response(utime)

    def _failure(self, request: Received, error: Exception) -> AnyResponse:
        """Return the response to a request that could not be read or applied. Log an unexpected error."""
        if isinstance(error, RequestRefused):
            return error.response
        if isinstance(error, UnavailableErrors):
            return responses.failed(request.comms.utime, str(error))
        self.counters.internal_errors += 1
        _log.error("A request could not be handled", channel=request.message.channel, exc_info=error)
        return responses.failed(request.comms.utime, "internal error; the viewer's log says more")

    def _refuse(self, request: Received, reason: str) -> None:
        """Respond to a request that is not handled."""
        self._send_in_order(request.recipient, responses.failed(request.comms.utime, reason))

    def _send_when_stored(self, request: Received, response: AnyResponse) -> None:
        """Send a response as soon as the tree is stored. Never raises."""
        if self._store is None:
            self._send_in_order(request.recipient, response)
            return
        path_count = 0
        if isinstance(response, Response):
            path_count = len(response.deleted_paths) + len(response.added_geometries) + len(response.set_transforms)
        on_stored = partial(self._on_stored, request.recipient, response)
        try:
            self._store.call_when_stored(on_stored, OVERHEAD_BYTES + _PATH_BYTES * path_count)
        except Exception:  # later requests must be answered  # noqa: BLE001
            self.counters.internal_errors += 1
            _log.exception("A response could not wait for the store", channel=request.message.channel)
            on_stored("internal error; the viewer's log says more")

    def _on_stored(self, recipient: Recipient, response: AnyResponse, failure: str) -> None:
        """Send a response, with status -3 if the tree could not be stored. ``failure`` is the reason, or empty."""
        if failure and isinstance(response, Response):
            reason = f"the tree has been changed, but the change could not be stored: {failure}"
            response.error = f"{response.error}; {reason}" if response.error else reason
            response.status = wire.ERROR_HANDLING_REQUEST
        self._send_in_order(recipient, response)

    def _send_in_order(self, recipient: Recipient, response: AnyResponse) -> None:
        """Send a response: now, or later if it, or one before it on its channel, is delayed."""
        channel = recipient.channel
        has_missing_paths = response.status == wire.MISSING_PATHS
        if has_missing_paths or channel in self._delayed.queues:
            self._delayed.add(channel, partial(self._send, recipient, response), has_missing_paths=has_missing_paths)
        else:
            self._send(recipient, response)

    def _send(self, recipient: Recipient, message: AnyResponse | PageMessage) -> None:
        """Encode and publish a message, and count it. Never raises."""
        counters, channel = self.counters, recipient.channel
        try:
            recipient.publish(response_channel(channel), responses.encode(message, recipient.format))
        except (OSError, ValueError) as error:
            counters.unanswerable += isinstance(message, AnyResponse)
            _log.warning("A message to a client could not be sent", channel=channel, reason=str(error))
            return
        except Exception:  # later requests must be answered  # noqa: BLE001
            counters.internal_errors += 1
            _log.exception("A message to a client could not be sent", channel=channel)
            return
        if isinstance(message, ClickMessage):
            counters.clicks += 1
        elif isinstance(message, ControlsMessage):
            counters.control_messages += 1
        else:
            counters.answered += 1
            counters.missing += message.status == wire.MISSING_PATHS
            counters.failed += message.status < 0

    def _count_undecodable(self, channel: str, error: wire.WireError) -> None:
        """Count a message to which no response is possible, and log it unless there are many."""
        self.counters.undecodable += 1
        self._last_undecodable = f"{channel}: {error}"
        if self.counters.undecodable > MAX_LOGGED and self.counters.undecodable % 1000:
            return
        _log.warning("An undecodable message was ignored", channel=channel, reason=str(error))
