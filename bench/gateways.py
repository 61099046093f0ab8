"""A gateway in a process of its own, and requests to it as Drake's client sends them: a new connection each."""

import json
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.render_requests import CONTENT_TYPE
from scenegate.testing.gateway import clean_environment

TIMEOUT = 600.0


@dataclass(frozen=True, slots=True)
class Answer:
    """Response to a request, and its timing."""

    status: int
    body: bytes
    headers: dict[str, str]
    first: float
    """ms from the last byte of the request to the first of the answer."""
    total: float
    """ms from connecting to the last byte of the answer."""

    @property
    def stages(self) -> dict[str, float]:
        """ms by name, as the server says."""
        pairs = (item.strip().split(";dur=") for item in self.headers.get("server-timing", "").split(",") if item)
        return {name: float(ms) for name, ms in pairs}


def post(port: int, body: bytes, *, pause: float = 0.0) -> Answer:
    """One request.

    Args:
        pause: seconds before the last bytes are sent, in which the server deals with what it has.
    """
    head = f"POST /render HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nAccept: */*\r\nContent-Length: {len(body)}\r\n"
    head += f"Content-Type: {CONTENT_TYPE}\r\nConnection: close\r\n\r\n"
    begin = time.perf_counter()
    with socket.create_connection(("127.0.0.1", port), TIMEOUT) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.sendall(head.encode())
        if pause:
            connection.sendall(memoryview(body)[:-2])
            time.sleep(pause)
            sent = time.perf_counter()
            connection.sendall(body[-2:])
        else:
            connection.sendall(body)
            sent = time.perf_counter()
        pieces = [connection.recv(1 << 20)]
        first = time.perf_counter()
        while pieces[-1]:
            pieces.append(connection.recv(1 << 20))
    total = time.perf_counter() - begin
    text, _, content = b"".join(pieces).partition(b"\r\n\r\n")
    status, *lines = text.decode("latin-1").split("\r\n")
    headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    return Answer(int(status.split()[1]), content, headers, 1e3 * (first - sent), 1e3 * total)


class Gateway:
    """A running ``scenegate serve``."""

    def __init__(
        self,
        *flags: str,
        environment: dict[str, str] | None = None,
        program: tuple[str, ...] = ("-m", "scenegate"),
        build: Path | None = None,
    ) -> None:
        """``build``: folder of another build with its ``.venv``; None: this one."""
        self.began = time.perf_counter()
        python = sys.executable if build is None else str(build / ".venv/bin/python")
        self.process = subprocess.Popen(
            [python, *program, "serve", "--http-port", "0", *flags],
            cwd=build,
            env={
                **clean_environment(),
                "SCENEGATE_LOG_FORMAT": "json",
                "SCENEGATE_LOG_LEVEL": "info",
                **(environment or {}),
            },
            stderr=subprocess.PIPE,
            text=True,
        )
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        url = str(self._wait_for("Scenegate listens")["url"])
        self.port = int(url.rpartition(":")[2])
        self._wait_for("Scenegate has started")
        self.started = time.perf_counter()

    def _read(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as lines:
            for line in lines:
                self._lines.put(line)
        self._lines.put(None)

    def _wait_for(self, event: str) -> dict[str, object]:
        said = []
        while (line := self._lines.get(timeout=TIMEOUT)) is not None:
            said.append(line)
            try:
                entry = json.loads(line)
            except ValueError:
                continue
            if isinstance(entry, dict) and str(entry.get("event", "")).startswith(event):
                return entry
        raise SystemExit(f"the gateway ended with {self.process.wait()}: {''.join(said)}")

    def interface(self, name: str) -> dict[str, Any]:
        """Return the entry of an interface in ``/healthz``."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/healthz", timeout=TIMEOUT) as response:
            entry: dict[str, Any] = json.load(response)["interfaces"][name]
        return entry

    def rss(self) -> float:
        """Resident memory, MB."""
        pages = int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    def stop(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        self.process.wait()
        self._reader.join()


@contextmanager
def gateway(*flags: str, environment: dict[str, str] | None = None) -> Iterator[Gateway]:
    """A gateway that has started."""
    running = Gateway(*flags, environment=environment)
    try:
        yield running
    finally:
        running.stop()
