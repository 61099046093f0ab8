"""Clients of the render endpoint in processes of their own, as cheap as Python has them: requests are made before, each
is a handful of system calls on a new connection, as Drake's client has it."""

from __future__ import annotations

import multiprocessing
import os
import socket
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Barrier
from pathlib import Path

from bench.posted import CONTENT_TYPE
from bench.running import tree_of
from bench.viewer import cpu_of

TIMEOUT = 600.0
_FORK = multiprocessing.get_context("fork")  # the requests are there already


@dataclass(frozen=True, slots=True)
class Crowded:
    """Throughput of concurrent clients, and its cost."""

    rate: float
    """Requests a second."""
    server_ms: float
    """CPU time a request."""
    loop_ms: float
    """CPU time of the server's main thread (the event loop) per request."""
    client_ms: float

    others: float
    """Processors that other programs used meanwhile."""

    @property
    def busy(self) -> float:
        """Processors in use, by server and clients."""
        return self.rate * (self.server_ms + self.client_ms) / 1e3


def crowd(port: int, pid: int, bodies: Sequence[bytes], clients: int) -> Crowded:
    """So many clients share the requests, each of which is sent once, to the server with this process number."""
    head = f"POST /render HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nAccept: */*\r\nContent-Type: {CONTENT_TYPE}\r\n"
    head += "Connection: close\r\nContent-Length: "
    requests = [f"{head}{len(body)}\r\n\r\n".encode() + body for body in bodies]
    barrier = _FORK.Barrier(clients + 1)
    pipes = [_FORK.Pipe(duplex=False) for _ in range(clients)]
    processes = [
        _FORK.Process(target=_client, args=(port, requests[number::clients], barrier, pipe), daemon=True)
        for number, (_, pipe) in enumerate(pipes)
    ]
    for process in processes:
        process.start()
    barrier.wait(TIMEOUT)
    before, loop, everybody, began = _spent(pid), _first(pid), _everybody(), time.perf_counter()
    barrier.wait(TIMEOUT)
    told: list[tuple[float, float, float, int]] = [pipe.recv() for pipe, _ in pipes]
    spent, loop = _spent(pid) - before, _first(pid) - loop
    everybody, whole = _everybody() - everybody, time.perf_counter() - began
    for process in processes:
        process.join()
    if failed := sum(failures for *_, failures in told):
        raise SystemExit(f"{failed} requests failed")
    seconds = max(end for _, end, _, _ in told) - min(begin for begin, _, _, _ in told)
    own = sum(cpu for _, _, cpu, _ in told)
    others = max(0.0, everybody - spent - own) / whole
    server_ms, loop_ms, client_ms = (1e3 * each / len(bodies) for each in (spent, loop, own))
    return Crowded(len(bodies) / seconds, server_ms, loop_ms, client_ms, others)


def _first(pid: int) -> float:
    """CPU seconds of a process's first thread; 0 where the kernel does not say."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) / 1e9
    except OSError:
        return 0.0


def _spent(pid: int) -> float:
    """CPU seconds of a process and all below it, to the microsecond where the kernel says; of threads that live."""
    nanoseconds = 0
    try:
        for each in tree_of(pid):
            for task in Path(f"/proc/{each}/task").iterdir():
                nanoseconds += int((task / "schedstat").read_text().split()[0])
    except OSError:  # a kernel without these figures; clock ticks then
        return cpu_of(pid)
    return nanoseconds / 1e9


def _everybody() -> float:
    """CPU seconds of all programs of the machine."""
    user, nice, system, _, _, interrupts, soft, stolen = map(
        int, Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]
    )
    return (user + nice + system + interrupts + soft + stolen) / os.sysconf("SC_CLK_TCK")


def _client(port: int, requests: Sequence[bytes], barrier: Barrier, pipe: Connection) -> None:
    answer = bytearray(1 << 22)
    barrier.wait(TIMEOUT)  # everybody is there
    barrier.wait(TIMEOUT)  # the server's clock is read
    cpu, begin, failures = time.process_time(), time.perf_counter(), 0
    for request in requests:
        with socket.socket() as connection:
            connection.settimeout(TIMEOUT)
            connection.connect(("127.0.0.1", port))
            connection.sendall(request)
            count = got = connection.recv_into(answer)
            while got:
                got = connection.recv_into(memoryview(answer)[count:])
                count += got
        failures += answer[9:13] != b"200 "  # behind HTTP/1.0 or HTTP/1.1
    end = time.perf_counter()
    pipe.send((begin, end, time.process_time() - cpu, failures))
    pipe.close()
    os._exit(0)  # what the parent has open is the parent's
