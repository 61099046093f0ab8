"""Gateway processes for tests."""

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

from scenegate.messages.mesh_file import MeshFile
from scenegate.regular_files import read_regular
from scenegate.tree.requests import Requests

STOP_SECONDS: Final = 30.0
"""Seconds after SIGTERM before the process is killed."""
LOG_CHARS: Final = 20_000
"""Maximum number of characters of the log in a failed test's report. The newest lines are kept."""
_OPEN: Final = urllib.request.build_opener(urllib.request.ProxyHandler({})).open
"""Opens URLs of this machine, also where the environment names a proxy."""
_DEFAULT_FLAGS: Final = ("--http-port=0", "--grpc-port=0", "--tcpq-port=0", "--lcm-url=off", "--log-format=json")
"""Flags that come before the flags of a test, which override them."""


def clean_environment() -> dict[str, str]:
    """Return this process's environment without ``SCENEGATE_*`` settings, except the cache folder."""
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith("SCENEGATE_") or name == "SCENEGATE_CACHE_DIR"
    }


class Gateway:
    """A running gateway and its addresses."""

    def __init__(self, flags: tuple[str, ...], folder: Path, seconds: float) -> None:
        """Start a gateway and wait until every interface has started or failed.

        Args:
            flags: Flags of ``scenegate serve``.
            folder: Folder for the log.
            seconds: Maximum time until the gateway has started, or has answered a request.

        Raises:
            RuntimeError: The process ended or took too long. The message contains its log.
        """
        self.log_path = folder / "gateway.log"
        """The log, one JSON object per line."""
        with self.log_path.open("wb") as log:
            self.process = subprocess.Popen(  # noqa: S603 - this package
                [sys.executable, "-m", "scenegate", "serve", *_DEFAULT_FLAGS, *flags],
                env=clean_environment() | {"PYTHONSAFEPATH": "1"},  # a project may have a gateway.py of its own
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        self._log_offset = 0
        self._seconds = seconds
        try:
            self.http_url: str = self._wait_for_start()
            """``http://127.0.0.1:port``"""
        except BaseException:
            self.kill()
            raise

    @property
    def http_port(self) -> int:
        """Port of the render endpoint, the scene, the stereo camera's REST interface and the browser view."""
        return urlsplit(self.http_url).port or 0

    @property
    def render_url(self) -> str:
        """URL of the render endpoint; Drake takes ``base_url=http_url, render_endpoint="render"``."""
        return f"{self.http_url}/render"

    @property
    def view_url(self) -> str:
        """URL of the browser view."""
        return f"{self.http_url}/view"

    @property
    def grpc_address(self) -> str:
        """``127.0.0.1:port`` of the stereo camera's gRPC interface."""
        return f"127.0.0.1:{self.interface('stereo')['port']}"

    @property
    def lcm_url(self) -> str:
        """URL of the gateway's TCPQ hub, for ``lcm.LCM(...)`` and ``LCM_DEFAULT_URL``."""
        return str(self.interface("treeviewer")["tcpq"]["url"])

    def get(self, path: str) -> bytes:
        """Return the body of ``GET path``. Raises ``urllib.error.HTTPError`` for a status of 400 or more."""
        with _OPEN(self.http_url + path, timeout=self._seconds) as response:
            return bytes(response.read())

    def health(self) -> Mapping[str, Any]:
        """Return the JSON of ``/healthz``."""
        health: Mapping[str, Any] = json.loads(self.get("/healthz"))
        return health

    def interface(self, name: str) -> Mapping[str, Any]:
        """Return the entry of one interface in ``/healthz``.

        Args:
            name: render, scene, treeviewer, stereo or view.

        Raises:
            RuntimeError: The interface is not ready.
        """
        interface: Mapping[str, Any] = self.health()["interfaces"][name]
        if interface["state"] != "ready":
            raise RuntimeError(f"the gateway's {name} is {interface['state']}: {interface.get('problem', '')}")
        return interface

    def scene(self) -> Any:
        """Return the JSON of ``GET /scene``: every path with geometry, bounds and label."""
        return json.loads(self.get("/scene"))

    def publish(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Send a request to the tree viewer (``delete``, ``setgeometry``, ``settransform``); return its response.

        Raises:
            RuntimeError: The response has a negative status.
            TimeoutError: There is no response in time.
            ConnectionError: The gateway cannot be reached.
        """
        requests = Requests(self.lcm_url, self._seconds, binary=False)
        try:
            response = requests.send(dict(request))
        finally:
            requests.connection.close()
        if response.status < 0:
            raise RuntimeError(f"the gateway rejected a request: {response.body.get('error', response.body)}")
        return response.body

    def reset(self, scene: Path | None = None) -> None:
        """Empty the live tree, then publish the file ``scene``; None: leave the tree empty."""
        self.publish({"delete": [{"path": []}]})
        if scene is not None:
            self.publish(_scene_request(scene))

    def log(self) -> str:
        """Return the log since ``mark_log``, at most its last ``LOG_CHARS`` characters."""
        with self.log_path.open("rb") as file:
            file.seek(self._log_offset)
            return file.read().decode(errors="replace")[-LOG_CHARS:]

    def mark_log(self) -> None:
        """Make ``log`` start here."""
        self._log_offset = self.log_path.stat().st_size

    def stop(self) -> int:
        """Stop the process; return its exit code, 0 after a clean shutdown."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            return self.process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
            return self.process.returncode

    def kill(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.wait()

    def _wait_for_start(self) -> str:
        """Return the gateway's URL, which its log contains after the start."""
        deadline = time.monotonic() + self._seconds
        while time.monotonic() < deadline:
            if self.process.poll() is not None:
                raise RuntimeError(f"the gateway ended with exit code {self.process.returncode}:\n{self.log()}")
            events = [_parse_event(line) for line in self.log_path.read_text("utf-8", "replace").splitlines()]
            if any(str(event.get("event")).startswith("Scenegate has started") for event in events):
                return next(str(event["url"]) for event in events if "url" in event)
            time.sleep(0.05)
        raise RuntimeError(f"the gateway did not start within {self._seconds:g} s:\n{self.log()}")


class GatewayPool:
    """Running gateways by their flags, shared by tests with the same flags."""

    def __init__(self, make_log_folder: Callable[[], Path], seconds: float) -> None:
        """``make_log_folder`` returns a new folder for the log of one gateway; ``seconds`` as for ``Gateway``."""
        self._make_log_folder = make_log_folder
        self._seconds = seconds
        self._gateways: dict[tuple[str, ...], Gateway] = {}

    def get(self, flags: tuple[str, ...], scene: Path | None, *, fresh: bool) -> Gateway:
        """Return a gateway with these flags whose tree contains the scene only (None: nothing); start one if none runs.

        ``fresh``: start a process that is not kept for other tests.
        """
        if scene is not None and not scene.is_file():
            raise FileNotFoundError(f"the scene {scene} does not exist")
        gateway = None if fresh else self._gateways.get(flags)
        if gateway is None or gateway.process.poll() is not None:
            gateway = Gateway(flags, self._make_log_folder(), self._seconds)
            if not fresh:
                self._gateways[flags] = gateway
        gateway.mark_log()
        if "treeviewer" in gateway.health()["interfaces"]:
            gateway.reset(scene)
        return gateway

    def close(self) -> None:
        """Stop all gateways."""
        for gateway in self._gateways.values():
            gateway.stop()


def _parse_event(line: str) -> Mapping[str, Any]:
    """Return the JSON object of a log line; empty if the line is something else."""
    try:
        event = json.loads(line)
    except ValueError:
        return {}
    return event if isinstance(event, dict) else {}


def _scene_request(path: Path) -> dict[str, Any]:
    """Return the request that publishes a file: the content of a ``.json`` file, else a mesh at the path ``scene``."""
    if path.suffix == ".json":
        request: dict[str, Any] = json.loads(read_regular(path))
        return request
    return {
        "setgeometry": [{"path": ["scene"], "geometry": MeshFile.read(path).body()}],
        "settransform": [{"path": ["scene"], "transform": {"translation": [0, 0, 0], "quaternion": [1, 0, 0, 0]}}],
    }
