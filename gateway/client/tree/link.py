"""One place on an LCM network: a thread receives, any thread publishes; joined again when a TCPQ hub has gone."""

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
"""liblcm's own."""
WAIT_MS: Final = 100
"""Between looks whether the link was closed; messages wake the thread at once."""
RETRY_SECONDS: Final = 0.2
GREETING_SECONDS: Final = 1.0
"""For a hub's greeting. liblcm waits for it without end, and where it does, stderr is held back."""
_HINTS: Final = {"tcpq": "nobody listens there", "udpm": "is there a route for multicast?"}
"""Why a network of that scheme cannot be joined; liblcm tells its reasons on stderr only."""
_CHATTER: Final = frozenset((b"LCM tcpq: connecting...",))
"""Lines that liblcm writes to stderr on success."""
_STDERR: Final = 2

_stderr_lock: Final = threading.Lock()

_kept: Final[list[Any]] = []
"""LCM objects of links that were lost: liblcm may crash when one is ended while another thread has it."""


class Link:
    """Publishes and receives until closed."""

    def __init__(self, url: str | None, handlers: Mapping[str, Callable[[bytes], None]], timeout: float) -> None:
        """
        Args:
            url: None: LCM_DEFAULT_URL, or liblcm's default.
            handlers: by channel; called in the link's thread.
            timeout: seconds to wait for a hub that is not there (yet).
        Raises:
            ConnectionError: nobody is there, or there is no route.
            ImportError: LCM's library cannot be loaded.
        """
        self.url = url or os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL
        self._handlers = handlers
        self._timeout = timeout
        self._closed = threading.Event()
        self._joined = threading.Condition()
        self._lcm: Any = None
        end = time.monotonic() + timeout
        while self._lcm is None:
            try:
                self._lcm = self._join()
            except ConnectionError:
                if not self.url.startswith("tcpq") or time.monotonic() > end:
                    raise
                time.sleep(RETRY_SECONDS)
        self._thread = threading.Thread(target=self._receive, name="treeviewer-link", daemon=True)
        self._thread.start()

    def publish(self, channel: str, message: bytes | NDArray[np.uint8]) -> None:
        """Raises ConnectionError when there is no network within the timeout, or the message cannot be sent."""
        with self._joined:
            if not self._joined.wait_for(lambda: self._alive() or self._closed.is_set(), self._timeout):
                raise ConnectionError(f"the LCM hub {self.url} has gone")
            if self._closed.is_set():
                raise ConnectionError("this viewer was closed")
            try:
                self._lcm.publish(channel, message)
            except OSError:
                raise ConnectionError(f"LCM could not send {len(message)} bytes to {self.url}") from None

    def close(self) -> None:
        """Ends the thread; does nothing the second time."""
        self._closed.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _alive(self) -> bool:
        return self._lcm is not None and self._lcm.fileno() >= 0

    def _join(self) -> Any:
        try:
            import lcm
        except ImportError as error:
            raise ImportError(
                f"LCM cannot be loaded ({error}): pip install lcm, and apt install libglib2.0-0"
            ) from None
        scheme = self.url.partition("://")[0]
        hint = _HINTS.get(scheme, "udpm:// and tcpq:// are what viewers speak")
        url = _numeric(self.url)
        if scheme == "tcpq" and not _listens(url):  # liblcm would write three lines to stderr
            raise ConnectionError(f"LCM cannot join {self.url}: {hint}")
        try:
            with _without_chatter() if scheme == "tcpq" else contextlib.nullcontext():
                network = lcm.LCM(url)
        except RuntimeError:
            raise ConnectionError(f"LCM cannot join {self.url}: {hint}") from None
        for channel, handler in self._handlers.items():
            subscription = network.subscribe(_literal(channel), partial(_hand_on, handler))
            subscription.set_queue_capacity(0)
        return network

    def _receive(self) -> None:
        while not self._closed.is_set():
            if not self._alive():
                self._rejoin()
                continue
            try:
                self._lcm.handle_timeout(WAIT_MS)
            except OSError:
                time.sleep(0.01)  # a signal came, or the hub has gone: the file number tells

    def _rejoin(self) -> None:
        with contextlib.suppress(ConnectionError):
            network = self._join()
            with self._joined:
                _kept.append(self._lcm)
                self._lcm = network
                self._joined.notify_all()
            return
        self._closed.wait(RETRY_SECONDS)


@contextlib.contextmanager
def _without_chatter() -> Iterator[None]:
    """Holds back what is written to stderr, by anybody, and writes it there afterwards, without ``_CHATTER``.

    liblcm's C code writes to file 2 and cannot be told not to. Connecting to a hub that listens takes milliseconds.
    """
    with _stderr_lock, tempfile.TemporaryFile() as held:
        try:
            stderr = os.dup(_STDERR)
        except OSError:  # it is closed
            yield
            return
        os.dup2(held.fileno(), _STDERR)
        try:
            yield
        finally:
            os.dup2(stderr, _STDERR)
            os.close(stderr)
            held.seek(0)
            kept = b"".join(line for line in held if line.rstrip() not in _CHATTER)
            with contextlib.suppress(OSError):  # the reader is gone
                os.write(_STDERR, kept)


def _hand_on(handler: Callable[[bytes], None], channel: str, data: bytes) -> None:
    handler(data)


def _numeric(url: str) -> str:
    """The URL with a TCPQ host's address in place of its name, which liblcm does not look up."""
    parts = urlsplit(url)
    if parts.scheme != "tcpq" or not parts.hostname:
        return url
    try:
        return f"tcpq://{socket.gethostbyname(parts.hostname)}:{parts.port or 7700}"
    except OSError:
        raise ConnectionError(f"LCM cannot join {url}: the host {parts.hostname!r} is unknown") from None


def _listens(url: str) -> bool:
    """Return whether a hub accepts connections at a TCPQ URL and sends its greeting."""
    try:
        parts = urlsplit(url)
        with socket.create_connection((parts.hostname, parts.port or 7700), GREETING_SECONDS) as probe:
            return bool(probe.recv(8))
    except (OSError, ValueError):
        return False


def _literal(channel: str) -> str:
    """A subscription to exactly this channel; liblcm takes patterns."""
    return "".join(c if c.isalnum() or c in "_<>" else f"\\{c}" for c in channel)
