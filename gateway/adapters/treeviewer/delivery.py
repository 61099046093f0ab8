"""Deliver responses to clients: when the tree is stored, in order, with the delay that Director's client needs.

Director's Python client publishes a request and then clears its queue of commands. On a response with missing paths
(status 1), another thread of the client puts the missing commands into this queue. If the response arrives before the
clearing, they are lost. Such responses are therefore delayed by a few milliseconds.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple, Protocol

import structlog

from gateway.adapters.treeviewer import responses
from gateway.adapters.treeviewer.apply import PageClient
from gateway.adapters.treeviewer.protocol import client_of, response_channel
from gateway.adapters.treeviewer.responses import AnyResponse, ClickMessage, ControlsMessage, PageMessage, Response
from gateway.runtime.lcm.tcpq_hub import HubConnection, TcpqHub
from gateway.scene.page.live_page import LivePage
from scenegate.messages import wire

_log = structlog.get_logger("gateway.treeviewer")

DELAY_SECONDS: Final = 0.01
"""Delay of a response with status 1. On a busy machine the client clears its queue within 8 ms, rarely later."""
OVERHEAD_BYTES: Final = 256
"""Memory of a waiting message besides its data."""
_PATH_BYTES: Final = 100
"""Memory of one path in a response that waits for the store."""

Publish = Callable[[str, bytes], None]
"""Publishes a message (channel, message); raises OSError or ValueError if it cannot be sent."""


class Recipient(NamedTuple):
    """Receives the response to a request, and messages of the page."""

    publish: Publish
    channel: str
    """Channel of the request, which names the client."""
    format: str
    """Format of the request: ``wire.JSON``, ``wire.BINARY``, or an unknown one."""


class _ClientKey(NamedTuple):
    """Identifies a client that receives messages of the page."""

    publish: Publish
    channel: str
    """Channel of its requests."""


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
        """Call ``done`` on the event loop when all edits so far are stored: with an empty string, or why not.

        ``size``: bytes of memory that the waiting response takes.
        """


class Delivery:
    """Sends responses and messages of the page. All methods run in the event loop's thread, and never raise."""

    def __init__(self, counters: Counters, store: DurableStore | None = None) -> None:
        self._counters = counters
        self._store = store
        self._delayed: dict[str, deque[tuple[Recipient, AnyResponse]]] = {}
        """Responses with missing paths, and those behind them, by channel. Other channels have no queue."""

    def send_when_stored(self, recipient: Recipient, response: AnyResponse) -> None:
        """Send a response as soon as the tree is stored."""
        if self._store is None:
            self.send_in_order(recipient, response)
            return
        path_count = 0
        if isinstance(response, Response):
            path_count = len(response.deleted_paths) + len(response.added_geometries) + len(response.set_transforms)
        on_stored = partial(self._on_stored, recipient, response)
        try:
            self._store.call_when_stored(on_stored, OVERHEAD_BYTES + _PATH_BYTES * path_count)
        except Exception:  # later requests must be answered  # noqa: BLE001
            self._counters.internal_errors += 1
            _log.exception("A response could not wait for the store", channel=recipient.channel)
            on_stored("internal error; the viewer's log says more")

    def _on_stored(self, recipient: Recipient, response: AnyResponse, failure: str) -> None:
        """Send a response, with status -3 if the tree could not be stored. ``failure`` is the reason, or empty."""
        if failure and isinstance(response, Response):
            reason = f"the tree has been changed, but the change could not be stored: {failure}"
            response.error = f"{response.error}; {reason}" if response.error else reason
            response.status = wire.ERROR_HANDLING_REQUEST
        self.send_in_order(recipient, response)

    def send_in_order(self, recipient: Recipient, response: AnyResponse) -> None:
        """Send a response: now, or later if it, or one before it on its channel, is delayed."""
        channel, has_missing_paths = recipient.channel, response.status == wire.MISSING_PATHS
        if not has_missing_paths and channel not in self._delayed:
            self.send(recipient, response)
            return
        self._delayed.setdefault(channel, deque()).append((recipient, response))
        if has_missing_paths:
            asyncio.get_running_loop().call_later(DELAY_SECONDS, self._delay_ended, channel)

    def _delay_ended(self, channel: str) -> None:
        """Send the oldest response, and the later ones up to the next that has a delay of its own."""
        queue = self._delayed.get(channel)
        if not queue:  # flush() has sent all
            return
        self.send(*queue.popleft())
        while queue and queue[0][1].status != wire.MISSING_PATHS:
            self.send(*queue.popleft())
        if not queue:
            del self._delayed[channel]

    def flush(self) -> None:
        """Send all delayed responses now."""
        queues, self._delayed = self._delayed, {}
        for queue in queues.values():
            for recipient, response in queue:
                self.send(recipient, response)

    def refuse(self, recipient: Recipient, utime: int, reason: str) -> None:
        """Respond to a request that is not handled."""
        self.send_in_order(recipient, responses.failed(utime, reason))

    def page_client(self, recipient: Recipient) -> PageClient:
        """Return the client behind a recipient, as a receiver of messages of the page."""
        key = _ClientKey(recipient.publish, recipient.channel) if client_of(recipient.channel) else None
        return PageClient(key, partial(self.send, recipient))

    def send(self, recipient: Recipient, message: AnyResponse | PageMessage) -> None:
        """Encode and publish a message, and count it."""
        counters, channel = self._counters, recipient.channel
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


def forget_clients(page: LivePage, hub: TcpqHub, lost: HubConnection) -> None:
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

    page.forget(is_gone)
