"""The kernel's receive buffer of a UDP socket, which limits the size of messages and bursts that arrive."""

from __future__ import annotations

import socket
import struct
from pathlib import Path
from typing import Final

_RMEM_MAX: Final = Path("/proc/sys/net/core/rmem_max")
_SO_RCVBUFFORCE: Final = 33
"""Linux: exceeds rmem_max, with CAP_NET_ADMIN."""
_SO_MEMINFO: Final = 55
"""Linux 4.12: nine counters of the socket; the last one counts dropped datagrams."""
_MEMINFO: Final = struct.Struct("9I")


def system_limit() -> int | None:
    """Return net.core.rmem_max in bytes, or None where it cannot be read."""
    try:
        return int(_RMEM_MAX.read_text())
    except (OSError, ValueError):
        return None


def raise_receive_buffer(sock: socket.socket, size: int) -> int:
    """Request ``size`` bytes and return the size granted."""
    for option in (_SO_RCVBUFFORCE, socket.SO_RCVBUF):
        try:
            sock.setsockopt(socket.SOL_SOCKET, option, size)
        except OSError:
            continue
        break
    return receive_buffer(sock)


def receive_buffer(sock: socket.socket) -> int:
    """Return the size in bytes as it was requested; the kernel reports twice that."""
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2


def dropped_datagrams(sock: socket.socket) -> int:
    """Return the number of datagrams dropped because the buffer was full; 0 where the kernel does not report it."""
    try:
        counters = sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
    except OSError:
        return 0
    return int(_MEMINFO.unpack(counters)[-1]) if len(counters) == _MEMINFO.size else 0
