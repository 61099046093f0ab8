"""Concurrent clients of the render endpoint, in processes of their own.

They cost little: requests are built beforehand, and sending one takes a few system calls. Each request opens a new
connection, as Drake's client does.
"""

import multiprocessing
import os
import socket
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Barrier
from pathlib import Path

from bench.render_requests import CONTENT_TYPE
from bench.running import tree_of
from bench.viewer import cpu_of

TIMEOUT = 600.0
"""Timeout of connections and of the start of all clients, seconds."""
_FORK = multiprocessing.get_context("fork")  # the clients share the memory of the requests


@dataclass(frozen=True, slots=True)
class LoadResult:
    """Throughput of concurrent clients, and its cost."""

    rate: float
    """Requests per second."""
    server_ms: float
    """CPU time of the server per request."""
    loop_ms: float
    """CPU time of the server's main thread (the event loop) per request."""
    client_ms: float
    """CPU time of the clients per request."""
    others: float
    """Number of cores that other programs used meanwhile."""

    @property
    def busy(self) -> float:
        """Number of cores that server and clients used."""
        return self.rate * (self.server_ms + self.client_ms) / 1e3


def run_clients(port: int, pid: int, bodies: Sequence[bytes], clients: int) -> LoadResult:
    """Send requests to a server from concurrent clients, and wait for all responses.

    Args:
        port: port of the server.
        pid: id of the server's process. Its child processes belong to the server, too.
        bodies: bodies of the requests. Each is sent once.
        clients: number of clients, which share the requests.
    """
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
    before, start = (_cpu_of_server(pid), _cpu_of_main_thread(pid), _cpu_of_machine()), time.perf_counter()
    barrier.wait(TIMEOUT)
    results: list[tuple[float, float, float, int]] = [pipe.recv() for pipe, _ in pipes]
    after, elapsed = (_cpu_of_server(pid), _cpu_of_main_thread(pid), _cpu_of_machine()), time.perf_counter() - start
    for process in processes:
        process.join()
    if failed := sum(failures for *_, failures in results):
        raise SystemExit(f"{failed} requests failed")
    server, loop, machine = (end - begin for begin, end in zip(before, after, strict=True))
    seconds = max(end for _, end, _, _ in results) - min(begin for begin, _, _, _ in results)
    client = sum(cpu for _, _, cpu, _ in results)
    others = max(0.0, machine - server - client) / elapsed
    server_ms, loop_ms, client_ms = (1e3 * cpu / len(bodies) for cpu in (server, loop, client))
    return LoadResult(len(bodies) / seconds, server_ms, loop_ms, client_ms, others)


def _cpu_of_main_thread(pid: int) -> float:
    """Return the CPU seconds of a process's main thread; 0 if the kernel does not count them."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) / 1e9
    except OSError:
        return 0.0


def _cpu_of_server(pid: int) -> float:
    """Return the CPU seconds of the running threads of a process and its descendants.

    They are read from schedstat, or counted in clock ticks if the kernel does not have it.
    """
    nanoseconds = 0
    try:
        for each in tree_of(pid):
            for task in Path(f"/proc/{each}/task").iterdir():
                nanoseconds += int((task / "schedstat").read_text().split()[0])
    except OSError:
        return cpu_of(pid)
    return nanoseconds / 1e9


def _cpu_of_machine() -> float:
    """Return the CPU seconds of all programs of the machine."""
    user, nice, system, _, _, interrupts, soft, stolen = map(
        int, Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]
    )
    return (user + nice + system + interrupts + soft + stolen) / os.sysconf("SC_CLK_TCK")


def _client(port: int, requests: Sequence[bytes], barrier: Barrier, pipe: Connection) -> None:
    """Send requests one after the other: the body of a client's process.

    It sends to ``pipe``: start and end, ``time.perf_counter()``; CPU seconds; number of failed requests.
    """
    response = bytearray(1 << 22)
    barrier.wait(TIMEOUT)  # all clients have started
    barrier.wait(TIMEOUT)  # the parent has read the CPU times
    cpu, begin, failures = time.process_time(), time.perf_counter(), 0
    for request in requests:
        with socket.socket() as connection:
            connection.settimeout(TIMEOUT)
            connection.connect(("127.0.0.1", port))
            connection.sendall(request)
            count = received = connection.recv_into(response)
            while received:
                received = connection.recv_into(memoryview(response)[count:])
                count += received
        failures += response[9:13] != b"200 "  # after "HTTP/1.0 " or "HTTP/1.1 "
    end = time.perf_counter()
    pipe.send((begin, end, time.process_time() - cpu, failures))
    pipe.close()
    os._exit(0)  # without the parent's exit handlers
