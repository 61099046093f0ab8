"""Open the transport for an LCM URL."""

from __future__ import annotations

import os
from typing import Final

from gateway.lcm.config import LcmConfig
from gateway.lcm.liblcm_transport import LiblcmTransport
from gateway.lcm.tcpq_transport import TcpqTransport
from gateway.lcm.transport import Transport
from gateway.lcm.udpm_transport import UdpmTransport

DEFAULT_URL: Final = "udpm://239.255.76.67:7667?ttl=0"
"""liblcm's default."""
HEADER_BYTES: Final = 1024
"""Allowance for an LCM type's header around ``LcmConfig.message_bytes`` of payload."""


def resolve_url(url: str | None) -> str:
    """Return ``url``, or else LCM_DEFAULT_URL, or else LCM's default."""
    return url or os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL


def open_transport(url: str, prefix: str, config: LcmConfig) -> Transport:
    """Join a network, to receive the channels that start with ``prefix``.

    Raises:
        LcmUnavailableError: with the reason in one sentence.
    """
    max_message = config.message_bytes + HEADER_BYTES
    match url.partition(":")[0]:
        case "tcpq":
            return TcpqTransport(url, f"{prefix}.*", max_message)
        case "udpm":
            return UdpmTransport(url, prefix, config, max_message)
        case _:
            return LiblcmTransport(url, f"{prefix}.*", config.queued_bytes)
