"""Whether what listens on a port is a gateway of ours, for ``scenegate check``."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
import ssl
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

SECONDS: Final = 2.0
"""A gateway that draws answers later than an idle one, and nobody waits long for a table."""
WHOLE_SECONDS: Final = 5.0
"""For all of an answer: the bound before is for each byte of it."""
MOST_BYTES: Final = 1 << 20
"""Of an answer: what listens there may be anything."""
_NOT_OURS: Final = (OSError, http.client.HTTPException, ValueError, RecursionError)
"""Of connecting, of what is not HTTP, of what is not JSON."""
_ANY: Final = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}  # noqa: S104 - a comparison
"""Addresses that stand for all of this machine's, and one of them."""


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A running gateway."""

    version: str
    status: str
    """As ``/readyz`` says it."""
    ports: frozenset[int]
    """Its other TCP ports: of gRPC, the TCPQ hub, the device's REST interface."""


def gateway_at(host: str, port: int) -> Neighbour | None:
    """The gateway whose HTTP port this is; None: something else, or nobody, answers there."""
    host = _ANY.get(host, host)
    # Only asked what it is: nothing secret is sent, and the certificate is for the name that others use.
    context = ssl._create_unverified_context()  # noqa: S323 - as above
    for connection in (
        http.client.HTTPConnection(host, port, timeout=SECONDS),
        http.client.HTTPSConnection(host, port, timeout=SECONDS, context=context),
    ):
        with (
            contextlib.closing(connection),
            contextlib.suppress(*_NOT_OURS),
            _cut_off(connection),
        ):
            connection.request("GET", "/healthz")
            return _read(json.loads(connection.getresponse().read(MOST_BYTES)))
    return None


@contextmanager
def _cut_off(connection: http.client.HTTPConnection) -> Iterator[None]:
    """Ends the connection when the time for all of it is over."""

    def end() -> None:
        if connection.sock is not None:
            with contextlib.suppress(OSError):
                socket.socket.shutdown(connection.sock, socket.SHUT_RDWR)  # below TLS, which another thread may be in

    timer = threading.Timer(WHOLE_SECONDS, end)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _read(health: Any) -> Neighbour | None:
    match health:
        case {"version": str(version), "status": str(status), "interfaces": dict(interfaces)}:
            return Neighbour(version, status, frozenset(_ports(interfaces)))
    return None


def _ports(interfaces: Mapping[str, Any]) -> Iterator[int]:
    for entry in interfaces.values():
        match entry:
            case {"port": int(port)}:
                yield port
            case {"tcpq": {"url": str(url)}}:
                yield urlsplit(url).port or 0
