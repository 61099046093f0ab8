"""Transport by LCM's own library, for the networks that only it supports: ``memq://``, ``mpudpm://`` and ``file://``.

liblcm receives in a thread of its own, and writes to a pipe when messages arrive. The event loop watches the pipe.
"""

import asyncio
import logging
import os
from collections.abc import Callable
from typing import Any, Final

from scenegate.lcm.transport import LcmMessage, LcmUnavailableError, OnMessage, ReceiveQueue

_log = logging.getLogger("scenegate.lcm")

MAX_OPEN_FILES: Final = 1000
"""Maximum number of open files at start. liblcm calls select(2), which overwrites the stack for file descriptors of
1024 and more; it opens a few itself."""
MAX_READ_MESSAGES: Final = 1024
"""Maximum number of messages taken from liblcm before the event loop continues. It is higher than
``transport.MAX_HANDLED``, because our receive queue has a limit in bytes and liblcm's own queue has none."""


class LiblcmTransport:
    """``Transport`` by liblcm. Must be created before many files are open (see ``MAX_OPEN_FILES``)."""

    def __init__(self, url: str, pattern: str, max_queued_bytes: int) -> None:
        """Join the network, and receive the channels of a regular expression. Raises LcmUnavailableError."""
        self.url = url
        self.queue = ReceiveQueue(max_queued_bytes)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._lcm = _connect(url)
        subscription = self._lcm.subscribe(pattern, lambda channel, data: self.queue.put(LcmMessage(channel, data)))
        if subscription is None:
            raise LcmUnavailableError(f"LCM does not accept the pattern {pattern!r}")
        subscription.set_queue_capacity(0)  # no limit; by default all but 30 messages of a burst are dropped

    def start(self, on_message: OnMessage, on_connect: Callable[[], None]) -> None:
        self.queue.start(on_message)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._lcm.fileno(), self._on_readable)
        on_connect()

    @property
    def is_connected(self) -> bool:
        return self._loop is not None

    def publish(self, channel: str, message: bytes | bytearray) -> None:
        try:
            self._lcm.publish(channel, bytes(message))
        except OSError as error:
            raise OSError(f"LCM cannot publish {len(message)} bytes on {channel!r}: {error}") from None

    async def drain(self, max_bytes: int) -> None:
        """Return at once: nothing is queued, because liblcm's ``publish`` blocks until the message is sent."""

    async def finish(self) -> None:
        """Return at once, for the same reason as ``drain``."""

    async def close(self) -> None:
        if self._loop is not None:
            self._loop.remove_reader(self._lcm.fileno())
            self._loop = None
        self.queue.close()
        del self._lcm  # the last reference: it disconnects

    def status(self) -> dict[str, object]:
        return {"url": self.url, **self.queue.status()}

    def _on_readable(self) -> None:
        """Take messages from liblcm, and handle the first ones."""
        try:
            for _ in range(MAX_READ_MESSAGES):
                if self._lcm.handle_timeout(0) == 0:
                    break
        except OSError as error:
            _log.warning("LCM could not read a message: %s", error)
        self.queue.handle_some()


def _connect(url: str) -> Any:
    """Return a connected LCM object. Raises LcmUnavailableError, also if too many files are open."""
    try:
        import lcm
    except ImportError as error:
        is_package_missing = error.name == "lcm"  # else the package is there, but not a library that it needs
        remedy = "it needs the system library libglib-2.0.so.0: apt install libglib2.0-0"
        if is_package_missing:
            remedy = "pip install 'scenegate-client[lcm]'"
        raise LcmUnavailableError(
            f"LCM's library, which {url.partition('://')[0]}:// needs, cannot be loaded ({error}): {remedy}"
        ) from None
    lowest_free_descriptor = os.open(os.devnull, os.O_RDONLY)
    os.close(lowest_free_descriptor)
    if lowest_free_descriptor >= MAX_OPEN_FILES:
        raise LcmUnavailableError(
            f"LCM's library cannot start with {lowest_free_descriptor} open files, it must come before them"
        )
    try:
        return lcm.LCM(url)
    except RuntimeError:
        raise LcmUnavailableError(f"LCM cannot join {url}: its library refuses it") from None
