"""Joining an LCM network by its URL."""

from __future__ import annotations

import os
from typing import Final

from gateway.lcm.config import LcmConfig
from gateway.lcm.liblcm_transport import LcmBus
from gateway.lcm.tcpq_transport import TcpqBus
from gateway.lcm.udpm_transport import UdpmBus

DEFAULT_URL: Final = "udpm://239.255.76.67:7667?ttl=0"
"""liblcm's own."""
Bus = LcmBus | UdpmBus | TcpqBus


def url_of(given: str | None) -> str:
    """The URL that is meant: what was given, LCM_DEFAULT_URL, or LCM's default."""
    return given or os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL


def join(url: str, prefix: str, config: LcmConfig) -> Bus:
    """A place on the network, for channels that begin with ``prefix``.

    Raises:
        LcmUnavailable: with the reason in one sentence.
    """
    most = config.message_bytes + 1024
    match url.partition(":")[0]:
        case "tcpq":
            return TcpqBus(url, f"{prefix}.*", most)
        case "udpm":
            return UdpmBus(url, prefix, config.receive_buffer_bytes, config.waiting_bytes, most, config.unsent_bytes)
        case _:
            return LcmBus(url, f"{prefix}.*", config.waiting_bytes)
