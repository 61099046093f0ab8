"""Open the transport for an LCM URL. The tree viewer's service and ``replay`` call it."""

from __future__ import annotations

import os
from typing import Final

from gateway.lcm.config import MAX_HEADER_BYTES, LcmConfig
from gateway.lcm.liblcm_transport import LiblcmTransport
from gateway.lcm.tcpq_transport import TcpqTransport
from gateway.lcm.transport import LcmUnavailableError, Transport
from gateway.lcm.udpm_transport import UdpmTransport
from gateway.settings.lcm_url import check_lcm_url

DEFAULT_URL: Final = "udpm://239.255.76.67:7667?ttl=0"
"""liblcm's default URL: multicast that stays on this machine."""


def resolve_url(url: str | None) -> str:
    """Return ``url`` or, if it is empty, the environment variable LCM_DEFAULT_URL or liblcm's default."""
    return url or os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL


def channel_pattern(prefixes: tuple[str, ...]) -> str:
    """Return a regular expression of the channels whose names start with one of ``prefixes``."""
    return f"{prefixes[0]}.*" if len(prefixes) == 1 else f"({'|'.join(prefixes)}).*"


def open_transport(url: str, prefixes: tuple[str, ...], config: LcmConfig) -> Transport:
    """Return the transport that connects to the network at ``url``.

    Args:
        url: LCM URL.
        prefixes: starts of the channel names to receive.
        config: limits.
    Raises:
        LcmUnavailableError: the transport cannot be opened.
    """
    try:
        check_lcm_url(url)
    except ValueError as error:
        raise LcmUnavailableError(f"LCM cannot join {url}: {error}") from None
    max_message = config.message_bytes + MAX_HEADER_BYTES
    match url.partition(":")[0]:
        case "tcpq":
            return TcpqTransport(url, channel_pattern(prefixes), max_message)
        case "udpm":
            return UdpmTransport(url, prefixes, config, max_message)
        case _:
            return LiblcmTransport(url, channel_pattern(prefixes), config.queued_bytes)
