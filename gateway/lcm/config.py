"""Settings of the LCM transports. ``gateway.wiring`` fills them from the options."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MIB: Final = 1 << 20
MAX_HEADER_BYTES: Final = 1024
"""Bytes of a message that do not count towards ``LcmConfig.message_bytes``: the fields around its payload."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LcmConfig:
    """Addresses and limits of the LCM transports."""

    url: str | None = None
    """LCM URL. None: LCM_DEFAULT_URL, or liblcm's default udpm://239.255.76.67:7667?ttl=0. ``off``: no LCM."""
    tcpq_host: str = "127.0.0.1"
    """Address on which the TCPQ hub listens."""
    tcpq_port: int | None = 7700
    """Port of the TCPQ hub. None: no hub; 0: a free port."""
    message_bytes: int = 256 * MIB
    """Maximum size of one LCM message; liblcm itself refuses more than 2^28 bytes."""
    receive_buffer_bytes: int = 64 * MIB
    """Receive buffer requested for the UDP socket. Datagrams that do not fit are lost: a 16 MB message needs 64 MB."""
    queued_bytes: int = 1024 * MIB
    """Maximum bytes of received messages that are incomplete or not handled yet. Further messages are dropped."""
    unsent_bytes: int = 64 * MIB
    """Maximum bytes of messages that the UDP socket does not accept yet. Further messages fail."""
    hub_clients: int = 256
    """Maximum number of connections to the hub."""
    hub_client_send_bytes: int = 512 * MIB
    """Maximum bytes queued for one client of the hub. A client that reads too slowly is disconnected."""
    hub_subscriptions: int = 256
    """Maximum number of subscriptions of one hub client."""
