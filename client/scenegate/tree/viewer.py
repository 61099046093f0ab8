"""Blocking client of the tree viewer: ``TreeViewer()["robot"]["base"].set(Box((1, 1, 1)))``."""

from __future__ import annotations

import contextlib
import itertools
import os
import secrets
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from types import EllipsisType, TracebackType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from scenegate.messages import wire
from scenegate.messages.changes import Changes, Key, PublishedTree, path_of
from scenegate.messages.colors import rgba
from scenegate.messages.request_encoding import Response, decode_response, encode_request
from scenegate.tree.answer import (
    MISSING_PATHS,
    OK,
    UNKNOWN_FORMAT,
    UNKNOWN_VERSION,
    UNSUPPORTED,
    Answer,
    TreeViewerError,
    answer_of,
)
from scenegate.tree.callbacks import CallbackThreads
from scenegate.tree.clicks import Callback, ClickListener
from scenegate.tree.connection import LcmConnection
from scenegate.tree.control_panel import ControlPanel
from scenegate.tree.controls import ControlFolder
from scenegate.tree.nodes import Batch, Node, transforms_of
from scenegate.tree.notebook import NotebookViews
from scenegate.tree.robot import PublishedRobot, publish_robot

if TYPE_CHECKING:
    from scenegate.robots.robot import JointValue


class TreeViewer(NotebookViews):
    """Client of Scenegate or any other viewer with Director's protocol. Thread-safe.

    The client records what it published, and publishes it again when the viewer has lost it or was restarted.
    """

    _instance_numbers = itertools.count()

    def __init__(self, url: str | None = None, timeout: float = 5.0, binary: bool | None = None) -> None:
        """Connect to the LCM network.

        Args:
            url: LCM URL (``tcpq://host:7700``, ``udpm://...``); None: the environment variable LCM_DEFAULT_URL, or
                else LCM's default.
            timeout: seconds to wait for a response, or for a hub.
            binary: format of requests. True: MessagePack; False: JSON; None: MessagePack if the viewer supports it.

        Raises:
            ConnectionError: no hub listens, or there is no route for multicast.
        """
        self.timeout = timeout
        self._negotiate = binary is None
        self.message_format: str | None = {None: None, True: wire.BINARY, False: wire.JSON}[binary]
        """Format of requests; None: not negotiated yet."""
        self._published = PublishedTree()
        self._lock = threading.Lock()
        self._last_utime = 0
        """``utime`` of the last request: microseconds since 1970, made unique."""
        self.pending: dict[int, Future[Response]] = {}
        """Requests without a response, by ``utime``."""
        self.client_id = f"sg{os.getpid()}_{next(self._instance_numbers)}_{secrets.token_hex(4)}"
        handlers = {f"{wire.RESPONSE}_<{self.client_id}>": self._on_response, wire.RESPONSE: self._on_announcement}
        self._threads = CallbackThreads(self._renew)
        self._clicks = ClickListener(self._threads)
        self._panel = ControlPanel(self.send, self._threads, self._record)
        self.controls = ControlFolder(self._panel)
        """Controls in the page: ``viewer.controls.add_slider("speed", 0, 10)``."""
        self._connection = LcmConnection(url, handlers, timeout)
        super().__init__(self._connection.url)

    @property
    def url(self) -> str:
        """URL of the LCM network."""
        return self._connection.url

    def __getitem__(self, key: Key) -> Node:
        return Node(self, path_of(key))

    def __enter__(self) -> TreeViewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection. The published geometry stays in the viewer; the controls are removed."""
        self._threads.close()
        self._renew(is_last=True)
        self._connection.close()

    def set_transforms(self, paths: Iterable[Key], poses: ArrayLike) -> Answer:
        """Replace the transforms of many paths in one request, faster than a batch.

        Args:
            paths: N indices of nodes, as in ``viewer[...]``.
            poses: (N, 7): x, y, z in metres, and the quaternion w, x, y, z of each path.

        Raises:
            ValueError: the shapes differ, or a number is not finite.
        """
        return self.send(transforms_of(paths, poses))

    def delete(self) -> Answer:
        """Delete everything in the viewer, including the geometry of other clients."""
        return Node(self, ()).delete()

    def set_view(
        self,
        *,
        background: ArrayLike | EllipsisType | None = ...,
        grid: bool | EllipsisType | None = ...,
        home: Sequence[ArrayLike] | EllipsisType | None = ...,
    ) -> Answer:
        """Set background, grid and home camera of the page in the browser, for open pages and later ones.

        None resets a setting to the page's default. Settings that are left out stay as they are. Choices made in the
        page's own controls take precedence.

        Args:
            background: a colour as in ``color`` of geometry, without alpha.
            grid: True shows and False hides the grid on the ground.
            home: eye and target in the world, metres, and optionally the direction up (default +z).
        """
        changes = Changes()
        if background is not ...:
            changes.view["background"] = None if background is None else rgba(background)[:3]
        if grid is not ...:
            if grid is not None and not isinstance(grid, (bool, np.bool_)):
                raise TypeError(f"grid must be True, False or None, not {grid!r}")
            changes.view["grid"] = None if grid is None else bool(grid)
        if home is not ...:
            changes.view["home"] = None if home is None else _home(home)
        return self.send(changes)

    def on_click(self, path: Key, callback: Callback) -> Callable[[], None]:
        """Call ``callback`` with a ``Click`` for each click in the browser on geometry at or below ``path``.

        The callbacks run one after the other in a thread of the client, and may use it.

        Returns:
            Function that ends the calls.

        Raises:
            TreeViewerError: the viewer sends no clicks, or a limit is reached.
            TypeError: the callback is not a function, or is a coroutine.
        """
        remove = self._clicks.add(path_of(path), callback)
        try:
            self._send_click_paths()
        except BaseException:
            remove()
            raise

        def stop() -> None:
            remove()
            self._send_click_paths()

        return stop

    def _send_click_paths(self) -> None:
        """Subscribe to the clicks that have callbacks."""
        with self._panel.sending:
            changes = Changes()
            changes.click_paths = self._clicks.paths()
            self.send(changes)

    def _renew(self, *, is_last: bool = False) -> None:
        """Send clickable paths and controls without waiting for the response, or for a connection that is lost.

        Args:
            is_last: True: end the subscription to clicks, and remove the controls.
        """
        with self._panel.sending:
            changes = Changes()
            if paths := self._clicks.paths():
                changes.click_paths = [] if is_last else paths
            if controls := self._panel.definitions():
                changes.controls = [] if is_last else controls
            body = changes.newer_commands()
            if body and self._connection.is_connected:
                with contextlib.suppress(ConnectionError):
                    self._post_only(body)

    def _record(self, changes: Changes) -> None:
        """Record changes that the page has made."""
        with self._lock:
            self._published.update(changes)

    def _post_only(self, body: dict[str, Any]) -> None:
        """Send a request whose response is ignored."""
        utime, _ = self._post(body, self.message_format or wire.JSON)
        self.pending.pop(utime, None)

    @contextmanager
    def batch(self) -> Iterator[Batch]:
        """Collect changes inside the context and send them in one request when it ends. An exception sends nothing."""
        batch = Batch()
        yield batch
        batch.answer = self.send(batch.changes)

    def robot(
        self,
        path: Key,
        file: str | PathLike[str],
        *,
        joints: Mapping[str, JointValue] | None = None,
        roots: Iterable[str | PathLike[str]] = (),
        geometry: Literal["visual", "collision"] = "visual",
        textures: bool = True,
        keyframe: str = "",
        gltf_up: Literal["y", "z", "auto"] = "y",
        strict: bool = False,
    ) -> PublishedRobot:
        """Publish a robot file in place of everything at and below a path. Each link is below it, by name.

        Args:
            path: Path of the robot: ``"panda"``.
            file: URDF or SDF, on this machine; MJCF and xacro where ``scenegate[robots]``, the server, is installed.
            joints: Values in radians or metres, by joint name. Other joints have the values of the file.
            roots: Folders with the packages of ``package://`` names.
            geometry: Geometry of the links to publish.
            textures: False: meshes have the mean colours of their textures, and no vertex colours. Viewers other than
                Scenegate reject meshes with textures or vertex colours.
            keyframe: Keyframe of an MJCF file, which has the joints' values.
            gltf_up: Up axis of the glTF meshes of a URDF or SDF file; ``auto``: what fits the collision geometry.
            strict: True: refuse a file of which something cannot be drawn. False: the result has ``warnings``.

        Raises:
            ValueError: the file cannot be used, or a joint or its value is invalid.
            ImportError: a package that is needed to read the file is not installed.
            TreeViewerError, TimeoutError, ConnectionError: see ``send``.
        """
        return publish_robot(self, path, file, joints or {}, roots, geometry, textures, keyframe, gltf_up, strict)

    def send(self, changes: Changes) -> Answer:
        """Send changes and wait for the response. If the viewer reports missing paths, publish them again.

        Raises:
            TreeViewerError: the viewer rejected a command.
            TimeoutError: there was no response in time.
            ConnectionError: the connection is closed, or lost for longer than the timeout.
        """
        with self._lock:
            self._published.update(changes)
        response = self._request(changes)
        missing = [tuple(path) for path in response.body.get("missing_paths", ())]
        if response.status == MISSING_PATHS:
            with self._lock:
                republished = self._published.missing(missing)
            if republished.entries:
                second_response = self._request(republished)
                missing = []
                if second_response.status == MISSING_PATHS:
                    missing = [tuple(path) for path in second_response.body.get("missing_paths", ())]
                elif second_response.status < OK:
                    response = second_response
        answer = answer_of(response, missing)
        unknown = changes.newer_commands().keys() - set(response.body.get("newer_commands", ()))
        if unknown and answer.status >= OK:
            error = f"this viewer does not know {', '.join(sorted(unknown))}; it has done everything else"
            answer = replace(answer, status=UNSUPPORTED, error=error)
        if answer.status < OK:
            raise TreeViewerError(answer)
        return answer

    def _request(self, changes: Changes) -> Response:
        """Send changes in the negotiated format, and return the response."""
        response = self._exchange(changes.body(), self._negotiated_format())
        refused = response.status in (UNKNOWN_FORMAT, UNKNOWN_VERSION)
        if refused and self.message_format == wire.BINARY and self._negotiate:
            self.message_format = wire.JSON  # another viewer, without MessagePack, runs now
            response = self._exchange(changes.body(), self.message_format)
        return response

    def _negotiated_format(self) -> str:
        """Return the format of requests. An empty request negotiates it."""
        if self.message_format is None:
            status = self._exchange({}, wire.BINARY).status
            self.message_format = wire.JSON if status in (UNKNOWN_FORMAT, UNKNOWN_VERSION) else wire.BINARY
        return self.message_format

    def reads_files(self) -> bool:
        """Return True if the viewer reads the content of mesh files, as Scenegate does.

        Raises:
            TimeoutError, ConnectionError: see ``send``.
        """
        return not self._negotiate or self._negotiated_format() == wire.BINARY

    def _exchange(self, body: dict[str, Any], message_format: str) -> Response:
        """Send one request and wait for its response."""
        utime, future = self._post(body, message_format)
        try:
            return future.result(self.timeout)
        except FutureTimeoutError:
            hint = "; big messages can get lost over UDP, tcpq:// loses none" if self.url.startswith("udpm") else ""
            raise TimeoutError(f"no viewer answered within {self.timeout:g} s on {self.url}{hint}") from None
        finally:
            self.pending.pop(utime, None)

    def _post(self, body: dict[str, Any], message_format: str) -> tuple[int, Future[Response]]:
        """Send one request, and return its ``utime`` and the future of its response."""
        with self._lock:
            utime = self._last_utime = max(self._last_utime + 1, time.time_ns() // 1000)
            future = self.pending[utime] = Future()
        self._panel.sent(body, utime)
        try:
            message = encode_request({"timestamp": utime, **body}, utime, message_format)
            self._connection.publish(f"{wire.REQUEST}_<{self.client_id}>", message, future.set_exception)
        except BaseException:
            self.pending.pop(utime, None)
            raise
        return utime, future

    def _on_response(self, message: bytes) -> None:
        """Complete the future of a response's request, or take a message of the page. Runs in the receiving thread."""
        response = decode_response(message)
        if response is not None and "click" in response.body:
            self._clicks.receive(response.body["click"])
            return
        if response is not None and "controls" in response.body:
            self._panel.receive(response.body)
            return
        future = self.pending.pop(response.timestamp, None) if response is not None else None
        if future is not None and response is not None:
            future.set_result(response)

    def _on_announcement(self, message: bytes) -> None:
        """Publish everything for a viewer that has just started. Runs in the receiving thread."""
        response = decode_response(message)
        if response is None or response.body.get("ready") is not True:
            return
        self._threads.renew_now()
        with self._lock:
            everything = self._published.all()
        if everything.entries or everything.newer_commands():
            # No caller waits. The next request publishes again what is missing.
            with contextlib.suppress(ConnectionError):
                self._post_only(everything.body())


def _home(vectors: Sequence[ArrayLike]) -> dict[str, list[float]]:
    """Return eye, target and, if given, up as the protocol's object."""
    names = ("eye", "target", "up")
    if len(vectors) not in (2, 3):
        raise ValueError(f"home must be eye, target and optionally up, not {len(vectors)} vectors")
    home: dict[str, list[float]] = {}
    for name, vector in zip(names, vectors, strict=False):
        array = np.asarray(vector, np.float64)
        if array.shape != (3,):
            raise ValueError(f"{name} of home must have 3 numbers, not shape {array.shape}")
        home[name] = array.tolist()
    return home
