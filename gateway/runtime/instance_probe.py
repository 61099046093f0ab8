"""Requests to a gateway that may run on a port: for ``scenegate doctor``, and the health check of a container."""

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

READ_SECONDS: Final = 2.0
"""Time limit for connecting and for each read: a busy gateway responds later than an idle one."""
TOTAL_SECONDS: Final = 5.0
"""Time limit for a whole response."""
MAX_BYTES: Final = 1 << 20
"""Maximum size of a response: any program may listen on the port."""
_WILDCARDS: Final = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}  # noqa: S104 - a comparison
"""Wildcard addresses, and an address to connect to."""


@dataclass(frozen=True, slots=True)
class RunningInstance:
    """A running gateway."""

    version: str
    status: str
    """Status of ``/readyz``."""
    ports: frozenset[int]
    """TCP ports of gRPC, the TCPQ hub and the device's REST interface."""


def probe_instance(host: str, port: int) -> RunningInstance | None:
    """Return the gateway whose HTTP port this is; None if another program or none responds."""
    for _, body in responses(_WILDCARDS.get(host, host), port, "/healthz"):
        with contextlib.suppress(ValueError, RecursionError):  # not JSON
            if (instance := _parse_health(json.loads(body))) is not None:
                return instance
    return None


def responses(host: str, port: int, path: str) -> Iterator[tuple[int, bytes]]:
    """Yield status and body of the response over HTTP, and of that over HTTPS, of those that there are.

    Proxies respond to HTTP with an error on ports that are for HTTPS: the first response may not be a gateway's.
    """
    # Nothing secret is sent, and the certificate is for the name that clients use.
    tls = ssl.create_default_context()
    tls.check_hostname, tls.verify_mode = False, ssl.CERT_NONE
    for context in (None, tls):
        if (response := _response(host, port, path, context)) is not None:
            yield response


def _response(host: str, port: int, path: str, context: ssl.SSLContext | None) -> tuple[int, bytes] | None:
    """Return status and body of a response over HTTP, or over HTTPS with a context; None if there is none."""
    connection = http.client.HTTPConnection(host, port)
    with contextlib.closing(connection), contextlib.suppress(OSError, http.client.HTTPException, ValueError):
        connection.sock = socket.create_connection((host, port), READ_SECONDS)
        if context is not None:  # the handshake is a part of the request, so that the time limit holds for it
            connection.sock = context.wrap_socket(connection.sock, do_handshake_on_connect=False)
        with _time_limit(connection.sock):
            connection.request("GET", path)
            response = connection.getresponse()
            return response.status, response.read(MAX_BYTES)
    return None


@contextmanager
def _time_limit(connection: socket.socket) -> Iterator[None]:
    """Close the connection after ``TOTAL_SECONDS``."""

    def end() -> None:
        with contextlib.suppress(OSError):
            socket.socket.shutdown(connection, socket.SHUT_RDWR)  # below TLS, which is not thread-safe

    timer = threading.Timer(TOTAL_SECONDS, end)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _parse_health(health: Any) -> RunningInstance | None:
    match health:
        case {"version": str(version), "status": str(status), "interfaces": dict(interfaces)}:
            return RunningInstance(version, status, frozenset(_ports(interfaces)))
    return None


def _ports(interfaces: Mapping[str, Any]) -> Iterator[int]:
    for entry in interfaces.values():
        match entry:
            case {"port": int(port)}:
                yield port
            case {"tcpq": {"url": str(url)}}:
                yield urlsplit(url).port or 0
