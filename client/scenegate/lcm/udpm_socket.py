"""The sockets of a multicast group, for ``udpm_transport``: their options, receive buffer, arrival times and addresses.

The kernel drops datagrams while the receive buffer is full, so its size limits the messages and bursts that arrive
complete.
"""

import array
import contextlib
import errno
import logging
import os
import select
import socket
import struct
import sys
import time
from pathlib import Path
from typing import Final

from scenegate.lcm import udpm
from scenegate.lcm.transport import LcmUnavailableError
from scenegate.lcm.url import UdpmUrl

_log = logging.getLogger("scenegate.lcm")

ROUTE_COMMANDS: Final = "sudo ip link set lo multicast on; sudo ip route add 224.0.0.0/4 dev lo"
"""Commands that let multicast pass between the programs of one machine without a network."""
HUB_OPTION: Final = "--lcm-url tcpq://127.0.0.1:7700"
"""Option with which commands reach the hub of a gateway on this machine, without multicast."""
ROUTE_HINT: Final = (
    f"there may be no route for multicast; on one machine, add one: {ROUTE_COMMANDS}; "
    f"or, without root, use the hub of a gateway: {HUB_OPTION}"
)
SELF_TEST_CHANNEL: Final = b"LCM_SELF_TEST"
"""Channel of liblcm's own self test."""
SELF_TEST_SECONDS: Final = 2.0
"""Maximum time for a datagram to come back."""
_SIOCGIFCONF: Final = 0x8912
"""Linux's request for the addresses of all interfaces, see netdevice(7)."""
_IFREQ_BYTES: Final = 40
"""Size of a ``struct ifreq``: 16 bytes of the interface's name, then a ``struct sockaddr_in``."""
_ADDRESS_OFFSET: Final = 20
"""Offset of the IPv4 address in a ``struct ifreq``."""
_MAX_ADDRESSES: Final = 4096
"""Maximum number of addresses that are listed."""
_TIMESTAMPS: Final = 35
"""Socket option SO_TIMESTAMPNS of Linux, which Python's ``socket`` lacks, and type of its control messages."""
_TIMESPEC: Final = struct.Struct("@ll")
_CONTROL_BYTES: Final = 0 if sys.platform == "win32" else socket.CMSG_SPACE(_TIMESPEC.size)
_RMEM_MAX: Final = Path("/proc/sys/net/core/rmem_max")
"""File with the maximum size of receive buffers, net.core.rmem_max."""
_SO_RCVBUFFORCE: Final = 33
"""Linux option that may exceed net.core.rmem_max; needs CAP_NET_ADMIN."""
_SO_MEMINFO: Final = 55
"""Linux option (4.12 and later) with nine counters: the first of bytes to read, the last of dropped datagrams."""
_MEMINFO: Final = struct.Struct("9I")


def receive_socket(url: str, network: UdpmUrl) -> socket.socket:
    """Return a non-blocking socket that has joined the group. Raises LcmUnavailableError: port taken, or no route."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if sys.platform == "darwin":
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        enable_timestamps(sock)
        sock.bind(("" if sys.platform == "win32" else network.address, network.port))
        group = struct.pack("4s4s", socket.inet_aton(network.address), bytes(4))
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    except OSError as error:
        sock.close()
        port_in_use = f"another program keeps port {network.port} for itself"
        reason = {errno.EADDRINUSE: port_in_use, errno.ENODEV: ROUTE_HINT}.get(error.errno or 0, str(error.strerror))
        raise LcmUnavailableError(f"LCM cannot join {url}: {reason}") from None
    return sock


def enable_timestamps(sock: socket.socket) -> None:
    """Let the system record the arrivals of datagrams, for ``receive``. Does nothing where it cannot."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, _TIMESTAMPS, 1)


def receive(sock: socket.socket, max_bytes: int) -> tuple[bytes, tuple[str, int], int]:
    """Return a datagram, its sender, and its arrival at the socket, nanoseconds since the epoch. Raises OSError."""
    if sys.platform == "win32":
        datagram, sender = sock.recvfrom(max_bytes)
        return datagram, sender, time.time_ns()
    datagram, control, _, sender = sock.recvmsg(max_bytes, _CONTROL_BYTES)
    for level, kind, data in control:
        if (level, kind, len(data)) == (socket.SOL_SOCKET, _TIMESTAMPS, _TIMESPEC.size):
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            return datagram, sender, seconds * 1_000_000_000 + nanoseconds
    return datagram, sender, time.time_ns()


def send_socket(network: UdpmUrl) -> socket.socket:
    """Return a non-blocking socket for sending. Its multicast datagrams also reach receivers on this machine."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, network.ttl)
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    sock.setblocking(False)
    return sock


def check_route(url: str, network: UdpmUrl, receiver: socket.socket, sender: socket.socket) -> None:
    """Send a datagram to the multicast group, and wait until it arrives. Raises LcmUnavailableError if it does not."""
    deadline = time.monotonic() + SELF_TEST_SECONDS
    datagram = b"".join((udpm.SHORT_MAGIC, os.urandom(4), SELF_TEST_CHANNEL, b"\0lcm self test"))
    while time.monotonic() < deadline:
        try:
            sender.sendto(datagram, (network.address, network.port))
        except OSError:
            raise LcmUnavailableError(f"LCM cannot join {url}: {ROUTE_HINT}") from None
        while select.select([receiver], [], [], 0.1)[0]:
            if receiver.recv(udpm.MAX_DATAGRAM_BYTES) == datagram:
                return
    raise LcmUnavailableError(
        f"LCM cannot join {url}: what is sent there does not come back, a route or a firewall is in the way"
    )


def own_addresses(sock: socket.socket) -> frozenset[str]:
    """Return the IPv4 addresses of this machine's interfaces, by any socket."""
    if sys.platform != "linux":
        return frozenset(socket.gethostbyname_ex(socket.gethostname())[2])
    import fcntl

    buffer = array.array("B", bytes(_MAX_ADDRESSES * _IFREQ_BYTES))
    address, size = buffer.buffer_info()
    size, _ = struct.unpack("iP", fcntl.ioctl(sock, _SIOCGIFCONF, struct.pack("iP", size, address)))
    starts = range(_ADDRESS_OFFSET, size, _IFREQ_BYTES)
    return frozenset(socket.inet_ntoa(buffer[start : start + 4].tobytes()) for start in starts)


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
    return _counters(sock)[-1]


def unread_bytes(sock: socket.socket) -> int:
    """Return the memory of the datagrams in the receive buffer, in bytes; 0 if the kernel does not report it."""
    return _counters(sock)[0]


def _counters(sock: socket.socket) -> tuple[int, ...]:
    """Return the counters of ``_SO_MEMINFO``, or zeros."""
    try:
        counters = sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
    except OSError:
        counters = b""
    return _MEMINFO.unpack(counters if len(counters) == _MEMINFO.size else bytes(_MEMINFO.size))
