"""Open the transport for an LCM URL. The tree viewer's service and ``replay`` call it."""

import os
from typing import Final

from scenegate.lcm.liblcm_transport import LiblcmTransport
from scenegate.lcm.tcpq_transport import TcpqTransport
from scenegate.lcm.transport import MAX_HEADER_BYTES, LcmUnavailableError, Transport, TransportLimits
from scenegate.lcm.udpm_transport import UdpmTransport
from scenegate.lcm.url import OFF, check_lcm_url

WHOLE_NAME: Final = "\0"
"""End of a channel name that is not only the start of one. UDP datagrams have this character after the name."""
DEFAULT_URL: Final = "udpm://239.255.76.67:7667?ttl=0"
"""liblcm's default URL: multicast that stays on this machine."""


def resolve_url(url: str | None) -> str:
    """Return ``url`` or, if it is empty, the environment variable LCM_DEFAULT_URL or liblcm's default."""
    return url or os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL


def channel_pattern(prefixes: tuple[str, ...]) -> str:
    """Return a regular expression of the channels whose names start with a prefix, see ``open_transport``."""
    if not any(prefix.endswith(WHOLE_NAME) for prefix in prefixes):
        return f"{prefixes[0]}.*" if len(prefixes) == 1 else f"({'|'.join(prefixes)}).*"
    names = (prefix[:-1] if prefix.endswith(WHOLE_NAME) else f"{prefix}.*" for prefix in prefixes)
    return f"({'|'.join(names)})"


def open_transport(url: str, prefixes: tuple[str, ...], limits: TransportLimits) -> Transport:
    """Return the transport that connects to the network at ``url``. Raises LcmUnavailableError.

    ``prefixes``: starts of the channel names to receive. One that ends with ``WHOLE_NAME`` is a whole name.
    """
    try:
        check_lcm_url(url)
    except ValueError as error:
        raise LcmUnavailableError(f"LCM cannot join {url}: {error}") from None
    if url == OFF:
        raise LcmUnavailableError(f"LCM is off: the URL {OFF!r} stands for no network")
    max_message = limits.message_bytes + MAX_HEADER_BYTES
    match url.partition(":")[0]:
        case "tcpq":
            return TcpqTransport(url, channel_pattern(prefixes), max_message)
        case "udpm":
            return UdpmTransport(url, prefixes, limits, max_message)
        case _:
            return LiblcmTransport(url, channel_pattern(prefixes), limits.queued_bytes)
