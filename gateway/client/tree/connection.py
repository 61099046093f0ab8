"""Connection of the tree viewer client to an LCM network, by liblcm. A thread of its own receives the messages."""

from __future__ import annotations

import contextlib
import os
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

DEFAULT_URL: Final = "udpm://239.255.76.67:7667?ttl=0"
"""liblcm's default URL: multicast that stays on this machine."""
DEFAULT_TCPQ_PORT: Final = 7700
POLL_MS: Final = 100
"""Maximum time that the receiving thread waits for a message before it checks whether the connection was closed."""
RETRY_SECONDS: Final = 0.2
"""Interval between attempts to connect."""
HELLO_SECONDS: Final = 1.0
"""Timeout for the first message of a TCPQ hub. liblcm has no such timeout."""
_HINTS: Final = {"tcpq": "no hub listens there", "udpm": "is there a route for multicast?"}
"""Probable reason of a failure, by URL scheme. liblcm does not return its reasons, but prints them to stderr."""
_SUCCESS_LINES: Final = frozenset((b"LCM tcpq: connecting...",))
"""Lines that liblcm writes to stderr although nothing failed."""
_STDERR_FD: Final = 2

_stderr_lock: Final = threading.Lock()
"""Held while the process's stderr is redirected."""

_lost_connections: Final[list[Any]] = []
"""LCM objects of lost connections, kept alive: liblcm may crash if one is freed while another thread uses it."""


class LcmConnection:
    """LCM connection that any thread may publish on. It connects again when it loses a TCPQ hub."""

    def __init__(self, url: str | None, handlers: Mapping[str, Callable[[bytes], None]], timeout: float) -> None:
        """Connect, and start the receiving thread.

        Args:
            url: LCM URL; None: the environment variable LCM_DEFAULT_URL, or else liblcm's default.
            handlers: callback for each channel. The receiving thread calls it with the message.
            timeout: seconds to wait for a hub.

        Raises:
            ConnectionError: no hub listens, or there is no route.
            ImportError: the package lcm cannot be loaded.
        """
        self.url = url or os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL
        self._handlers = handlers
        self._timeout = timeout
        self._closed = threading.Event()
        self._connected = threading.Condition()
        self._lcm: Any = None
        deadline = time.monotonic() + timeout
        while self._lcm is None:
            try:
                self._lcm = self._connect()
            except ConnectionError:
                if not self.url.startswith("tcpq") or time.monotonic() > deadline:
                    raise
                time.sleep(RETRY_SECONDS)
        self._thread = threading.Thread(target=self._receive, name="treeviewer-receive", daemon=True)
        self._thread.start()

    def publish(self, channel: str, message: bytes | NDArray[np.uint8]) -> None:
        """Send a message. Waits up to the timeout while there is no connection.

        Raises:
            ConnectionError: no connection within the timeout, or the message cannot be sent.
        """
        with self._connected:
            if not self._connected.wait_for(lambda: self.is_connected or self._closed.is_set(), self._timeout):
                raise ConnectionError(f"the LCM hub {self.url} has gone")
            if self._closed.is_set():
                raise ConnectionError("this viewer was closed")
            try:
                self._lcm.publish(channel, message)
            except OSError:
                raise ConnectionError(f"LCM could not send {len(message)} bytes to {self.url}") from None

    def close(self) -> None:
        """Stop the receiving thread. Further calls do nothing."""
        self._closed.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    @property
    def is_connected(self) -> bool:
        """False while the connection to a hub is lost."""
        return self._lcm is not None and self._lcm.fileno() >= 0

    def _connect(self) -> Any:
        """Return a new LCM object that is subscribed to the channels."""
        try:
            import lcm
        except ImportError as error:
            lacks_glib = "lcm.Release" in str(error)
            remedy = "apt install libglib2.0-0, the system library that it needs" if lacks_glib else "pip install lcm"
            raise ImportError(f"The package lcm cannot be loaded ({error}): {remedy}") from None
        scheme = self.url.partition("://")[0]
        hint = _HINTS.get(scheme, "use udpm:// or tcpq://")
        url = _with_host_address(self.url)
        if scheme == "tcpq" and not _listens(url):  # checked first: liblcm writes three lines to stderr
            raise ConnectionError(f"LCM cannot join {self.url}: {hint}")
        try:
            with filtered_stderr() if scheme == "tcpq" else contextlib.nullcontext():
                network = lcm.LCM(url)
        except RuntimeError:
            raise ConnectionError(f"LCM cannot join {self.url}: {hint}") from None
        for channel, handler in self._handlers.items():
            subscription = network.subscribe(escape_channel(channel), partial(_call_without_channel, handler))
            subscription.set_queue_capacity(0)
        return network

    def _receive(self) -> None:
        """Receive messages until the connection is closed: the body of the receiving thread."""
        while not self._closed.is_set():
            if not self.is_connected:
                self._reconnect()
                continue
            try:
                self._lcm.handle_timeout(POLL_MS)
            except OSError:  # a signal, or the hub is lost: then is_connected is False
                time.sleep(0.01)

    def _reconnect(self) -> None:
        """Try to connect; wait ``RETRY_SECONDS`` if that fails."""
        with contextlib.suppress(ConnectionError):
            network = self._connect()
            with self._connected:
                _lost_connections.append(self._lcm)
                self._lcm = network
                self._connected.notify_all()
            return
        self._closed.wait(RETRY_SECONDS)


@contextlib.contextmanager
def filtered_stderr() -> Iterator[None]:
    """Redirect the process's stderr to a file inside the context, then write it to stderr without ``_SUCCESS_LINES``.

    liblcm's C code writes to file descriptor 2 and has no option against that. What other threads write meanwhile
    appears milliseconds later, when the connection to the hub is made.
    """
    with _stderr_lock, tempfile.TemporaryFile() as captured:
        try:
            saved_fd = os.dup(_STDERR_FD)
        except OSError:  # stderr is closed
            yield
            return
        os.dup2(captured.fileno(), _STDERR_FD)
        try:
            yield
        finally:
            os.dup2(saved_fd, _STDERR_FD)
            os.close(saved_fd)
            captured.seek(0)
            forwarded = b"".join(line for line in captured if line.rstrip() not in _SUCCESS_LINES)
            with contextlib.suppress(OSError):  # a pipe without a reader
                os.write(_STDERR_FD, forwarded)


def escape_channel(channel: str) -> str:
    """Return liblcm's regular expression for exactly this channel."""
    return "".join(char if char.isalnum() or char in "_<>" else f"\\{char}" for char in channel)


def _call_without_channel(handler: Callable[[bytes], None], _channel: str, message: bytes) -> None:
    handler(message)


def _with_host_address(url: str) -> str:
    """Return a URL whose TCPQ host name is replaced by its address, since liblcm resolves no names."""
    parts = urlsplit(url)
    if parts.scheme != "tcpq" or not parts.hostname:
        return url
    try:
        return f"tcpq://{socket.gethostbyname(parts.hostname)}:{parts.port or DEFAULT_TCPQ_PORT}"
    except OSError:
        raise ConnectionError(f"LCM cannot join {url}: the host {parts.hostname!r} is unknown") from None


def _listens(url: str) -> bool:
    """Return True if a hub at a TCPQ URL accepts a connection and sends its first message in time."""
    try:
        parts = urlsplit(url)
        with socket.create_connection((parts.hostname, parts.port or DEFAULT_TCPQ_PORT), HELLO_SECONDS) as probe:
            return bool(probe.recv(8))
    except (OSError, ValueError):
        return False
