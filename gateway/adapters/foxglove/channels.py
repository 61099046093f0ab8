"""The WebSocket server of foxglove-sdk with its channels and their subscribers."""

import logging
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import foxglove
import structlog
from foxglove.websocket import Capability, ChannelView, Client, Parameter, ServerListener, WebSocketServer

from scenegate.recording.mcap_file import EncodedMessage, Schema

BACKLOG_MESSAGES: Final = 32
"""Maximum number of messages that wait for a slow client: images have megabytes. The oldest one is dropped."""

MAX_CLIENTS: Final = 8
"""Maximum number of clients that get messages: each can have a backlog, and pages of any site can connect."""

_log = structlog.get_logger("foxglove")


class _SdkLog(logging.Handler):
    """Logs what the SDK reports of clients: its own lines are errors without a context."""

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.WARNING:
            _log.info("A client of Foxglove's WebSocket was disconnected or ignored", reason=record.getMessage())


_sdk_log: Final = _SdkLog()


class Channels(ServerListener):
    """A server with channels. Thread-safe."""

    def __init__(self, on_subscription: Callable[[str], None], parameters: Callable[[], Mapping[str, Any]]) -> None:
        """Both functions are called in threads of the server: ``on_subscription`` with a topic when a subscription
        begins or ends, ``parameters`` to get the values of all parameters by name.
        """
        self._on_subscription = on_subscription
        self._parameters = parameters
        self._context = foxglove.Context()
        self._lock = threading.Lock()
        """Guards the next three."""
        self._channels: dict[str, foxglove.Channel] = {}
        self._subscribers: dict[str, set[int]] = {}
        """Ids of clients by topic."""
        self._new_subscribers: dict[str, set[int]] = {}
        """Ids of new clients by topic, until ``take_new_subscribers`` returns them."""
        self._server: WebSocketServer | None = None

    def start(self, host: str, port: int) -> int:
        """Listen, and return the port; 0: a free one. Raises OSError if it is taken."""
        for name in ("foxglove.websocket", "foxglove.runtime", "tungstenite"):
            logger = logging.getLogger(name)
            logger.handlers[:], logger.propagate = [_sdk_log], False
        try:
            self._server = foxglove.start_server(
                name="Scenegate",
                host=host,
                port=port,
                capabilities=[Capability.Parameters],
                server_listener=self,
                context=self._context,
                message_backlog_size=BACKLOG_MESSAGES,
            )
        except RuntimeError as error:
            raise OSError(f"Foxglove's server cannot listen on {host} port {port}: {error}") from None
        return self._server.port

    def stop(self) -> None:
        """Disconnect all clients. It waits for threads of the server."""
        if self._server is not None:
            self._server.stop()
        with self._lock:
            channels = list(self._channels.values())
        for channel in channels:
            channel.close()

    @property
    def topics(self) -> frozenset[str]:
        """Topics with subscribers."""
        with self._lock:
            return frozenset(topic for topic, clients in self._subscribers.items() if clients)

    @property
    def clients(self) -> int:
        """Number of clients that subscribe to something."""
        with self._lock:
            return len(self._clients())

    def take_new_subscribers(self) -> dict[str, set[int]]:
        """Return the ids of the clients, by topic, that have subscribed since the last call and still do."""
        with self._lock:
            new, self._new_subscribers = self._new_subscribers, {}
        return {topic: clients for topic, clients in new.items() if clients}

    def advertise(self, topic: str, schema: Schema) -> None:
        """Advertise a channel, if there is none of this topic."""
        with self._lock:
            if topic in self._channels:
                return
        described = foxglove.Schema(name=schema.name, encoding=schema.encoding, data=schema.data)
        channel = foxglove.Channel(
            topic, schema=described, message_encoding=schema.message_encoding, context=self._context
        )
        with self._lock:
            self._channels[topic] = channel

    def withdraw(self, topic: str) -> None:
        """Close the channel of a topic, if there is one. Its subscriptions end."""
        with self._lock:
            channel = self._channels.pop(topic, None)
            for subscribers in (self._subscribers, self._new_subscribers):
                subscribers.pop(topic, None)
        if channel is not None:
            channel.close()

    def send(self, message: EncodedMessage, time_ns: int, clients: Iterable[int] | None = None) -> None:
        """Queue a message, ``time_ns`` since the epoch, for clients; None: for all subscribers of its topic."""
        with self._lock:
            channel = self._channels[message.topic]
            ids = list(self._subscribers.get(message.topic, ()) if clients is None else clients)
        for client in ids:
            channel.log(message.data, log_time=time_ns, sink_id=client)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Called by the server."""
        with self._lock:
            clients = self._clients()
            is_refused = client.id not in clients and len(clients) >= MAX_CLIENTS
            if not is_refused:
                self._subscribers.setdefault(channel.topic, set()).add(client.id)
                self._new_subscribers.setdefault(channel.topic, set()).add(client.id)
        if is_refused:
            _log.warning(
                f"A client of Foxglove's WebSocket gets no {channel.topic}: the limit is {MAX_CLIENTS} clients"
            )
        else:
            self._on_subscription(channel.topic)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        """Called by the server, also for each subscription of a client that disconnects."""
        with self._lock:
            for subscribers in (self._subscribers, self._new_subscribers):
                subscribers.get(channel.topic, set()).discard(client.id)
        self._on_subscription(channel.topic)

    def on_get_parameters(
        self, client: Client, param_names: list[str], request_id: str | None = None
    ) -> list[Parameter]:
        """Called by the server. No names: all parameters."""
        values = self._parameters()
        return [
            Parameter(name, value=value) for name, value in values.items() if not param_names or name in param_names
        ]

    def on_set_parameters(
        self, client: Client, parameters: list[Parameter], request_id: str | None = None
    ) -> list[Parameter]:
        """Called by the server. Nothing is set: pages of any site could do it."""
        return self.on_get_parameters(client, [parameter.name for parameter in parameters], request_id)

    def _clients(self) -> set[int]:
        """Return the ids of the clients that subscribe to something. The caller has the lock."""
        return set().union(*self._subscribers.values())
