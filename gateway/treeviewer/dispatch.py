"""Handle requests from transports: small ones at once on the event loop, big ones in worker threads.

Requests of one client are handled in order: later requests wait for a big one. Other clients do not wait for it.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Final, Protocol, cast

import structlog

from gateway.runtime.pool_errors import UnavailableErrors
from gateway.runtime.tracing import lcm_message
from gateway.runtime.worker_pool import WorkerPool
from gateway.treeviewer import responses
from gateway.treeviewer.client_queue import OVERHEAD_BYTES, ClientQueue, Message, Publish, size_of
from gateway.treeviewer.config import TreeViewerConfig
from gateway.treeviewer.delayed_responses import DelayedResponses, PendingResponse
from gateway.treeviewer.page_commands import PageClient, update_page
from gateway.treeviewer.protocol import RequestRefused, TreeViewerProtocol, client_of, response_channel
from gateway.treeviewer.responses import AnyResponse, ClickMessage, PageMessage, Response
from renderers.compiler.pending import any_pending
from scenegate.lcm.arrival import set_arrival
from scenegate.messages import wire

_log = structlog.get_logger("gateway.treeviewer")

PATH_BYTES: Final = 100
"""Memory of one path in a response that waits for the store."""
OFFLOADED_WORDS: Final = (b"image", b"text", b"mesh_file", b"setcontrols")
"""Words in what takes long to read: geometries with images, text or mesh files, and controls, of which 1000 take 12 ms.
Other requests with these words only take the longer way."""
ESCAPED_LETTER: Final = re.compile(rb"\\u00[4-7]")
"""Escape in JSON that may stand for a letter of these words."""
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
    """Responses with status 1."""
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
            pool: its threads read big requests and requests that may open files.
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
        source: object,
        channel: str,
        message: Message,
        publish: Publish,
        on_drained: Callable[[], None] | None = None,
        *,
        is_local: bool = False,
    ) -> int:
        """Handle a request at once, or put it into the client's queue.

        Args:
            source: transport or connection; together with the channel it identifies the client.
            channel: channel of the request.
            message: the request, a viewer2_comms_t.
            publish: sends the response; raises OSError or ValueError if it cannot be sent.
            on_drained: called after a queued request if the client's queue is below half of ``client_waiting_bytes``.
            is_local: True for a program on this machine (``OnMessage``).
        Returns:
            bytes in the client's queue. A transport that can pause clients compares them with the limit.
        """
        self.counters.received += 1
        self.counters.received_bytes += len(message)
        if self._closing:
            self._refuse(channel, message, publish, SHUTTING_DOWN)
            return 0
        key = (source, channel, is_local)
        queue = self._queues.get(key)
        storage_full = self._durable is not None and self._durable.full
        if queue is None and not storage_full and not self._is_big(message):
            with lcm_message(channel, len(message)):
                self._handle(channel, message, publish, is_local)
            return 0
        if storage_full or self.waiting_bytes + size_of(message) > self._config.waiting_bytes:
            self.counters.dropped += 1
            self.counters.dropped_bytes += len(message)
            self._refuse(channel, message, publish, TOO_MANY)
            return queue.size if queue is not None else 0
        if queue is None:
            queue = self._queues[key] = ClientQueue(channel, publish, on_drained, is_local)
            task = asyncio.get_running_loop().create_task(self._handle_queue(key, queue))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        self.waiting_bytes += queue.put(message)
        return queue.size

    def oldest_arrival(self) -> int | None:
        """Return the arrival of the oldest request that is not applied yet, nanoseconds since the epoch."""
        return min((queue.first_arrival() for queue in self._queues.values() if len(queue)), default=None)

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
                self._refuse(queue.channel, queue.first(), queue.publish, SHUTTING_DOWN)
                self.waiting_bytes -= queue.pop()
        self._queues.clear()
        self._delayed.flush()

    def _is_big(self, message: Message) -> bool:
        """Return True if a request must be read in a worker thread, because reading it may take milliseconds or longer.

        These are requests of many bytes, requests that read mesh files, decode images or draw text, and all requests
        while kernels are compiled.
        """
        if any_pending():
            return True
        limit = self._config.offload_bytes
        if len(message) > limit or (len(message) > limit // 4 and wire.is_binary(message)):
            return True
        data = bytes(message)
        return any(word in data for word in OFFLOADED_WORDS) or ESCAPED_LETTER.search(data) is not None

    async def _handle_queue(self, key: object, queue: ClientQueue) -> None:
        """Handle the requests in a client's queue, in order, until it is empty."""
        try:
            while len(queue):
                message = queue.first()
                set_arrival(queue.first_arrival())
                with lcm_message(queue.channel, len(message)):
                    if self._is_big(message):
                        await self._handle_big(queue, message)
                    else:
                        self._handle(queue.channel, message, queue.publish, queue.is_local)
                self.waiting_bytes -= queue.pop()
                if queue.on_drained is not None and queue.size < self._config.client_waiting_bytes // 2:
                    queue.on_drained()
        finally:
            if not self._closing:  # otherwise ``close`` refuses the rest
                self.waiting_bytes -= queue.size
                del self._queues[key]

    def _handle(self, channel: str, message: Message, publish: Publish, is_local: bool) -> None:
        """Read and apply a request on the event loop, and respond."""
        try:
            response = self._protocol.handle(message, self._page_client(channel, message, publish), is_local)
        except wire.WireError as error:
            self._count_undecodable(channel, error)
            return
        except Exception:  # one request must not end the transport  # noqa: BLE001
            response = self._internal_error(channel, message)
        self._respond(PendingResponse(channel, response, publish, wire.is_binary(message)))

    async def _handle_big(self, queue: ClientQueue, message: Message) -> None:
        """Read a request in a worker thread, apply it in slices on the event loop, and respond."""
        response: AnyResponse
        try:
            comms = self._protocol.decode(message)
            applier = await self._pool.run(self._protocol.read, comms, queue.is_local)
            async with self._apply_lock:
                for _ in applier.slices(self._config.slice_commands):
                    await asyncio.sleep(0)
            client = self._page_client(queue.channel, message, queue.publish)
            update_page(self._protocol.page, applier.request, client, comms.utime)
            response = applier.response(comms.utime)
        except RequestRefused as refused:
            response = refused.response
        except wire.WireError as error:
            self._count_undecodable(queue.channel, error)
            return
        except UnavailableErrors as error:
            response = responses.failed(wire.decode(message).utime, str(error))
        except Exception:  # noqa: BLE001 - as in _handle
            response = self._internal_error(queue.channel, message)
        self._respond(PendingResponse(queue.channel, response, queue.publish, wire.is_binary(message)))

    def _respond(self, pending: PendingResponse) -> None:
        """Send a response as soon as the tree is stored."""
        if self._durable is None:
            self._delayed.add(pending)
            return
        response, path_count = pending.response, 0
        if isinstance(response, Response):
            path_count = len(response.deleted_paths) + len(response.added_geometries) + len(response.set_transforms)
        self._durable.call_when_stored(partial(self._on_stored, pending), OVERHEAD_BYTES + PATH_BYTES * path_count)

    def _on_stored(self, pending: PendingResponse, problem: str) -> None:
        """Send a response, with status -3 if the tree could not be stored because of ``problem``."""
        response = pending.response
        if problem and isinstance(response, Response):
            reason = f"the tree has been changed, but the change could not be stored: {problem}"
            response.error = f"{response.error}; {reason}" if response.error else reason
            response.status = responses.ERROR_HANDLING_REQUEST
        self._delayed.add(pending)

    def _publish(self, pending: PendingResponse) -> None:
        """Encode and publish a response, and count it."""
        response = pending.response
        message = responses.encode(response, binary=pending.binary)
        try:
            pending.publish(response_channel(pending.channel), message)
        except (OSError, ValueError) as error:
            self.counters.unanswerable += 1
            _log.warning("A response could not be sent", channel=pending.channel, reason=str(error))
            return
        self.counters.answered += 1
        self.counters.missing += response.status == responses.MISSING_PATHS
        self.counters.failed += response.status < 0

    def _page_client(self, channel: str, message: Message, publish: Publish) -> PageClient:
        """Return the client of a request, which receives messages of the page in the request's format."""
        send = partial(self._send_from_page, channel, publish, wire.is_binary(message))
        return PageClient((publish, channel) if client_of(channel) else None, send)

    def _send_from_page(self, channel: str, publish: Publish, binary: bool, message: PageMessage) -> None:
        """Publish a click or values of controls to the client of a channel of requests."""
        try:
            publish(response_channel(channel), responses.encode(message, binary=binary))
        except (OSError, ValueError) as error:
            _log.warning("A message of the page could not be sent", channel=channel, reason=str(error))
            return
        self.counters.clicks += isinstance(message, ClickMessage)
        self.counters.control_messages += not isinstance(message, ClickMessage)

    def _refuse(self, channel: str, message: Message, publish: Publish, reason: str) -> None:
        """Respond to a request that is not handled."""
        try:
            comms = wire.decode(message)
        except wire.WireError as error:
            self._count_undecodable(channel, error)
            return
        refusal = responses.failed(comms.utime, reason)
        self._publish(PendingResponse(channel, refusal, publish, wire.is_binary(message)))

    def _count_undecodable(self, channel: str, error: wire.WireError) -> None:
        """Count a message to which no response is possible, and log it unless there are many."""
        self.counters.undecodable += 1
        self._last_undecodable = f"{channel}: {error}"
        if self.counters.undecodable > MAX_LOGGED and self.counters.undecodable % 1000:
            return
        _log.warning("An undecodable message was ignored", channel=channel, reason=str(error))

    def _internal_error(self, channel: str, message: Message) -> Response:
        """Count and log an unexpected exception, and return the response."""
        self.counters.internal_errors += 1
        _log.exception("A request could not be handled", channel=channel)
        return responses.failed(wire.decode(message).utime, "internal error; the viewer's log says more")
