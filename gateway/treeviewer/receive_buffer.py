"""The kernel's receive buffer of LCM's UDP socket: it decides how big a message survives.

liblcm hides its socket, so it is looked for among the process' own files.
"""

from __future__ import annotations

import os
import socket
from pathlib import Path
from typing import Final

_FILES: Final = Path("/proc/self/fd")
_RMEM_MAX: Final = Path("/proc/sys/net/core/rmem_max")
_UDP_TABLE: Final = Path("/proc/net/udp")
_RCVBUFFORCE: Final = 33
"""SO_RCVBUFFORCE (Linux): beyond rmem_max, for those who may administrate the network."""
_DROPS: Final = 12
_INODE: Final = 9
"""Columns of /proc/net/udp."""


def open_files() -> frozenset[int]:
    """The numbers of this process' open files; empty where there is no /proc."""
    try:
        return frozenset(int(name) for name in os.listdir(_FILES))  # noqa: PTH208 - names are all that is wanted
    except OSError:
        return frozenset()


def system_limit() -> int | None:
    """net.core.rmem_max in bytes."""
    try:
        return int(_RMEM_MAX.read_text())
    except (OSError, ValueError):
        return None


class ReceiveBuffer:
    """The UDP sockets bound to ``port`` that appeared since ``before``, through duplicates of their files."""

    def __init__(self, before: frozenset[int], port: int) -> None:
        self._sockets: list[socket.socket] = []
        for number in sorted(open_files() - before):
            try:
                duplicate = socket.socket(fileno=os.dup(number))
            except OSError:
                continue  # not a socket, or closed meanwhile
            if _is_bound_udp(duplicate, port):
                self._sockets.append(duplicate)
            else:
                duplicate.close()

    @property
    def found(self) -> bool:
        return bool(self._sockets)

    def raise_to(self, size: int) -> int:
        """Asks for ``size`` bytes by every means; returns what the kernel granted, in the same measure."""
        for sock in self._sockets:
            for option in (_RCVBUFFORCE, socket.SO_RCVBUF):
                try:
                    sock.setsockopt(socket.SOL_SOCKET, option, size)
                except OSError:
                    continue
                break
        return self.size()

    def size(self) -> int:
        """Bytes granted to the smallest of the sockets; the kernel doubles what was asked for, this is half of that."""
        sizes = [sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2 for sock in self._sockets]
        return min(sizes, default=0)

    def lost_datagrams(self) -> int:
        """Datagrams that the kernel threw away because the buffer was full."""
        try:
            lines = _UDP_TABLE.read_text().splitlines()[1:]
            inodes = {str(os.fstat(sock.fileno()).st_ino) for sock in self._sockets}
        except OSError:
            return 0
        rows = (line.split() for line in lines)
        return sum(int(row[_DROPS]) for row in rows if len(row) > _DROPS and row[_INODE] in inodes)

    def close(self) -> None:
        for sock in self._sockets:
            sock.close()
        self._sockets.clear()


def _is_bound_udp(sock: socket.socket, port: int) -> bool:
    try:
        return sock.family == socket.AF_INET and sock.type == socket.SOCK_DGRAM and sock.getsockname()[1] == port
    except OSError:
        return False
