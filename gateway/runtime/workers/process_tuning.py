"""Settings of a serving process: allocator, thread scheduling, garbage collection, descriptors and sockets."""

import contextlib
import ctypes
import errno
import gc
import multiprocessing
import os
import resource
import signal
import socket
import sys

from gateway.runtime.workers.scheduling import prefer_this_thread

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
"""mallopt parameters, malloc.h of glibc."""
_PR_SET_PDEATHSIG = 1
"""prctl option, linux/prctl.h."""
_SWITCH_SECONDS = 0.001
"""Time after which a thread that runs Python code releases the GIL for the event loop; the default of 5 ms would delay
every request while another is parsed."""
_WANTED_FILES = 65_536
"""File descriptors: one per HTTP, WebSocket and gRPC connection."""
_TCP_BUFFER_BYTES = 4 << 20
"""Receive buffer of a connection in bytes: a scene arrives in a few large reads. Linux' automatic size starts at 64 kB
for every connection and grows in steps, each of which wakes client and event loop once more."""
_MMAP_THRESHOLDS = (1 << 30, 32 << 20)
"""Sizes in bytes from which allocations are mapped, largest first; glibc before 2.35 accepts no more than 32 MB."""

MIN_ADDRESSES = 900 << 20
"""Bytes of address space below which libraries abort the process while the interfaces start."""


def address_space_problem() -> str:
    """Return a sentence if the address space is limited to less than ``MIN_ADDRESSES``; else an empty text."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY or limit >= MIN_ADDRESSES:
        return ""
    needed = f"at least {MIN_ADDRESSES >> 20} MB are needed: ulimit -v unlimited"
    return f"the address space is limited to {limit >> 20} MB, {needed}"


def tune() -> None:
    """Keep freed memory, prefer the event loop's thread, and allow many connections, as far as the system does."""
    # Child processes that compile kernels never use gRPC; its fork handlers would only write to stderr.
    os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "false")
    sys.setswitchinterval(_SWITCH_SECONDS)
    prefer_this_thread()
    with contextlib.suppress(OSError, AttributeError):  # another libc
        libc = ctypes.CDLL(None)
        # By default blocks of several MB are mapped and unmapped for every frame, and the page faults take longer than
        # rendering. Raising either threshold alone has no effect.
        for size in _MMAP_THRESHOLDS:
            if libc.mallopt(_M_MMAP_THRESHOLD, size):  # accepted
                break
        libc.mallopt(_M_TRIM_THRESHOLD, (1 << 31) - 1)
        # The arenas of other threads map blocks of more than 64 MB, and unmap every heap that gets empty. With one
        # arena for all, a frame of a million triangles takes 20 ms in a worker thread instead of 52.
        libc.mallopt(_M_ARENA_MAX, 1)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = _WANTED_FILES if hard == resource.RLIM_INFINITY else min(hard, _WANTED_FILES)
    if soft != resource.RLIM_INFINITY and soft < limit:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard))


def end_with_parent() -> None:
    """Send this process SIGTERM when its parent ends, even by SIGKILL (Linux only), or at once if it has ended.

    Call this in a process that the main thread of its parent has started by ``multiprocessing``, with spawn or fork:
    Linux watches the thread, and a fork server is no parent.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    parent = multiprocessing.parent_process()
    if parent is not None and os.getppid() != parent.pid:
        os.kill(os.getpid(), signal.SIGTERM)


def return_memory() -> None:
    """Return the freed memory that the allocator keeps since ``tune`` to the system (glibc only).

    Takes about 0.3 ms per MB, in which other threads wait for memory: all share one arena.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def pause_gc() -> None:
    """Stop the garbage collector until ``freeze_gc``: imports make half a million objects and no garbage, and scanning
    them takes a tenth of the start."""
    gc.disable()


def freeze_gc() -> None:
    """Exclude all existing objects from garbage collection: scanning half a million objects of imported modules would
    stop all threads for tens of milliseconds."""
    gc.freeze()
    gc.enable()


def listen(host: str, port: int) -> socket.socket:
    """Return a listening TCP socket. ``host``: name or address, IPv4 or IPv6.

    Raises OSError if the port is in use, the address does not belong to this machine, or the name is unknown.
    """
    family, kind, protocol, _, address = socket.getaddrinfo(
        host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    sock = socket.socket(family, kind, protocol)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if _allows_large_buffers(family):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _TCP_BUFFER_BYTES)
        sock.bind(address)
        sock.listen(2048)
        sock.setblocking(False)
    except OSError:
        sock.close()
        raise
    return sock


def _allows_large_buffers(family: int) -> bool:
    """Return whether the system allows ``_TCP_BUFFER_BYTES``.

    It reduces larger sizes silently, and any fixed size turns the automatic one off, which may be larger.
    """
    with socket.socket(family) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _TCP_BUFFER_BYTES)
        # Linux doubles the size for its own bookkeeping.
        return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) >= 2 * _TCP_BUFFER_BYTES


def listen_error(error: OSError, host: str, port: int) -> str:
    """Return the reason for a failure of ``listen``, without a full stop."""
    if isinstance(error, socket.gaierror):
        return f"the host {host!r} is unknown"
    reasons = {
        errno.EADDRINUSE: "another program listens there",
        errno.EADDRNOTAVAIL: f"{host} is not an address of this machine",
        errno.EACCES: "permission denied",
    }
    return reasons.get(error.errno or 0, error.strerror or str(error)) + f" ({host} port {port})"
