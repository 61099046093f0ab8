"""Limits of the LCM transports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MIB: Final = 1 << 20
MAX_HEADER_BYTES: Final = 1024
"""Bytes of a message that do not count towards ``TransportLimits.message_bytes``: the fields around its payload."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TransportLimits:
    """Limits of a transport."""

    message_bytes: int = 256 * MIB
    """Maximum size of one LCM message; liblcm itself refuses more than 2^28 bytes."""
    receive_buffer_bytes: int = 64 * MIB
    """Receive buffer requested for the UDP socket. Datagrams that do not fit are lost: a 16 MB message needs 64 MB."""
    queued_bytes: int = 1024 * MIB
    """Maximum bytes of received messages that are incomplete or not handled yet. Further messages are dropped."""
    unsent_bytes: int = 64 * MIB
    """Maximum bytes of messages that the UDP socket does not accept yet. Further messages fail."""
