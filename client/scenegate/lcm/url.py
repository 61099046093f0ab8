"""LCM URLs: which are valid, and the parts of ``udpm://`` ones."""

import socket
from dataclasses import dataclass
from typing import Final
from urllib.parse import SplitResult, parse_qsl, urlsplit

SCHEMES: Final = ("udpm", "tcpq", "mpudpm", "memq", "file")
"""Transports by the start of the URL."""
OFF: Final = "off"
"""Stands for no LCM."""
_DEFAULT_ADDRESS: Final = "239.255.76.67"
_DEFAULT_PORT: Final = 7667


@dataclass(frozen=True, slots=True)
class UdpmUrl:
    """Parts of ``udpm://ADDRESS:PORT?ttl=N&recv_buf_size=N``."""

    address: str
    port: int
    ttl: int
    """Maximum number of routers that a datagram passes; 0: it stays on this machine."""
    buffer_bytes: int
    """Size of the receive buffer requested by ``recv_buf_size``; 0: not requested."""
    unknown_options: tuple[str, ...] = ()
    """Names of options that are ignored."""


def check_lcm_url(url: str) -> str:
    """Return an LCM URL, ``off``, or an empty text for the default. Raises ValueError, a clause, if it is invalid."""
    scheme = url.partition("://")[0]
    if url not in ("", OFF) and scheme not in SCHEMES:
        raise ValueError(f"the URL must begin with {', '.join(f'{name}://' for name in SCHEMES)}, or be 'off'")
    if scheme == "udpm":
        parse_udpm_url(url)
    elif scheme == "tcpq":
        _port_of(urlsplit(url))
    return url


def parse_udpm_url(url: str) -> UdpmUrl:
    """Parse a ``udpm://`` URL. Every part is optional. Raises ValueError, a clause, if one is invalid."""
    parts = urlsplit(url)
    address, port = parts.hostname or _DEFAULT_ADDRESS, _port_of(parts)
    try:
        is_multicast = 224 <= socket.inet_aton(address)[0] <= 239
    except OSError:
        is_multicast = False
    if not is_multicast:
        raise ValueError(f"{address} is not a multicast address (224.0.0.0 to 239.255.255.255)")
    numbers = {"ttl": 0, "recv_buf_size": 0}
    unknown = []
    for name, text in parse_qsl(parts.query):
        if name not in numbers:
            unknown.append(name)
            continue
        maximum = 255 if name == "ttl" else 2**31 - 1
        if not (text.isdecimal() and int(text) <= maximum):
            raise ValueError(f"{name} must be a number of 0 to {maximum}, not {text!r}")
        numbers[name] = int(text)
    return UdpmUrl(
        address, _DEFAULT_PORT if port is None else port, numbers["ttl"], numbers["recv_buf_size"], tuple(unknown)
    )


def _port_of(parts: SplitResult) -> int | None:
    try:
        return parts.port
    except ValueError:
        raise ValueError("its port is not a number of 0 to 65535") from None
