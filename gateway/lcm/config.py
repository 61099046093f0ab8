"""Limits of the LCM transports, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MIB: Final = 1 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class LcmConfig:
    """Limits of the LCM transports."""

    message_bytes: int = 256 * MIB
    """Of one LCM message: liblcm itself refuses more than 2^28 bytes."""
    lcm_url: str | None = None
    """None: LCM_DEFAULT_URL, or liblcm's default (udpm://239.255.76.67:7667?ttl=0). ``off``: no LCM."""
    tcpq_host: str = "127.0.0.1"
    """Where the hub for LCM_DEFAULT_URL=tcpq://host:port listens."""
    tcpq_port: int | None = 7700
    """None: no hub; 0: a free port."""
    receive_buffer_bytes: int = 64 * MIB
    """Of LCM's UDP socket: it decides how big a message survives (a 16 MB message wants 64 MB)."""
    waiting_bytes: int = 1024 * MIB
    """Of messages that wait behind big ones, all clients together; beyond it a UDP message is refused."""
    unsent_bytes: int = 64 * MIB
    """Of answers that the UDP network does not take yet; beyond it answers are dropped, and counted."""
    hub_clients: int = 256
    """Connections to the hub."""
    hub_client_send_bytes: int = 512 * MIB
    """Waiting for one slow reader of the hub; beyond it that reader is disconnected, as memory is finite."""
    hub_subscriptions: int = 256
    """Of one hub client."""
