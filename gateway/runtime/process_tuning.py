"""What the operating system is asked for when a serving process starts."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import resource
import socket
import sys

from gateway.runtime.scheduling import step_forward

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
"""mallopt parameters, malloc.h of glibc."""
_SWITCH_SECONDS = 0.001
"""For a thread that computes in Python to let the event loop have the interpreter; Python's own 5 ms would be part of
every turn while one decodes or lists."""
_FILES = 65_536
"""Descriptors: one for each HTTP, WebSocket and gRPC connection."""

_RECEIVED = 4 << 20
"""Bytes that a connection may send before anybody reads them: a scene of Drake's comes whole, in a few large pieces. By
itself Linux begins with 64 kB and finds out, for every new connection, while client and event loop wake each other."""


def tune() -> None:
    """Keeps freed pictures' pages, gives the event loop its turn soon and allows many connections; does what the system
    allows, silently."""
    sys.setswitchinterval(_SWITCH_SECONDS)
    step_forward()
    with contextlib.suppress(OSError, AttributeError):  # another libc
        libc = ctypes.CDLL(None)
        # By default blocks of several MB are mapped anew and given back every frame: the page faults cost more than
        # the frame. Raising either threshold alone does not help.
        libc.mallopt(_M_MMAP_THRESHOLD, 1 << 30)
        libc.mallopt(_M_TRIM_THRESHOLD, (1 << 31) - 1)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _FILES if hard == resource.RLIM_INFINITY else min(hard, _FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def return_memory() -> None:
    """Return freed memory to the system, which ``tune`` has the allocator keep; nothing where libc is another one.

    Takes some 0.3 ms per MB. Meanwhile other threads may wait for memory.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def hurry() -> None:
    """Stops the garbage collector until ``settle``: importing makes half a million objects, none of which is garbage,
    and looking at them again and again takes a tenth of the start."""
    gc.disable()


def settle() -> None:
    """Takes what was made at the start out of the garbage collector's sight: its full collections would look at
    half a million objects of imported modules and hold everything for tens of milliseconds."""
    gc.collect()
    gc.freeze()
    gc.enable()


def listen(host: str, port: int) -> socket.socket:
    """A listening TCP socket for ``host``, which may be a name or an IPv6 address.

    Raises:
        OSError: the port is taken, the address is not of this machine, or the name is unknown.
    """
    family, kind, protocol, _, address = socket.getaddrinfo(
        host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    sock = socket.socket(family, kind, protocol)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if _may_receive(family):  # else what the system finds out by itself is more
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVED)
        sock.bind(address)
        sock.listen(2048)
        sock.setblocking(False)
    except OSError:
        sock.close()
        raise
    return sock


def _may_receive(family: int) -> bool:
    """Whether a socket may be told to hold so many bytes; asking is final, and more than allowed is cut silently."""
    with socket.socket(family) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVED)
        return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) >= _RECEIVED


def why_not_listening(error: OSError, host: str, port: int) -> str:
    """The reason as a sentence's end."""
    if isinstance(error, socket.gaierror):
        return f"the host {host!r} is unknown"
    reasons = {98: "another program listens there", 99: f"{host} is no address of this machine", 13: "not allowed to"}
    return reasons.get(error.errno or 0, error.strerror or str(error)) + f" ({host} port {port})"
