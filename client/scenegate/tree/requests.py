"""Sends requests of one client to a viewer, and receives their responses."""

import os
import secrets
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any, Final, NamedTuple

import numpy as np

from scenegate.lcm.transport import TransportLimits
from scenegate.messages import wire
from scenegate.messages.arguments import describe
from scenegate.messages.changes import geometry_bytes
from scenegate.messages.request_encoding import Response, decode_response, encode_request
from scenegate.tree.connection import LcmConnection

MAX_REQUEST_BYTES: Final = TransportLimits().message_bytes
"""Maximum size of a request. A hub disconnects the sender of a larger one."""
BYTES_PER_SECOND: Final = 10e6
"""Speed at which a slow viewer receives and reads a request. A response may take so much longer."""
_KEPT_BLOCK_BYTES: Final = 31 << 20
"""Size of the largest block whose release glibc takes as a sign that such blocks come again (malloc.h: 32 MB)."""
UNKNOWN_FORMATS: Final = (wire.UNKNOWN_FORMAT, wire.UNKNOWN_FORMAT_VERSION)
"""Status codes of a viewer that does not know the format of a request."""


class SentRequest(NamedTuple):
    """A request on its way."""

    utime: int
    """Microseconds since 1970: identifies the request."""
    response: Future[Response]
    nbytes: int
    """Size of the request."""


class Requests:
    """Requests and responses of one client. Thread-safe."""

    def __init__(
        self,
        url: str | None,
        timeout: float,
        binary: bool | None,
        on_message: Callable[[Response], None] = lambda message: None,
        on_request: Callable[[dict[str, Any], int], None] = lambda body, utime: None,
    ) -> None:
        """Connect to the LCM network; see ``TreeViewer`` for the first three arguments and for errors.

        The receiving thread calls ``on_message`` with announcements, and messages of the page. ``on_request`` is called
        with the body and the ``utime`` of each request before it is sent.
        """
        # From then on, glibc keeps freed blocks of some MB. It would else map new memory for every large request, which
        # takes ten times longer than encoding it.
        np.empty(_KEPT_BLOCK_BYTES, np.uint8)
        self.timeout = timeout
        self._negotiates_format = binary is None
        self.message_format: str | None = None if binary is None else wire.BINARY if binary else wire.JSON
        """Format of requests; None: not negotiated yet."""
        self._on_message = on_message
        self._on_request = on_request
        self._lock = threading.Lock()
        self._last_utime = 0
        """``utime`` of the last request: microseconds since 1970, made unique."""
        self.pending: dict[int, Future[Response]] = {}
        """Requests without a response, by ``utime``."""
        self.client_id = f"sg{os.getpid()}_{secrets.token_hex(8)}"
        handlers = {f"{wire.RESPONSE}_<{self.client_id}>": self._receive, wire.RESPONSE: self._receive_announcement}
        self.connection = LcmConnection(url, handlers, timeout)

    def send(self, body: dict[str, Any], encoded: Callable[[], None] = lambda: None) -> Response:
        """Send a request in the negotiated format, and return the response; ``encoded`` is called before it is sent.

        Raises ValueError if it exceeds ``MAX_REQUEST_BYTES``, or has a text that is not Unicode; TimeoutError;
        ConnectionError if the connection is closed, or lost for longer than the timeout.
        """
        if self.message_format is None:  # called before the wait for a viewer
            _encode(body, 0, wire.BINARY)
            encoded()
        response = self.wait(self.post(body, self._negotiated_format(), encoded))
        refused = response.status in UNKNOWN_FORMATS
        if refused and self.message_format == wire.BINARY and self._negotiates_format:
            self.message_format = wire.JSON  # another viewer, without MessagePack, runs now
            response = self.wait(self.post(body, self.message_format, encoded))
        return response

    def send_without_response(self, body: dict[str, Any]) -> None:
        """Send a request whose response is ignored, unless the connection is lost or the request is too large."""
        if self.connection.is_connected:
            try:
                sent = self.post(body)
            except (ConnectionError, ValueError):
                return
            self.pending.pop(sent.utime, None)

    def reads_files(self) -> bool:
        """Return True if the viewer reads the content of mesh files, as Scenegate does; see ``send`` for errors."""
        return not self._negotiates_format or self._negotiated_format() == wire.BINARY

    def _negotiated_format(self) -> str:
        """Return the format of requests. An empty request negotiates it."""
        if self.message_format is None:
            status = self.wait(self.post({}, wire.BINARY)).status
            self.message_format = wire.JSON if status in UNKNOWN_FORMATS else wire.BINARY
        return self.message_format

    def post(
        self, body: dict[str, Any], message_format: str | None = None, encoded: Callable[[], None] = lambda: None
    ) -> SentRequest:
        """Send one request without waiting for its response. ``None``: the negotiated format, JSON before that."""
        with self._lock:
            utime = self._last_utime = max(self._last_utime + 1, time.time_ns() // 1000)
            future = self.pending[utime] = Future()
        self._on_request(body, utime)
        try:
            message_format = message_format or self.message_format or wire.JSON
            message = _encode({"timestamp": utime, **body}, utime, message_format)
            encoded()
            self.connection.publish(f"{wire.REQUEST}_<{self.client_id}>", message, future.set_exception)
        except BaseException:
            self.pending.pop(utime, None)
            raise
        return SentRequest(utime, future, len(message))

    def wait(self, sent: SentRequest) -> Response:
        """Wait for the response to a request, longer for a big one; see ``send`` for errors."""
        timeout = self.timeout + sent.nbytes / BYTES_PER_SECOND
        try:
            return sent.response.result(timeout)
        except FutureTimeoutError:
            url = self.connection.url
            lost = "big messages can get lost over UDP, tcpq:// loses none"
            hint = lost if url.startswith("udpm") else self.connection.problem
            raise TimeoutError(
                f"no viewer answered within {timeout:.3g} s on {url}{'; ' if hint else ''}{hint}"
            ) from None
        finally:
            self.pending.pop(sent.utime, None)

    def _receive(self, message: bytes) -> None:
        """Complete a response's future, or pass on a message of the page. Runs in the receiving thread."""
        response = decode_response(message)
        if response is None:
            return
        future = self.pending.pop(response.timestamp, None)
        if future is not None:
            future.set_result(response)
        else:
            self._on_message(response)

    def _receive_announcement(self, message: bytes) -> None:
        """Pass on what a viewer sends to all clients. Runs in the receiving thread."""
        response = decode_response(message)
        if response is not None:
            self._on_message(response)


def _encode(body: dict[str, Any], utime: int, message_format: str) -> bytearray:
    """Return a request as LCM message; see ``Requests.send`` for errors."""
    nbytes = sum(
        geometry_bytes(geometry)
        for command in body.get("setgeometry", ())
        for geometry in command.get("geometries") or ()
    )
    at_least = nbytes if message_format == wire.BINARY else nbytes // 4  # 8 bytes are at least 2 characters
    if at_least > MAX_REQUEST_BYTES:  # encoding would take seconds
        raise ValueError(
            f"the request has at least {at_least} bytes, the limit is {MAX_REQUEST_BYTES}: send it in parts"
        )
    try:
        message = encode_request(body, utime, message_format)
    except UnicodeEncodeError as error:
        raise ValueError(f"{describe(error.object)} is not Unicode text") from None
    except OverflowError:
        raise ValueError("the request has an integer of more than 64 bits") from None
    if len(message) > MAX_REQUEST_BYTES:
        raise ValueError(f"the request has {len(message)} bytes, the limit is {MAX_REQUEST_BYTES}: send it in parts")
    return message
