"""TCPQ hub for clients without multicast (containers, NAT). Messages of any size arrive without loss.

The hub relays messages between its clients, as LCM's own hub (in Java) does. It also passes messages to a callback in
this process. It has no connection to LCM's UDP networks.
"""

from __future__ import annotations

import asyncio
import ipaddress
import os
import socket
from collections.abc import Callable
from functools import partial
from typing import Any, Final, cast

import structlog

from gateway.runtime.lcm.config import LcmConfig
from gateway.runtime.lcm.subscriptions import PatternError, Subscriptions
from scenegate.lcm.tcpq import HUB_HELLO, MAGIC_CLIENT, MAX_CHANNEL_BYTES, FrameError, FrameParser, FrameType, publish
from scenegate.lcm.transport import MAX_HEADER_BYTES, LcmMessage, LcmUnavailableError

_log = structlog.get_logger("gateway.lcm")

MAX_CACHED_CHANNELS: Final = 1024
"""Maximum number of channels whose subscribers are cached."""

OnClientMessage = Callable[[LcmMessage, "HubConnection"], None]
"""Called with a message that a client published, and its connection."""


class TcpqHub:
    """Accepts clients, and relays each message to the clients that subscribed to its channel."""

    def __init__(self, config: LcmConfig, greeting: tuple[str, bytes]) -> None:
        """Create a hub, with a greeting (channel, message) for clients of that channel; ``start`` opens its port."""
        self.config = config
        self.greeting = greeting
        self._prefixes: tuple[str, ...] = ()
        self._on_message: OnClientMessage = lambda message, sender: None
        self.on_disconnect: Callable[[HubConnection], None] = lambda lost: None
        """Called with each connection that is lost."""
        self._server: asyncio.Server | None = None
        self.connections: set[HubConnection] = set()
        self.subscribers_by_channel: dict[str, list[HubConnection]] = {}
        """Cache of each channel's subscribers. Cleared when a subscription begins or ends."""
        self.is_local = False
        """True if the hub listens on loopback addresses only."""
        self._arriving_bytes = 0
        """Bytes of the big messages that are being read."""
        self.relayed = 0
        """Number of messages sent to clients."""
        self.refused = 0
        """Number of clients disconnected because there were too many, or they did not speak TCPQ or read too slowly."""
        self.dropped = 0
        """Number of messages not relayed because their channel name exceeds ``MAX_CHANNEL_BYTES``."""

    async def start(
        self,
        prefixes: tuple[str, ...],
        on_message: OnClientMessage,
        on_disconnect: Callable[[HubConnection], None] = lambda lost: None,
    ) -> None:
        """Open the port and accept clients. Raises LcmUnavailableError if it cannot be opened.

        ``on_message`` gets messages of channels with these prefixes, ``on_disconnect`` each connection that is lost.
        """
        self._prefixes, self._on_message, self.on_disconnect = prefixes, on_message, on_disconnect
        host, port = self.config.tcpq_host, self.config.tcpq_port
        try:
            loop = asyncio.get_running_loop()
            self._server = await loop.create_server(partial(HubConnection, self), host, port, backlog=256)
        except (OSError, OverflowError) as error:
            reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            raise LcmUnavailableError(
                f"the TCPQ hub cannot listen on {host}:{port}: {reason}; --tcpq-port chooses another"
            ) from None
        self.is_local = all(_is_loopback(sock.getsockname()[0]) for sock in self._server.sockets)

    @property
    def port(self) -> int:
        """Listening port; 0 before ``start`` and after ``close``."""
        sockets = self._server.sockets if self._server is not None else ()
        return int(sockets[0].getsockname()[1]) if sockets else 0

    async def close(self) -> None:
        """Close all connections and stop listening."""
        if self._server is not None:
            self._server.close()
            for connection in tuple(self.connections):
                connection.abort()
            await self._server.wait_closed()
            self._server = None

    def publish(self, channel: str, message: bytes) -> None:
        """Send a message to the subscribers of its channel. Raises ValueError if the channel's name is too long."""
        if len(channel.encode()) > MAX_CHANNEL_BYTES:
            raise ValueError(f"the hub relays channel names of at most {MAX_CHANNEL_BYTES} bytes")
        self._relay(channel, message)

    def status(self) -> dict[str, object]:
        """Return the URL and counters as plain JSON values."""
        return {
            "url": f"tcpq://{self.config.tcpq_host}:{self.port}",
            "clients": len(self.connections),
            "relayed": self.relayed,
            "refused": self.refused,
            "dropped": self.dropped,
            "arriving_bytes": self._arriving_bytes,
            "unsent_bytes": sum(connection.unsent_bytes for connection in self.connections),
        }

    def reserve(self, size: int) -> bool:
        """Add to the bytes of big messages that are being read; return False, adding nothing, beyond the limit."""
        if self._arriving_bytes + size > self.config.queued_bytes:
            return False
        self._arriving_bytes += size
        return True

    def release(self, size: int) -> None:
        """Subtract the size of a big message that was read, or whose client disconnected."""
        self._arriving_bytes -= size

    def has_subscriber(self, channel: str) -> bool:
        """Return True if a client subscribes to a channel."""
        return any(connection.subscriptions.match(channel) for connection in self.connections)

    def handle_message(self, sender: HubConnection, channel: str, data: bytes | memoryview) -> None:
        """Pass a message that a client published to the callback, and relay it to all subscribers."""
        if len(channel.encode()) > MAX_CHANNEL_BYTES:
            if not self.dropped:
                _log.warning(
                    "A channel name is too long; its messages are dropped", client=sender.name, channel=channel[:100]
                )
            self.dropped += 1
            return
        if channel.startswith(self._prefixes):
            self._on_message(LcmMessage(channel, data, sender.is_local), sender)
        self._relay(channel, data)

    def _relay(self, channel: str, data: bytes | memoryview) -> None:
        """Send a message to all subscribers of its channel."""
        subscribers = self.subscribers_by_channel.get(channel)
        if subscribers is None:
            if len(self.subscribers_by_channel) >= MAX_CACHED_CHANNELS:
                self.subscribers_by_channel.clear()
            subscribers = [connection for connection in self.connections if connection.subscriptions.match(channel)]
            self.subscribers_by_channel[channel] = subscribers
        for connection in subscribers:
            connection.send(channel, data)
        self.relayed += len(subscribers)


def _is_loopback(address: str) -> bool:
    return ipaddress.ip_address(address.partition("%")[0]).is_loopback


class HubConnection(asyncio.BufferedProtocol):
    """Connection to one client of the hub."""

    def __init__(self, hub: TcpqHub) -> None:
        self._hub = hub
        self._parser = FrameParser(
            MAGIC_CLIENT, hub.config.message_bytes + MAX_HEADER_BYTES, self._on_frame, hub.reserve, hub.release
        )
        self._transport: asyncio.Transport | None = None
        self._socket: socket.socket | None = None
        self._paused = False
        self.subscriptions = Subscriptions(hub.config.hub_subscriptions)
        self.name = "?"
        """Address and port of the client, for the log."""
        self.is_local = False
        """True if a program on this machine is the client. Always False if the hub listens beyond loopback: proxies and
        ports of containers relay clients of other machines."""

    @property
    def unsent_bytes(self) -> int:
        """Bytes queued for the client."""
        return self._transport.get_write_buffer_size() if self._transport is not None else 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)
        peer = transport.get_extra_info("peername")
        self.name = str(peer)
        self.is_local = self._hub.is_local and bool(peer) and _is_loopback(peer[0])
        if len(self._hub.connections) >= self._hub.config.hub_clients:
            self._refuse(f"the hub has {self._hub.config.hub_clients} clients already")
            return
        sock: Any = transport.get_extra_info("socket")
        self._socket = socket.socket(fileno=os.dup(sock.fileno()))
        self._acknowledge_at_once()
        self._transport.write(HUB_HELLO)
        self._hub.connections.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        self._transport = None
        self._parser.close()
        self._hub.connections.discard(self)
        self._hub.subscribers_by_channel.clear()
        self._hub.on_disconnect(self)

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._parser.buffer()

    def buffer_updated(self, nbytes: int) -> None:
        self._acknowledge_at_once()
        try:
            self._parser.received(nbytes)
        except FrameError as error:
            self._refuse(str(error))

    def send(self, channel: str, data: bytes | memoryview) -> None:
        """Queue a message for the client; disconnect it if it reads too slowly."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        publish(transport, channel, data)
        if transport.get_write_buffer_size() > self._hub.config.hub_client_send_bytes:
            self._refuse(f"it reads too slowly: {transport.get_write_buffer_size()} bytes are queued")

    def pause_reading(self) -> None:
        """Stop reading. TCP's flow control then blocks the client when it sends."""
        if not self._paused and self._transport is not None and not self._transport.is_closing():
            self._paused = True
            self._transport.pause_reading()

    def resume_reading(self) -> None:
        """Read again after ``pause_reading``."""
        if self._paused and self._transport is not None and not self._transport.is_closing():
            self._paused = False
            self._transport.resume_reading()

    def abort(self) -> None:
        """Close the connection at once."""
        if self._transport is not None:
            self._transport.abort()

    def _acknowledge_at_once(self) -> None:
        """Make Linux acknowledge received bytes at once. Linux resets this option, so it is set after every read.

        liblcm sends each integer of a frame separately, and Nagle's algorithm delays each integer until the one before
        is acknowledged. A round trip takes 0.3 ms with this option and 44 ms without.
        """
        if self._socket is not None:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)

    def _on_frame(self, frame_type: FrameType, channel: str, data: bytes | memoryview) -> None:
        match frame_type:
            case FrameType.PUBLISH:
                self._hub.handle_message(self, channel, data)
            case FrameType.SUBSCRIBE:
                self._subscribe(channel)
            case FrameType.UNSUBSCRIBE:
                self.subscriptions.remove(channel)
                self._hub.subscribers_by_channel.clear()

    def _subscribe(self, text: str) -> None:
        """Add a subscription; ignore it with a warning if it is not supported."""
        try:
            pattern = self.subscriptions.add(text)
        except PatternError as error:
            _log.warning("A hub client's subscription was ignored", client=self.name, reason=str(error))
            return
        if pattern is not None:
            self._hub.subscribers_by_channel.clear()
            channel, message = self._hub.greeting
            if pattern.regex.fullmatch(channel):
                self.send(channel, message)

    def _refuse(self, reason: str) -> None:
        """Disconnect the client, and count and log it."""
        self._hub.refused += 1
        _log.warning("A hub client was disconnected", client=self.name, reason=reason)
        self.abort()
