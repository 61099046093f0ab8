"""liblcm on the event loop, for the networks that only it knows (``memq://``, ``mpudpm://``, ``file://``).

liblcm reads in a thread of its own and tells by a pipe that messages are there; the loop watches the pipe.
"""

from __future__ import annotations

import asyncio
import os
from collections import deque
from collections.abc import Callable
from typing import Any, Final

import structlog

from gateway.lcm.errors import LcmUnavailable

_log = structlog.get_logger("gateway.treeviewer")

SCHEMES: Final = ("udpm", "tcpq", "mpudpm", "memq", "file")
"""What an LCM URL can begin with."""
MOST_FILES: Final = 1000
"""liblcm waits with select(2) when it starts, which writes over its stack at file numbers of 1024 and more."""
HANDLED_AT_ONCE: Final = 64
"""Messages taken from liblcm before the loop goes on: a few milliseconds at most when they are small."""
OVERHEAD_BYTES: Final = 256


class LcmBus:
    """Our place on an LCM network. Create it early (see ``MOST_FILES``), use it in one event loop."""

    def __init__(self, url: str, pattern: str, waiting_bytes: int) -> None:
        """Joins the network.

        Args:
            pattern: of the channels to receive.
            waiting_bytes: of messages taken from liblcm and not handled yet; what arrives beyond it is dropped.
        Raises:
            LcmUnavailable: with the reason in one sentence.
        """
        self.url = url
        self._most_waiting = waiting_bytes
        self._waiting: deque[tuple[str, bytes]] = deque()
        self.waiting_bytes = 0
        self.dropped = 0
        self.dropped_bytes = 0
        self._receive: Callable[[str, bytes], None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._scheduled = False
        self._lcm = _join(self.url)
        subscription = self._lcm.subscribe(pattern, self._arrived)
        if subscription is None:
            raise LcmUnavailable(f"LCM does not accept the pattern {pattern!r}")
        # liblcm would drop all but 30 messages of a burst; they are moved to a queue bounded in bytes at once
        subscription.set_queue_capacity(0)

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
        del self._lcm

    def status(self) -> dict[str, object]:
        """Plain JSON values."""
        return {
            "url": self.url,
            "waiting_bytes": self.waiting_bytes,
            "dropped": self.dropped,
            "dropped_bytes": self.dropped_bytes,
        }

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
    scheme = url.partition("://")[0]
    if scheme not in SCHEMES:
        known = ", ".join(f"{name}://" for name in SCHEMES)
        raise LcmUnavailable(f"LCM cannot join {url}: it knows {known} and 'off', nothing else")
    try:
        import lcm
    except ImportError as error:
        raise LcmUnavailable(
            f"LCM's library, which {scheme}:// needs, cannot be loaded ({error}); "
            "it needs the system library libglib-2.0.so.0: apt install libglib2.0-0"
        ) from None
    probe = os.dup(0) if _has_file(0) else os.open(os.devnull, os.O_RDONLY)
    os.close(probe)
    if probe >= MOST_FILES:
        raise LcmUnavailable(f"LCM's library cannot start with {probe} open files, it must come before them")
    try:
        return lcm.LCM(url)
    except RuntimeError:
        raise LcmUnavailable(f"LCM cannot join {url}: its library refuses it") from None


def _has_file(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True
