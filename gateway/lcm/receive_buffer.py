"""The kernel's receive buffer of LCM's UDP socket: it decides how big a message survives."""

from __future__ import annotations

import socket
import struct
from pathlib import Path
from typing import Final

_RMEM_MAX: Final = Path("/proc/sys/net/core/rmem_max")
_RCVBUFFORCE: Final = 33
"""SO_RCVBUFFORCE (Linux): beyond rmem_max, for those who may administrate the network."""
_MEMINFO: Final = 55
"""SO_MEMINFO (Linux 4.12): nine counters of the socket, the last one of datagrams thrown away."""
_COUNTERS: Final = struct.Struct("9I")


def system_limit() -> int | None:
    """net.core.rmem_max in bytes."""
    try:
        return int(_RMEM_MAX.read_text())
    except (OSError, ValueError):
        return None


class ReceiveBuffer:
    """Of one socket, which somebody else owns."""

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock

    def raise_to(self, size: int) -> int:
        """Asks for ``size`` bytes by every means; returns what the kernel granted, in the same measure."""
        for option in (_RCVBUFFORCE, socket.SO_RCVBUF):
            try:
                self._socket.setsockopt(socket.SOL_SOCKET, option, size)
            except OSError:
                continue
            break
        return self.size()

    def size(self) -> int:
        """Bytes granted; the kernel doubles what was asked for, this is half of that."""
        return self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2

    def lost_datagrams(self) -> int:
        """Datagrams that the kernel threw away because the buffer was full; 0 where it does not tell."""
        try:
            counters = self._socket.getsockopt(socket.SOL_SOCKET, _MEMINFO, _COUNTERS.size)
        except OSError:
            return 0
        return int(_COUNTERS.unpack(counters)[-1]) if len(counters) == _COUNTERS.size else 0
