"""Requests to a gateway's HTTP port, with its token and certificates. Every error is one sentence."""

import http.client
import json
import socket
import ssl
from typing import Final, NamedTuple
from urllib.parse import urlencode, urlsplit

from scenegate.credentials import Credentials

CONNECT_SECONDS: Final = 10.0
"""Timeout of the connection to a gateway."""
FETCH_SECONDS: Final = 300.0
"""Timeout of a whole file. A minute of a large scene takes seconds; others may wait before it."""
_MAX_ERROR_BYTES: Final = 10_000
"""Maximum bytes that are read of an error response."""


class GatewayError(ConnectionError):
    """A gateway does not respond, or has ended a connection; the message is one sentence."""


class GatewayRequestError(GatewayError, ValueError):
    """A request is wrong: its address, token or a parameter is invalid, or something does not exist."""


class GatewayAddress(NamedTuple):
    """Address of a gateway's HTTP port."""

    host: str
    port: int | None
    path: str
    """Path of the gateway behind a proxy; empty, or ``/name``."""
    context: ssl.SSLContext | None
    """TLS context; None: the connection is not encrypted."""


def parse_address(address: str, credentials: Credentials) -> GatewayAddress:
    """Parse the address of a gateway, ``http://HOST:PORT``, or of its page. Raises OSError for a certificate.

    Raises GatewayRequestError if it is invalid, or is not encrypted although the credentials want that.
    """
    try:
        url = urlsplit(address.partition("#")[0].partition("?")[0])
        port = url.port
    except ValueError as error:
        raise GatewayRequestError(f"the address of the gateway, {address!r}, is invalid: {error}") from None
    if url.scheme not in ("http", "https") or not url.hostname:
        raise GatewayRequestError(f"the address of the gateway is {address!r}; it must be like http://HOST:PORT")
    if url.scheme == "http" and credentials.is_encrypted:
        raise GatewayRequestError(f"{address}: --tls, --ca and --certificate need an address with https://")
    path = url.path.rstrip("/").removesuffix("/view")
    return GatewayAddress(url.hostname, port, path, credentials.context() if url.scheme == "https" else None)


def fetch(
    address: str, path: str, credentials: Credentials, wanted: str, timeout: float = FETCH_SECONDS, **query: object
) -> bytes:
    """Return the body of the response to ``GET path`` of a gateway, ``http://HOST:PORT``, or of its page.

    ``wanted``: what the response has, for errors. ``timeout``: seconds for the connection, and for each part of the
    response. ``query``: parameters; None: left out. Raises GatewayRequestError if the gateway refuses the request,
    GatewayError if it does not respond, or OSError for a certificate.
    """
    host, port, prefix, context = parse_address(address, credentials)
    connection = (
        http.client.HTTPConnection(host, port, timeout=timeout)
        if context is None
        else http.client.HTTPSConnection(host, port, timeout=timeout, context=context)
    )
    parameters = urlencode({key: value for key, value in query.items() if value is not None})
    target = f"{prefix}/{path}" + (f"?{parameters}" if parameters else "")
    try:
        connection.request("GET", target, headers=dict(credentials.metadata))
        with connection.getresponse() as response:
            if response.status == http.client.OK:
                return response.read()
            refusal = _refusal(response)
    except (OSError, http.client.HTTPException) as error:
        raise GatewayError(f"{address} gives no {wanted}: {reason_of(error)}") from None
    finally:
        connection.close()
    raise GatewayRequestError(f"{address} gives no {wanted}: {response.status}: {refusal}")


def reason_of(error: Exception) -> str:
    """Return why a gateway does not respond, as a clause without the numbers of the operating system."""
    match error:
        case TimeoutError():
            return "no response in time; a gateway that starts answers after its kernels are compiled"
        case ConnectionRefusedError():
            return "no gateway listens there"
        case ConnectionResetError() | http.client.IncompleteRead():
            return "the connection was closed"
        case socket.gaierror():
            return "the host is unknown"
        case ssl.SSLCertVerificationError():
            return f"its certificate is not accepted: {error.verify_message}"
        case ssl.SSLError():
            return f"it does not speak TLS, or refuses this client's certificate ({error.reason})"
        case OSError(strerror=str(text)):
            return text[:1].lower() + text[1:]
        case http.client.HTTPException():
            return "it does not speak HTTP"
        case _:
            return str(error) or type(error).__name__


def _refusal(response: http.client.HTTPResponse) -> str:
    """Return the message of an error response, its first line, or the reason phrase of HTTP."""
    text = ""
    try:
        text = response.read(_MAX_ERROR_BYTES).decode("utf-8", "replace")
        return str(json.loads(text)["message"])
    except (OSError, ValueError, KeyError, TypeError, http.client.HTTPException):
        return text.strip().partition("\n")[0] or response.reason
