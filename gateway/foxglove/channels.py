"""The WebSocket server of foxglove-sdk with its channels, and who subscribes to them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Final

import foxglove
from foxglove.websocket import Capability, ChannelView, Client, Parameter, ServerListener, WebSocketServer

from scenegate.recording.mcap_file import EncodedMessage, Schema

BACKLOG_MESSAGES: Final = 32
"""Maximum number of messages that wait for a slow client: images have megabytes. The oldest one is dropped."""

Subscribed = Callable[[int | None, str], None]
"""Called in a thread of the server with a new subscriber of a topic; with None if a subscription has ended."""


class Channels(ServerListener):
    """A server with channels. Thread-safe."""

    def __init__(self, on_subscription: Subscribed, parameters: Callable[[], dict[str, Any]]) -> None:
        """
        Args:
            on_subscription: see ``Subscribed``.
            parameters: returns the values of all parameters by name; called in a thread of the server.
        """
        self._on_subscription = on_subscription
        self._parameters = parameters
        self._context = foxglove.Context()
        self._channels: dict[str, foxglove.Channel] = {}
        self._lock = threading.Lock()
        self._subscribers: dict[str, set[int]] = {}
        """Ids of clients by topic. ``_lock`` guards it."""
        self._server: WebSocketServer | None = None

    def start(self, host: str, port: int) -> int:
        """Listen, and return the port.

        Args:
            port: 0 for a free one.

        Raises:
            OSError: the port is taken.
        """
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
        for channel in self._channels.values():
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
            return len(set().union(*self._subscribers.values()))

    def declare(self, topic: str, schema: Schema) -> None:
        """Advertise a channel, if there is none of this topic."""
        if topic not in self._channels:
            described = foxglove.Schema(name=schema.name, encoding=schema.encoding, data=schema.data)
            self._channels[topic] = foxglove.Channel(
                topic, schema=described, message_encoding=schema.message_encoding, context=self._context
            )

    def send(self, message: EncodedMessage, time: int, client: int | None = None) -> None:
        """Queue a message for a client; None: for all subscribers of its topic.

        Args:
            time: nanoseconds since the epoch.
        """
        self._channels[message.topic].log(message.data, log_time=time, sink_id=client)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Called by the server."""
        with self._lock:
            self._subscribers.setdefault(channel.topic, set()).add(client.id)
        self._on_subscription(client.id, channel.topic)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        """Called by the server, also for each subscription of a client that disconnects."""
        with self._lock:
            self._subscribers.get(channel.topic, set()).discard(client.id)
        self._on_subscription(None, channel.topic)

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
