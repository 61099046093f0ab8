"""liblcm on the event loop: UDP multicast and whatever else its URL says.

liblcm reads its socket in a thread of its own and tells by a pipe that messages are there; the loop watches the pipe.
"""

from __future__ import annotations

import asyncio
import os
from collections import deque
from collections.abc import Callable
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

import structlog

from gateway.treeviewer.errors import TreeViewerUnavailable
from gateway.treeviewer.receive_buffer import ReceiveBuffer, open_files, system_limit

_log = structlog.get_logger("gateway.treeviewer")

DEFAULT_URL: Final = "udpm://239.255.76.67:7667?ttl=0"
"""liblcm's own default."""
MOST_FILES: Final = 1000
"""liblcm waits with select(2) when it starts, which writes over its stack at file numbers of 1024 and more."""
HANDLED_AT_ONCE: Final = 64
"""Messages taken from liblcm before the loop goes on: a few milliseconds at most when they are small."""
OVERHEAD_BYTES: Final = 256
ROUTE_HINT: Final = "there may be no route for multicast; on one machine 'ip route add 224.0.0.0/4 dev lo' adds one"


class LcmBus:
    """Our place on an LCM network. Create it early (see ``MOST_FILES``), use it in one event loop."""

    def __init__(self, url: str | None, pattern: str, buffer_bytes: int, waiting_bytes: int) -> None:
        """Joins the network.

        Args:
            url: None or empty: LCM_DEFAULT_URL, or liblcm's default.
            pattern: of the channels to receive.
            buffer_bytes: wanted for the UDP socket.
            waiting_bytes: of messages taken from liblcm and not handled yet; what arrives beyond it is dropped.
        Raises:
            TreeViewerUnavailable: with the reason in one sentence.
        """
        self.url = url or os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL
        self._most_waiting = waiting_bytes
        self._waiting: deque[tuple[str, bytes]] = deque()
        self.waiting_bytes = 0
        self.dropped = 0
        self.dropped_bytes = 0
        self._receive: Callable[[str, bytes], None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._scheduled = False
        before = open_files()
        self._lcm = _join(self.url)
        subscription = self._lcm.subscribe(pattern, self._arrived)
        if subscription is None:
            raise TreeViewerUnavailable(f"LCM does not accept the pattern {pattern!r}")
        # liblcm would drop all but 30 messages of a burst; they are moved to a queue bounded in bytes at once
        subscription.set_queue_capacity(0)
        self._buffer = ReceiveBuffer(before, _port(self.url))
        self.warning = self._raise_buffer(buffer_bytes)

    def start(self, receive: Callable[[str, bytes], None]) -> None:
        """Messages go to ``receive`` from now on, in the running event loop."""
        self._receive = receive
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._lcm.fileno(), self._readable)

    def publish(self, channel: str, message: bytes) -> None:
        """Raises OSError when LCM cannot send it (a channel name of more than 63 characters, no network)."""
        try:
            self._lcm.publish(channel, message)
        except OSError as error:
            raise OSError(f"LCM cannot publish {len(message)} bytes on {channel!r}: {error}") from None

    def close(self) -> None:
        """Leaves the network."""
        if self._loop is not None:
            self._loop.remove_reader(self._lcm.fileno())
            self._loop = None
        self._receive = None
        self._waiting.clear()
        self._buffer.close()
        del self._lcm

    def status(self) -> dict[str, object]:
        """Plain JSON values."""
        described: dict[str, object] = {
            "url": self.url,
            "waiting_bytes": self.waiting_bytes,
            "dropped": self.dropped,
            "dropped_bytes": self.dropped_bytes,
        }
        if self._buffer.found:
            described["receive_buffer_bytes"] = self._buffer.size()
            described["lost_datagrams"] = self._buffer.lost_datagrams()
        if self.warning:
            described["warning"] = self.warning
        return described

    def _raise_buffer(self, wanted: int) -> str:
        if not self._buffer.found:
            return ""
        granted = self._buffer.raise_to(wanted)
        if granted >= wanted:
            return ""
        limit = system_limit()
        known = "" if limit is None else f" (it is {limit} now)"
        warning = (
            f"LCM's receive buffer has {granted} bytes instead of {wanted}: larger messages "
            f"and bursts can get lost; 'sysctl -w net.core.rmem_max={wanted}' allows more{known}"
        )
        _log.warning(warning)
        return warning

    def _arrived(self, channel: str, data: bytes) -> None:
        size = len(data) + OVERHEAD_BYTES
        if self.waiting_bytes + size > self._most_waiting:
            self.dropped += 1
            self.dropped_bytes += len(data)
            return
        self._waiting.append((channel, data))
        self.waiting_bytes += size

    def _readable(self) -> None:
        """Moves what liblcm holds to our queue, and handles some of it."""
        try:
            # liblcm's own queue has no bound, so it must not fall behind when ours is long
            for _ in range(HANDLED_AT_ONCE * (1 + 15 * (len(self._waiting) > HANDLED_AT_ONCE))):
                if self._lcm.handle_timeout(0) == 0:
                    break
        except OSError as error:
            _log.warning("LCM could not read a message", reason=str(error))
        if not self._scheduled:
            self._handle()

    def _handle(self) -> None:
        self._scheduled = False
        for _ in range(min(HANDLED_AT_ONCE, len(self._waiting))):
            channel, data = self._waiting.popleft()
            self.waiting_bytes -= len(data) + OVERHEAD_BYTES
            if self._receive is not None:
                self._receive(channel, data)
        if self._waiting and self._loop is not None:
            self._scheduled = True
            self._loop.call_soon(self._handle)


def _join(url: str) -> Any:
    try:
        import lcm
    except ImportError as error:
        raise TreeViewerUnavailable(
            f"LCM cannot be loaded ({error}); it needs the system library libglib-2.0.so.0: apt install libglib2.0-0"
        ) from None
    probe = os.dup(0) if _has_file(0) else os.open(os.devnull, os.O_RDONLY)
    os.close(probe)
    if probe >= MOST_FILES:
        raise TreeViewerUnavailable(f"LCM cannot start with {probe} open files, it must come before them")
    try:
        return lcm.LCM(url)
    except RuntimeError:
        hint = ROUTE_HINT if url.startswith("udpm") else "nothing answers there"
        raise TreeViewerUnavailable(f"LCM cannot join {url}: {hint}") from None


def _has_file(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def _port(url: str) -> int:
    """Of a udpm URL; 0 for others."""
    parts = urlsplit(url)
    if parts.scheme != "udpm":
        return 0
    try:
        return parts.port or int(parse_qs(parts.query).get("port", ["7667"])[0])
    except ValueError:
        return 7667
