"""A TCPQ hub: for clients without multicast (containers, NAT), lossless at any size.

It relays between its clients as LCM's own (Java) hub does, and serves the gateway itself without a connection. It does
not bridge to UDP.
"""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable
from typing import Any, Final, cast

import structlog

from gateway.lcm.config import LcmConfig
from gateway.lcm.errors import LcmUnavailable
from gateway.lcm.safe_regex import CHARACTERS, MOST_STEPS, Pattern, PatternError, compile_pattern
from gateway.lcm.tcpq import (
    HUB_HELLO,
    LONGEST_CHANNEL,
    LONGEST_PATTERN,
    MAGIC_CLIENT,
    Frame,
    FrameError,
    FrameReader,
    publish_head,
)

_log = structlog.get_logger("gateway.treeviewer")

REMEMBERED_CHANNELS: Final = 1024
"""Channels whose receivers are known without matching patterns again."""
CLIENT_STEPS: Final = 2 * MOST_STEPS
"""Limit for all patterns of one client together: a new channel is matched with every pattern.

For a channel of more than 63 characters a repetition costs more; patterns that go beyond this number are not tried."""
JOINED_BYTES: Final = 16 * 1024
"""Smaller messages are copied behind their head, so that they go out in one packet."""

Receive = Callable[["HubConnection", str, "bytes | memoryview"], None]


class Hub:
    """Connections, their subscriptions, and the relaying between them."""

    def __init__(self, config: LcmConfig, receive: Receive, wanted: str, greeting: tuple[str, bytes]) -> None:
        """
        Args:
            receive: gets what is published on channels that match ``wanted``, a pattern.
            greeting: channel and message for every client that subscribes to that channel.
        """
        self.config = config
        self._receive = receive
        self._wanted = compile_pattern(wanted)
        self._greeting = greeting
        self._server: asyncio.Server | None = None
        self.connections: set[HubConnection] = set()
        self._receivers: dict[str, list[HubConnection]] = {}
        self._arriving = 0
        self.relayed = 0
        self.refused = 0
        """Connections ended because they were too many, did not speak TCPQ, or read too slowly."""
        self.dropped = 0
        """Messages not relayed because their channel's name is longer than ``LONGEST_CHANNEL``."""

    async def start(self) -> None:
        """Listens. Raises LcmUnavailable when the port cannot be had."""
        host, port = self.config.tcpq_host, self.config.tcpq_port
        try:
            loop = asyncio.get_running_loop()
            self._server = await loop.create_server(lambda: HubConnection(self), host, port, backlog=256)
        except (OSError, OverflowError) as error:
            reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            raise LcmUnavailable(f"the TCPQ hub cannot listen on {host}:{port}: {reason}") from None

    @property
    def port(self) -> int:
        """Where it listens; 0 when it does not."""
        sockets = self._server.sockets if self._server is not None else ()
        return int(sockets[0].getsockname()[1]) if sockets else 0

    async def close(self) -> None:
        """Ends all connections."""
        if self._server is not None:
            self._server.close()
            for connection in tuple(self.connections):
                connection.abort()
            await self._server.wait_closed()
            self._server = None

    def publish(self, channel: str, message: bytes) -> None:
        """Sends to every client that has subscribed to it.

        Raises:
            ValueError: the channel's name is too long.
        """
        if _too_long(channel):
            raise ValueError(f"the hub relays channel names of at most {LONGEST_CHANNEL} bytes")
        self._relay(channel, message)

    def status(self) -> dict[str, object]:
        """Plain JSON values."""
        return {
            "url": f"tcpq://{self.config.tcpq_host}:{self.port}",
            "clients": len(self.connections),
            "relayed": self.relayed,
            "refused": self.refused,
            "dropped": self.dropped,
            "arriving_bytes": self._arriving,
            "unsent_bytes": sum(connection.unsent_bytes for connection in self.connections),
        }

    def reserve(self, size: int) -> bool:
        """Whether ``size`` more bytes may be collected; the bound is that of waiting messages."""
        if size > 0 and self._arriving + size > self.config.waiting_bytes:
            return False
        self._arriving += size
        return True

    def changed(self) -> None:
        """Subscriptions are not what they were."""
        self._receivers.clear()

    def greet(self, connection: HubConnection, pattern: Pattern) -> None:
        """Tells a new subscriber that the viewer is there, as a viewer that has just started would."""
        channel, message = self._greeting
        if pattern.matches(channel):
            connection.send(channel, message)

    def published(self, sender: HubConnection, channel: str, data: bytes | memoryview) -> None:
        """A client published: the gateway's own ears first, then the other clients'."""
        if _too_long(channel):
            if not self.dropped:
                _log.warning(
                    "A channel name is too long; its messages are dropped", client=sender.name, channel=channel[:100]
                )
            self.dropped += 1
            return
        if self._wanted.matches(channel):
            self._receive(sender, channel, data)
        self._relay(channel, data)

    def _relay(self, channel: str, data: bytes | memoryview) -> None:
        receivers = self._receivers.get(channel)
        if receivers is None:
            if len(self._receivers) >= REMEMBERED_CHANNELS:
                self._receivers.clear()
            receivers = [connection for connection in self.connections if connection.wants(channel)]
            self._receivers[channel] = receivers
        for connection in receivers:
            connection.send(channel, data)
        self.relayed += len(receivers)


def _too_long(channel: str) -> bool:
    return len(channel.encode()) > LONGEST_CHANNEL


class HubConnection(asyncio.BufferedProtocol):
    """One client of the hub."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        limit = hub.config.message_bytes + 1024
        self._reader = FrameReader(MAGIC_CLIENT, limit, self._framed, hub.reserve)
        self._patterns: dict[str, tuple[Pattern, int]] = {}
        """Pattern and number of subscriptions by its text."""
        self._transport: asyncio.Transport | None = None
        self._options: socket.socket | None = None
        self.name = "?"
        self._held = False
        self._steps = 0
        """Steps of all patterns together for a channel of 63 characters."""

    @property
    def unsent_bytes(self) -> int:
        return self._transport.get_write_buffer_size() if self._transport is not None else 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)
        self.name = str(transport.get_extra_info("peername"))
        if len(self._hub.connections) >= self._hub.config.hub_clients:
            self._end(f"the hub has {self._hub.config.hub_clients} clients already")
            return
        # liblcm sends every word by itself and waits for nothing, so Nagle's algorithm delays each until the one
        # before is acknowledged; Linux acknowledges at once only when asked, and forgets it soon: see _acknowledge
        sock: Any = transport.get_extra_info("socket")
        self._options = socket.socket(fileno=os.dup(sock.fileno()))
        self._acknowledge()
        self._transport.write(HUB_HELLO)
        self._hub.connections.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._options is not None:
            self._options.close()
            self._options = None
        self._transport = None
        self._hub.reserve(-self._reader.reserved)
        self._reader.reserved = 0
        self._hub.connections.discard(self)
        self._hub.changed()

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._reader.buffer()

    def buffer_updated(self, nbytes: int) -> None:
        self._acknowledge()
        try:
            self._reader.received(nbytes)
        except FrameError as error:
            self._end(str(error))

    def eof_received(self) -> bool:
        return False

    def wants(self, channel: str) -> bool:
        """Whether one of the client's subscriptions matches."""
        left = CLIENT_STEPS
        for pattern, _ in self._patterns.values():
            steps = pattern.steps(len(channel))
            if steps <= left:
                left -= steps
                if pattern.matches(channel):
                    return True
        return False

    def send(self, channel: str, data: bytes | memoryview) -> None:
        """Queues a message for the client; one that does not read loses its connection when too much is queued."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        head = publish_head(channel, len(data))
        if len(data) <= JOINED_BYTES:
            transport.write(b"".join((head, data)))
        else:
            transport.write(head)
            transport.write(data)
        if transport.get_write_buffer_size() > self._hub.config.hub_client_send_bytes:
            self._end(f"it does not read: {transport.get_write_buffer_size()} bytes wait for it")

    def hold(self) -> None:
        """Stops reading from the client, which makes it wait."""
        if not self._held and self._transport is not None and not self._transport.is_closing():
            self._held = True
            self._transport.pause_reading()

    def release(self) -> None:
        """Reads on."""
        if self._held and self._transport is not None and not self._transport.is_closing():
            self._held = False
            self._transport.resume_reading()

    def abort(self) -> None:
        if self._transport is not None:
            self._transport.abort()

    def _acknowledge(self) -> None:
        if self._options is not None:
            self._options.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)

    def _framed(self, kind: Frame, channel: str, data: bytes | memoryview) -> None:
        if kind is Frame.PUBLISH:
            self._hub.published(self, channel, data)
        elif kind is Frame.SUBSCRIBE:
            self._subscribe(channel)
        else:
            self._unsubscribe(channel)

    def _subscribe(self, text: str) -> None:
        known = self._patterns.get(text)
        if known is not None:
            self._patterns[text] = (known[0], known[1] + 1)
            return
        if len(self._patterns) >= self._hub.config.hub_subscriptions:
            _log.warning("A hub client has too many subscriptions", client=self.name, pattern=text)
            return
        try:
            if len(text.encode()) > LONGEST_PATTERN:
                raise PatternError(f"it has {len(text.encode())} bytes, {LONGEST_PATTERN} are possible")
            pattern = compile_pattern(text)
        except PatternError as error:
            _log.warning("A hub client's subscription was ignored", client=self.name, reason=str(error))
            return
        steps = pattern.steps(CHARACTERS)
        if self._steps + steps > CLIENT_STEPS:
            _log.warning("A hub client's subscriptions take too long to match", client=self.name, pattern=text)
            return
        self._steps += steps
        self._patterns[text] = (pattern, 1)
        self._hub.changed()
        self._hub.greet(self, pattern)

    def _unsubscribe(self, text: str) -> None:
        pattern, times = self._patterns.pop(text, (None, 0))
        if pattern is not None:
            if times > 1:
                self._patterns[text] = (pattern, times - 1)
            else:
                self._steps -= pattern.steps(CHARACTERS)
        self._hub.changed()

    def _end(self, reason: str) -> None:
        self._hub.refused += 1
        _log.warning("A hub client was disconnected", client=self.name, reason=reason)
        self.abort()
