"""Handle requests from transports: small ones at once on the event loop, big ones and images in worker threads.

Requests of one client are handled in order: later ones wait for one in a thread. Other clients do not wait for it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Final, Protocol, cast

import structlog

from gateway.runtime.pool_errors import UnavailableErrors
from gateway.runtime.tracing import lcm_message
from gateway.runtime.worker_pool import WorkerPool
from gateway.treeviewer import responses
from gateway.treeviewer.apply import RequestApplier
from gateway.treeviewer.client_queue import OVERHEAD_BYTES, ClientQueue, Publish, Received, size_of
from gateway.treeviewer.config import TreeViewerConfig
from gateway.treeviewer.delayed_responses import DelayedResponses, PendingResponse
from gateway.treeviewer.page_commands import PageClient, update_page
from gateway.treeviewer.protocol import RequestRefused, TreeViewerProtocol, client_of, response_channel
from gateway.treeviewer.responses import AnyMessage, AnyResponse, ClickMessage, PageMessage, Response
from scenegate.lcm.arrival import set_arrival
from scenegate.messages import wire

_log = structlog.get_logger("gateway.treeviewer")

MESSAGEPACK_COMPACTNESS: Final = 4
"""Ratio of the time to read a MessagePack request to that of a JSON request of the same size; see ``offload_bytes``."""
PATH_BYTES: Final = 100
"""Memory of one path in a response that waits for the store."""
TOO_MANY: Final = "too many messages are waiting; send slower"
SHUTTING_DOWN: Final = "the viewer is shutting down"
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
    """Requests that raised an unexpected exception, which is in the log."""


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


class Dispatcher:
    """Handles requests and publishes responses. All methods run in the event loop's thread."""

    def __init__(
        self,
        protocol: TreeViewerProtocol,
        config: TreeViewerConfig,
        pool: WorkerPool,
        durable: DurableStore | None = None,
    ) -> None:
        """Create a dispatcher without requests.

        Args:
            protocol: reads and applies requests.
            config: limits and sizes.
            pool: its threads read big requests and those that ``read_at_once`` leaves to them.
            durable: storage of the tree; None: responses do not wait for storage.
        """
        self._protocol = protocol
        self._config = config
        self._pool = pool
        self._durable = durable
        self._queues: dict[object, ClientQueue] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._apply_lock = asyncio.Lock()
        """Held while a big request is applied: merging two of them would block the event loop."""
        self._delayed = DelayedResponses(self._publish)
        self._closing = False
        self.counters = Counters()
        self.waiting_bytes = 0
        """Bytes in all client queues."""
        self._last_undecodable = ""
        """Channel and fault of the last undecodable message."""

    def receive(
        self,
        connection: object,
        channel: str,
        message: bytes | memoryview,
        publish: Publish,
        on_drained: Callable[[], None] | None = None,
        *,
        is_local: bool = False,
    ) -> int:
        """Handle a request at once, or put it into the client's queue.

        Args:
            connection: connection of a transport, or a transport; with the channel, it identifies the client.
            channel: channel of the request.
            message: the request, a viewer2_comms_t.
            publish: sends the response; raises OSError or ValueError if it cannot be sent.
            on_drained: called after a queued request if the client's queue is below half of ``client_waiting_bytes``.
            is_local: True for a program on this machine, whose ``mesh_file`` paths may be read.
        Returns:
            bytes in the client's queue. A transport that can pause clients compares them with the limit.
        """
        self.counters.received += 1
        self.counters.received_bytes += len(message)
        try:
            request = Received(channel, wire.decode(message), len(message), publish, is_local)
        except wire.WireError as error:
            self._count_undecodable(channel, error)
            return 0
        if self._closing:
            self._refuse(request, SHUTTING_DOWN)
            return 0
        key = (connection, channel, is_local)
        queue = self._queues.get(key)
        storage_full = self._durable is not None and self._durable.full
        if queue is None and not storage_full and self._handle_at_once(request):
            return 0
        if storage_full or self.waiting_bytes + size_of(len(message)) > self._config.waiting_bytes:
            self.counters.dropped += 1
            self.counters.dropped_bytes += len(message)
            self._refuse(request, TOO_MANY)
            return queue.size if queue is not None else 0
        if queue is None:
            queue = self._queues[key] = ClientQueue(on_drained)
            task = asyncio.get_running_loop().create_task(self._handle_queue(key, queue))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        self.waiting_bytes += queue.put(request)
        return queue.size

    def oldest_arrival(self) -> int | None:
        """Return the arrival of the oldest request that is not applied yet, nanoseconds since the epoch."""
        return min((queue.first()[1] for queue in self._queues.values() if len(queue)), default=None)

    def forget_clients(self, publish: Publish, is_gone: Callable[[str], bool]) -> None:
        """Remove clickable paths and controls of clients that have disconnected.

        Args:
            publish: function of the clients' requests; see ``receive``.
            is_gone: returns True if the client of a response channel has disconnected.
        """

        def is_client_gone(key: object) -> bool:
            client_publish, channel = cast("tuple[Publish, str]", key)
            return client_publish == publish and is_gone(response_channel(channel))

        self._protocol.page.forget(is_client_gone)

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
                self._refuse(queue.first()[0], SHUTTING_DOWN)
                self.waiting_bytes -= queue.pop()
        self._queues.clear()
        self._delayed.flush()

    async def _handle_queue(self, key: object, queue: ClientQueue) -> None:
        """Handle the requests in a client's queue, in order, until it is empty."""
        try:
            while len(queue):
                request, arrival = queue.first()
                set_arrival(arrival)
                if not self._handle_at_once(request):
                    await self._handle_in_thread(request)
                self.waiting_bytes -= queue.pop()
                if queue.on_drained is not None and queue.size < self._config.client_waiting_bytes // 2:
                    queue.on_drained()
        finally:
            if not self._closing:  # otherwise ``close`` refuses the rest
                self.waiting_bytes -= queue.size
                del self._queues[key]

    def _handle_at_once(self, request: Received) -> bool:
        """Read and apply a small request on the event loop, and respond; return False if a thread must read it."""
        compactness = MESSAGEPACK_COMPACTNESS if request.comms.format == wire.BINARY else 1
        if request.nbytes > self._config.offload_bytes // compactness:
            return False
        try:
            applier = self._protocol.read_at_once(request.comms)
            if applier is None:
                return False
            with lcm_message(request.channel, request.nbytes):
                applier.apply()
                response = self._response(request, applier)
        except Exception as error:  # one request must not end the transport  # noqa: BLE001
            response = self._failure(request, error)
        self._respond(PendingResponse(request, response))
        return True

    async def _handle_in_thread(self, request: Received) -> None:
        """Read a request in a worker thread, apply it in slices on the event loop, and respond."""
        try:
            with lcm_message(request.channel, request.nbytes):
                applier = await self._pool.run(self._protocol.read, request.comms, request.is_local)
                async with self._apply_lock:
                    for _ in applier.slices(self._config.slice_commands):
                        await asyncio.sleep(0)
                response = self._response(request, applier)
        except Exception as error:  # noqa: BLE001 - as in _handle_at_once
            response = self._failure(request, error)
        self._respond(PendingResponse(request, response))

    def _response(self, request: Received, applier: RequestApplier) -> AnyResponse:
        """Execute the commands for the page, and return the response to a request that was applied."""
        utime = request.comms.utime
        if applier.request.newer_commands:
            binary = request.comms.format == wire.BINARY
            send = partial(self._send_from_page, request.channel, request.publish, binary)
            key = (request.publish, request.channel) if client_of(request.channel) else None
            update_page(self._protocol.page, applier.request, PageClient(key, send), utime)
        return applier.response(utime)

    def _failure(self, request: Received, error: Exception) -> AnyResponse:
        """Return the response to a request that could not be read or applied. Log an unexpected error."""
        if isinstance(error, RequestRefused):
            return error.response
        if isinstance(error, UnavailableErrors):
            return responses.failed(request.comms.utime, str(error))
        self.counters.internal_errors += 1
        _log.error("A request could not be handled", channel=request.channel, exc_info=error)
        return responses.failed(request.comms.utime, "internal error; the viewer's log says more")

    def _refuse(self, request: Received, reason: str) -> None:
        """Respond to a request that is not handled."""
        self._publish(PendingResponse(request, responses.failed(request.comms.utime, reason)))

    def _respond(self, pending: PendingResponse) -> None:
        """Send a response as soon as the tree is stored."""
        if self._durable is None:
            self._delayed.add(pending)
            return
        response, path_count = pending.response, 0
        if isinstance(response, Response):
            path_count = len(response.deleted_paths) + len(response.added_geometries) + len(response.set_transforms)
        self._durable.call_when_stored(partial(self._on_stored, pending), OVERHEAD_BYTES + PATH_BYTES * path_count)

    def _on_stored(self, pending: PendingResponse, failure: str) -> None:
        """Send a response, with status -3 if the tree could not be stored. ``failure`` is the reason, or empty."""
        response = pending.response
        if failure and isinstance(response, Response):
            reason = f"the tree has been changed, but the change could not be stored: {failure}"
            response.error = f"{response.error}; {reason}" if response.error else reason
            response.status = responses.ERROR_HANDLING_REQUEST
        self._delayed.add(pending)

    def _publish(self, pending: PendingResponse) -> None:
        """Publish a response, and count it."""
        request, response = pending.request, pending.response
        if not self._send(request.channel, request.publish, request.comms.format == wire.BINARY, response):
            self.counters.unanswerable += 1
            return
        self.counters.answered += 1
        self.counters.missing += response.status == responses.MISSING_PATHS
        self.counters.failed += response.status < 0

    def _send_from_page(self, channel: str, publish: Publish, binary: bool, message: PageMessage) -> None:
        """Publish a click or values of controls to the client of a channel of requests."""
        if self._send(channel, publish, binary, message):
            self.counters.clicks += isinstance(message, ClickMessage)
            self.counters.control_messages += not isinstance(message, ClickMessage)

    def _send(self, channel: str, publish: Publish, binary: bool, message: AnyMessage) -> bool:
        """Encode and publish a message to the client of a channel of requests; return False if it cannot be sent."""
        try:
            publish(response_channel(channel), responses.encode(message, binary=binary))
        except (OSError, ValueError) as error:
            _log.warning("A message to a client could not be sent", channel=channel, reason=str(error))
            return False
        return True

    def _count_undecodable(self, channel: str, error: wire.WireError) -> None:
        """Count a message to which no response is possible, and log it unless there are many."""
        self.counters.undecodable += 1
        self._last_undecodable = f"{channel}: {error}"
        if self.counters.undecodable > MAX_LOGGED and self.counters.undecodable % 1000:
            return
        _log.warning("An undecodable message was ignored", channel=channel, reason=str(error))
