"""``scenegate serve`` in a process of its own, used over the network."""

import json
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.support.waiting import SECONDS


class GatewayProcess:
    """A running process and its log.

    Args:
        flags: of ``scenegate serve``, or of another command that serves.
        env: environment variables to add.
        command: the command ``scenegate``; by default that of this interpreter.
        name: name of the subcommand.
    """

    def __init__(
        self,
        *flags: str,
        env: dict[str, str] | None = None,
        command: Sequence[str | Path] = (sys.executable, "-m", "scenegate"),
        name: str = "serve",
    ) -> None:
        # Here, since tests/compose/Dockerfile has this module without the package.
        from scenegate.testing.gateway import clean_environment

        self.process = subprocess.Popen(
            [*command, name, *flags],
            env={**clean_environment(), "SCENEGATE_LOG_FORMAT": "json", **(env or {})},
            stderr=subprocess.PIPE,
            text=True,
        )
        self.log: list[dict[str, Any]] = []
        """Events that ``wait_for`` has read."""
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as lines:
            for line in lines:
                self._lines.put(line)
        self._lines.put(None)

    def wait_for(self, event: str, seconds: float = SECONDS) -> dict[str, Any]:
        """Return the next log entry whose event starts with ``event``; fail if the process ends first."""
        while (line := self._line(event, seconds)) is not None:
            try:
                entry: dict[str, Any] = json.loads(line)
            except ValueError:
                entry = {"event": line.rstrip(), "level": "raw"}
            self.log.append(entry)
            if str(entry["event"]).startswith(event):
                return entry
        self._lines.put(None)
        raise AssertionError(f"ended with exit code {self.process.wait()} before {event!r}: {self.log}")

    def _line(self, event: str, seconds: float) -> str | None:
        try:
            return self._lines.get(timeout=seconds)
        except queue.Empty:
            raise AssertionError(f"no {event!r}, and no word for {seconds:g} s: {self.log}") from None

    def rest_of_log(self) -> list[dict[str, Any]]:
        """Return all log entries, once the process has ended."""
        try:
            self.wait_for("\0never")
        except AssertionError:
            pass
        return self.log

    def stop(self) -> int:
        """Send SIGTERM and return the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        return self.process.wait(SECONDS)

    def kill(self) -> None:
        """Kill the process if a failed test has left it running."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._reader.join(SECONDS)


def refused(*flags: str, env: dict[str, str] | None = None) -> tuple[int, list[dict[str, Any]]]:
    """Return the exit code of a gateway that cannot start, and its log after the first line."""
    gateway = GatewayProcess(*flags, env=env)
    try:
        first, *log = gateway.rest_of_log()
        assert first["event"].endswith("starts: loading its libraries")
        return gateway.process.wait(SECONDS), log
    finally:
        gateway.kill()


@contextmanager
def gateway_process(
    *flags: str, env: dict[str, str] | None = None, command: Sequence[str | Path] = (sys.executable, "-m", "scenegate")
) -> Iterator[tuple[GatewayProcess, str]]:
    """Start a gateway on a free port; yield it with its URL."""
    gateway = GatewayProcess("--http-port", "0", *flags, env=env, command=command)
    try:
        url = gateway.wait_for("Scenegate listens")["url"]
        gateway.wait_for("Scenegate has started")
        yield gateway, url
    finally:
        gateway.kill()
