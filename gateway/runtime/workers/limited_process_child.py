"""Program that ``limited_process`` starts: imports parsers, and forks a limited child process for each call.

    python limited_process_child.py DESCRIPTOR

The descriptor is a Unix socket. A request with a descriptor is ``module memory_bytes seconds``: the response is the
process id of a child process, which serves one call over that descriptor. A request without one is a process id: the
child process is killed, and the response is the signal that ended it. When the socket closes, because the program that
started this one has ended, all child processes are killed.

It imports nothing of this project but the modules in requests, and has no threads, which a fork would not copy.
"""

import contextlib
import ctypes
import gc
import importlib
import os
import resource
import signal
import socket
import struct
import sys
from io import BufferedRWPair
from pathlib import Path
from typing import Any, Final, NoReturn

import msgspec

NICENESS: Final = 5
"""Niceness of child processes: a third of the share of a CPU that the event loop's thread has."""
CALL, DATA, ERROR = b"C", b"D", b"E"
"""Kinds of messages to the child: the call (MessagePack); a file that it needs; the reason why there is none."""
FILE, RESULT = b"F", b"R"
"""Kinds of messages from the child: the name of a file that it needs; the result of the call (MessagePack)."""
_HEADER: Final = struct.Struct("<cQ")
"""Start of a message: its kind, and the length of its body in bytes."""
_PR_SET_PDEATHSIG: Final = 1


def limit_this_process(memory_bytes: int, seconds: int) -> None:
    """Limit address space and CPU time of this process, and forbid it to write files.

    ``memory_bytes`` are those beyond what the process has now.
    """
    limits = {
        resource.RLIMIT_CPU: (seconds, seconds + 1),  # SIGXCPU at the first, SIGKILL at the second
        resource.RLIMIT_FSIZE: (0, 0),
        resource.RLIMIT_CORE: (0, 0),
    }
    with contextlib.suppress(OSError):  # macOS has no such file, and refuses limits on memory
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        limits[resource.RLIMIT_AS] = (used + memory_bytes, used + memory_bytes)
    for limit, values in limits.items():
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(limit, values)


def send_message(stream: BufferedRWPair, kind: bytes, body: bytes) -> None:
    """Send a message. One of 30 MB takes 15 ms less than with ``multiprocessing.connection``."""
    stream.write(_HEADER.pack(kind, len(body)))
    stream.write(body)
    stream.flush()


def receive_message(stream: BufferedRWPair, max_bytes: int = sys.maxsize) -> tuple[bytes, bytes]:
    """Return kind and body of the next message. Raises EOFError at the end, or beyond ``max_bytes``."""
    header = stream.read(_HEADER.size)
    if len(header) < _HEADER.size:
        raise EOFError
    kind, size = _HEADER.unpack(header)
    if size > max_bytes or len(body := stream.read(size)) < size:
        raise EOFError
    return kind, body


def serve_call(stream: BufferedRWPair, module: Any) -> None:
    """Receive one call, and send its result."""

    def read_file(name: str) -> bytes:
        send_message(stream, FILE, name.encode("utf-8", "replace"))
        kind, body = receive_message(stream)
        if kind == ERROR:
            raise OSError(body.decode())
        return body

    name, arguments = msgspec.msgpack.decode(receive_message(stream)[1])
    result = getattr(module, name)(read_file, *arguments)
    send_message(stream, RESULT, msgspec.msgpack.encode(result))


def run_child(descriptor: int, module: Any, memory_bytes: int, seconds: int) -> NoReturn:
    """Serve one call in this process, which was just forked, and end it."""
    status = 1
    try:
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        limit_this_process(memory_bytes, seconds)
        with socket.socket(fileno=descriptor) as connection:
            serve_call(connection.makefile("rwb"), module)
        status = 0
    finally:
        os._exit(status)


def serve(control: socket.socket) -> None:
    """Respond to requests until the socket is closed."""
    children: set[int] = set()
    try:
        while True:
            request, descriptors, _, _ = socket.recv_fds(control, 4096, 1)
            if not request:
                return
            if not descriptors:
                pid = int(request)
                os.kill(pid, signal.SIGKILL)
                children.discard(pid)
                control.send(str(os.waitpid(pid, 0)[1] & 0x7F).encode())
                continue
            name, memory_bytes, seconds = request.decode().split()
            try:
                module = importlib.import_module(name)
                gc.freeze()  # a collection in a child process would copy all memory pages of the imported modules
                pid = os.fork()
            except (ImportError, OSError) as error:
                control.send(f"no process for {name}: {error}".encode())
            else:
                if pid == 0:
                    control.close()
                    run_child(descriptors[0], module, int(memory_bytes), int(seconds))
                children.add(pid)
                control.send(str(pid).encode())
            os.close(descriptors[0])
    finally:
        for pid in children:
            os.kill(pid, signal.SIGKILL)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the program that started this one ends it
    os.setpriority(os.PRIO_PROCESS, 0, max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0)))
    sys.path.append(str(Path(__file__).parents[3]))
    serve(socket.socket(fileno=int(sys.argv[1])))
