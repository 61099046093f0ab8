"""A gateway as a process of its own, for tests."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from gateway.testing.publish import publish, scene_request

STOP_SECONDS: Final = 30.0
"""After SIGTERM; then it is killed."""
LOG_CHARS: Final = 20_000
"""Of the log that a failed test shows, from its end."""
_FLAGS: Final = ("--http-port", "0", "--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", "off", "--log-format", "json")
"""First, so that those of the tests win."""


def clean_environment() -> dict[str, str]:
    """Of this process: settings of the shell that runs the tests are not meant for them, places of caches are."""
    return {n: v for n, v in os.environ.items() if not n.startswith("SCENEGATE_") or n == "SCENEGATE_CACHE_DIR"}


class Gateway:
    """A running gateway; what tests need to reach it."""

    def __init__(self, flags: tuple[str, ...], folder: Path, seconds: float) -> None:
        """Starts it and waits until every interface has started or failed.

        Args:
            flags: of ``scenegate serve``.
            folder: for its log.
            seconds: to start in.

        Raises:
            RuntimeError: it ended or took too long; with its log.
        """
        self.log_path = folder / "gateway.log"
        """One JSON object a line."""
        with self.log_path.open("wb") as log:
            self.process = subprocess.Popen(  # noqa: S603 - our own program
                [sys.executable, "-m", "gateway.cli", "serve", *_FLAGS, *flags],
                env=clean_environment(),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        self._shown = 0
        try:
            self.http_url: str = self._wait(seconds)
            """``http://127.0.0.1:port``."""
        except BaseException:
            self.kill()
            raise

    @property
    def http_port(self) -> int:
        """Of the render endpoint, the scene, the device's REST interface and the browser view."""
        return urlsplit(self.http_url).port or 0

    @property
    def render_url(self) -> str:
        """For ``RenderEngineGltfClientParams(base_url=http_url, render_endpoint="render")``, or for posting."""
        return f"{self.http_url}/render"

    @property
    def view_url(self) -> str:
        """The browser view."""
        return f"{self.http_url}/view"

    @property
    def grpc_address(self) -> str:
        """``127.0.0.1:port`` of the stereo camera."""
        return f"127.0.0.1:{self.interface('stereo')['port']}"

    @property
    def lcm_url(self) -> str:
        """For ``lcm.LCM(...)`` and ``LCM_DEFAULT_URL``: the TCPQ hub of this gateway."""
        return str(self.interface("treeviewer")["tcpq"]["url"])

    def get(self, path: str) -> bytes:
        """The body of ``GET path``. Raises ``urllib.error.HTTPError`` at 400 and above."""
        with urllib.request.urlopen(self.http_url + path, timeout=60) as answer:  # noqa: S310 - ours
            return bytes(answer.read())

    def health(self) -> Mapping[str, Any]:
        """What ``/healthz`` says."""
        described: Mapping[str, Any] = json.loads(self.get("/healthz"))
        return described

    def interface(self, name: str) -> Mapping[str, Any]:
        """What ``/healthz`` says of one interface: render, scene, treeviewer, stereo, view."""
        described: Mapping[str, Any] = self.health()["interfaces"][name]
        if described["state"] != "ready":
            raise RuntimeError(f"the gateway's {name} is {described['state']}: {described.get('problem', '')}")
        return described

    def scene(self) -> Any:
        """What ``GET /scene`` says: every path with its geometry, bounds and label."""
        return json.loads(self.get("/scene"))

    def publish(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Sends a request of the tree viewer (``delete``, ``setgeometry``, ``settransform``); the answer.

        Raises:
            RuntimeError: the answer's status is negative.
        """
        return publish(self.lcm_url, request)

    def reset(self, scene: Path | None = None) -> None:
        """Empties the live tree, then publishes a file into it."""
        self.publish({"delete": [{"path": []}]})
        if scene is not None:
            self.publish(scene_request(scene))

    def log(self) -> str:
        """What it logged since the last test began, at most the end of it."""
        with self.log_path.open("rb") as file:
            file.seek(self._shown)
            return file.read().decode(errors="replace")[-LOG_CHARS:]

    def begin(self) -> None:
        """A test begins."""
        self._shown = self.log_path.stat().st_size

    def stop(self) -> int:
        """Ends it; the exit code, 0 when it ended by itself in time."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            return self.process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
            return self.process.returncode

    def kill(self) -> None:
        """Ends it at once."""
        self.process.kill()
        self.process.wait()

    def _wait(self, seconds: float) -> str:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self.process.poll() is not None:
                raise RuntimeError(f"the gateway ended with exit code {self.process.returncode}:\n{self.log()}")
            events = [_event(line) for line in self.log_path.read_text("utf-8", "replace").splitlines()]
            if any(str(event.get("event")).startswith("Scenegate has started") for event in events):
                return next(str(event["url"]) for event in events if "url" in event)
            time.sleep(0.05)
        raise RuntimeError(f"the gateway did not start within {seconds:g} s:\n{self.log()}")


class Pool:
    """Gateways by their flags."""

    def __init__(self, folder: Callable[[], Path], seconds: float) -> None:
        self._folder = folder
        self._seconds = seconds
        self._running: dict[tuple[str, ...], Gateway] = {}

    def lend(self, flags: tuple[str, ...], scene: Path | None, *, fresh: bool) -> Gateway:
        """A gateway with an empty tree, or with ``scene`` in it."""
        if scene is not None and not scene.is_file():
            raise FileNotFoundError(f"the scene {scene} is not there")
        if scene is not None and scene.suffix != ".json":
            flags = (*flags, "--mesh-root", str(scene.parent))
        gateway = None if fresh else self._running.get(flags)
        if gateway is None or gateway.process.poll() is not None:
            gateway = Gateway(flags, self._folder(), self._seconds)
            if not fresh:
                self._running[flags] = gateway
        gateway.begin()
        if "treeviewer" in gateway.health()["interfaces"]:
            gateway.reset(scene)
        return gateway

    def close(self) -> None:
        """Ends all."""
        for gateway in self._running.values():
            gateway.stop()


def _event(line: str) -> Mapping[str, Any]:
    try:
        event = json.loads(line)
    except ValueError:
        return {}
    return event if isinstance(event, dict) else {}
