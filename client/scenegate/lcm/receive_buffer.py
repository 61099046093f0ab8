"""Size and losses of a UDP socket's receive buffer in the kernel. ``udpm_transport`` enlarges and reports it.

The kernel drops datagrams while the buffer is full, so its size limits the messages and bursts that arrive complete.
"""

from __future__ import annotations

import socket
import struct
from pathlib import Path
from typing import Final

_RMEM_MAX: Final = Path("/proc/sys/net/core/rmem_max")
"""File with the maximum size of receive buffers, net.core.rmem_max."""
_SO_RCVBUFFORCE: Final = 33
"""Linux option that may exceed net.core.rmem_max; needs CAP_NET_ADMIN."""
_SO_MEMINFO: Final = 55
"""Linux option (4.12 and later) with nine counters of the socket. The last counts dropped datagrams."""
_MEMINFO: Final = struct.Struct("9I")


def system_limit() -> int | None:
    """Return net.core.rmem_max in bytes, or None if it cannot be read."""
    try:
        return int(_RMEM_MAX.read_text())
    except (OSError, ValueError):
        return None


def raise_receive_buffer(sock: socket.socket, size: int) -> int:
    """Request a receive buffer of ``size`` bytes; return the size that the kernel grants."""
    for option in (_SO_RCVBUFFORCE, socket.SO_RCVBUF):
        try:
            sock.setsockopt(socket.SOL_SOCKET, option, size)
        except OSError:
            continue
        break
    return receive_buffer(sock)


def receive_buffer(sock: socket.socket) -> int:
    """Return the size of the receive buffer in bytes. The kernel reports twice the size that was requested."""
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2


def dropped_datagrams(sock: socket.socket) -> int:
    """Return the number of datagrams that a full buffer has dropped; 0 if the kernel does not report it."""
    try:
        counters = sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
    except OSError:
        return 0
    return int(_MEMINFO.unpack(counters)[-1]) if len(counters) == _MEMINFO.size else 0
