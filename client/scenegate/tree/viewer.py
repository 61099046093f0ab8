"""Blocking client of the tree viewer: ``TreeViewer()["robot"]["base"].set(Box((1, 1, 1)))``."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from os import PathLike, fspath
from types import EllipsisType
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from scenegate.closing import Closing
from scenegate.messages.arguments import describe
from scenegate.messages.changes import Changes, Key, Path, path_of
from scenegate.messages.colors import rgba
from scenegate.messages.field_kinds import number_list
from scenegate.messages.geometry import Geometry, Transform
from scenegate.messages.request_encoding import Response
from scenegate.messages.wire import MISSING_PATHS, OK
from scenegate.robots.xacro_args import XacroArgs
from scenegate.tree.answer import UNSUPPORTED, Answer, TreeViewerError, answer_of
from scenegate.tree.callbacks import Callback, CallbackThreads, ClickListener
from scenegate.tree.control_panel import ControlPanel
from scenegate.tree.controls import ControlFolder
from scenegate.tree.node_handles import Batch, NodeHandle, PublishedRobot, read_robot_for, transforms_of
from scenegate.tree.notebook import NotebookViews
from scenegate.tree.requests import Requests
from scenegate.warning_text import strict_refusal

if TYPE_CHECKING:
    from scenegate.robots.robot import JointValue

PART_BYTES: Final = 16 << 20
"""Size of requests that publish again, in bytes of arrays: 8 times as much in JSON, half of what a hub accepts."""
MAX_LOGGED: Final = 20
"""Maximum number of different warnings of a viewer that are logged."""

_log = logging.getLogger(__name__)


class TreeViewer(NotebookViews, Closing):
    """Client of Scenegate or any other viewer with Director's protocol. Thread-safe.

    The client records what it published, and publishes it again when the viewer has lost it or was restarted.
    """

    def __init__(self, url: str | None = None, timeout: float = 5.0, binary: bool | None = None) -> None:
        """Connect to the LCM network.

        Args:
            url: LCM URL (``tcpq://host:7700``, ``udpm://...``); None: the environment variable LCM_DEFAULT_URL, or
                else LCM's default.
            timeout: seconds to wait for a hub, or for a response, with a second more for every 10 MB of the request.
            binary: format of requests. True: MessagePack; False: JSON, which has no NaN and infinite numbers: ``null``
                is sent in their place; None: MessagePack if the viewer supports it.

        Raises:
            ConnectionError: no hub listens, or there is no route for multicast.
        """
        self._published = Changes()
        """Content of a viewer that has executed all requests, without clicks and controls."""
        self._lock = threading.Lock()
        """Guards ``_published``. Held until what was published before is on its way again: a change that another thread
        sends meanwhile must arrive after it."""
        self._logged: set[str] = set()
        """Warnings of the viewer that were logged."""
        self._threads = CallbackThreads(self._resend_subscriptions)
        self._clicks = ClickListener(self._threads)
        self._panel = ControlPanel(self.send, self._threads, self._record)
        self.controls = ControlFolder(self._panel)
        """Controls in the page: ``viewer.controls.add_slider("speed", 0, 10)``."""
        self.requests = Requests(url, timeout, binary, self._on_message, self._panel.sent)
        """The connection, with its timeout."""
        super().__init__(self.url)

    @property
    def url(self) -> str:
        """URL of the LCM network."""
        return self.requests.connection.url

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.url}>"

    def __getitem__(self, key: Key) -> NodeHandle:
        return NodeHandle(self, path_of(key))

    def close(self) -> None:
        """Close the connection. The published geometry stays in the viewer; the controls are removed."""
        self._threads.close()
        self._resend_subscriptions(is_last=True)
        self.requests.connection.close()

    def set_transforms(self, paths: Iterable[Key], poses: ArrayLike) -> Answer:
        """Replace the transforms of many paths in one request, faster than a batch.

        Args:
            paths: N indices of nodes, as in ``viewer[...]``.
            poses: (N, 7): x, y, z in metres, and the quaternion w, x, y, z of each path.

        Raises:
            TypeError: ``paths`` is one string.
            ValueError: the shapes differ, a number is not finite, or a quaternion is zero.
        """
        return self.send(transforms_of(paths, poses))

    def set(self, *geometries: Geometry, transform: Transform | ArrayLike | None = None) -> Answer:
        """Replace the geometries of the root. See ``NodeHandle.set``."""
        return NodeHandle(self, ()).set(*geometries, transform=transform)

    def delete(self) -> Answer:
        """Delete everything in the viewer, including the geometry of other clients."""
        return NodeHandle(self, ()).delete()

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
            changes.view["background"] = None if background is None else rgba(background, "background")[:3]
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
        with self._panel.send_lock:
            self.send(Changes(click_paths=self._clicks.paths()))

    def _resend_subscriptions(self, *, is_last: bool = False) -> None:
        """Send clickable paths and controls without waiting for the response, or for a connection that is lost.

        ``is_last``: end the subscription to clicks, and remove the controls.
        """
        with self._panel.send_lock:
            changes = Changes()
            if paths := self._clicks.paths():
                changes.click_paths = [] if is_last else paths
            if controls := self._panel.definitions():
                changes.controls = [] if is_last else controls
            if body := changes.newer_commands():
                self.requests.send_without_response(body)

    def _record(self, changes: Changes) -> None:
        """Record changes that are published, or that the page has made."""
        with self._lock:
            self._published.add(changes)
            self._published.deleted.clear()  # a viewer that has lost something has nothing to delete

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
        xacro_args: XacroArgs | None = None,
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
            xacro_args: Values of a xacro file's arguments, by name: ``{"dof": 7}``.
            strict: True: refuse a file of which something cannot be drawn. False: the result has ``warnings``.

        Raises:
            ValueError: the file cannot be used, or a joint or its value is invalid.
            ImportError: a package that is needed to read the file is not installed.
            TreeViewerError, TimeoutError, ConnectionError: see ``send``.
        """
        if isinstance(roots, (str, PathLike)):
            raise TypeError(f"roots must be a list of folders, not {describe(roots)}")
        options = {
            "roots": list(roots),
            "geometry": geometry,
            "gltf_up": gltf_up,
            "strict": strict,
            "xacro_args": xacro_args or {},
        }
        robot = read_robot_for(self.reads_files, file, options, textures=textures, keyframe=keyframe)
        published = PublishedRobot(self, path_of(path), robot, joints or {})
        if strict and (refusal := strict_refusal(published.answer.warnings)):
            published.delete()
            raise ValueError(f"{fspath(file)}: {refusal}")
        return published

    def send(self, changes: Changes) -> Answer:
        """Send changes and wait for the response. If the viewer reports missing paths, publish them again.

        Warnings are in the result, and each new text is logged once, up to ``MAX_LOGGED``.

        Raises:
            TreeViewerError: the viewer rejected a command.
            TimeoutError: there was no response in time.
            ConnectionError: the connection is closed, or lost for longer than the timeout.
        """
        response = self.requests.send(changes.body(), lambda: self._record(changes))
        missing = _missing_paths(response)
        if response.status == MISSING_PATHS:
            response, missing = self._republish(response, missing)
        answer = answer_of(response, missing)
        for warning in answer.warnings:
            if warning in self._logged or len(self._logged) > MAX_LOGGED:
                continue
            self._logged.add(warning)
            if len(self._logged) <= MAX_LOGGED:
                _log.warning("The tree viewer warns: %s", warning)
            else:
                _log.warning("Further warnings of the tree viewer are in the answers only")
        unknown = changes.newer_commands().keys() - set(response.body.get("newer_commands", ()))
        if unknown and answer.status >= OK:
            error = f"this viewer does not know {', '.join(sorted(unknown))}; it has done everything else"
            answer = replace(answer, status=UNSUPPORTED, error=error)
        if answer.status < OK:
            raise TreeViewerError(answer)
        return answer

    def _republish(self, response: Response, missing: list[Path]) -> tuple[Response, list[Path]]:
        """Publish missing paths again. Return the response of a failure, or else ``response``; and the paths that are
        still missing."""
        with self._lock:
            parts = self._published.missing(missing).parts(PART_BYTES)
            sent = [self.requests.post(part.body()) for part in parts]
        still_missing = [] if sent else missing
        for second_response in map(self.requests.wait, sent):
            if second_response.status < OK:
                return second_response, []
            still_missing += _missing_paths(second_response)
        return response, still_missing

    def reads_files(self) -> bool:
        """Return True if the viewer reads the content of mesh files, as Scenegate does; see ``send`` for errors."""
        return self.requests.reads_files()

    def _on_message(self, message: Response) -> None:
        """Take a message of the page, or publish everything for a viewer that has just started.

        Runs in the receiving thread, so that no response can be waited for: the next request repeats what is missing.
        """
        body = message.body
        if "click" in body:
            self._clicks.receive(body["click"])
        elif "controls" in body:
            self._panel.receive(body)
        elif body.get("ready") is True:
            self._threads.resend_now()
            with self._lock:
                parts = [tuple(part.entries) for part in self._published.parts(PART_BYTES)]
                if self._published.view:
                    self.requests.send_without_response(Changes(view=self._published.view).body())
            if parts:
                self.requests.connection.run_in_turn(partial(self._publish_again, paths) for paths in parts)

    def _publish_again(self, paths: tuple[Path, ...]) -> None:
        """Publish what is still recorded at paths, without waiting for the response."""
        with self._lock:
            recorded = self._published.entries
            entries = {path: recorded[path] for path in paths if path in recorded}
            self.requests.send_without_response(Changes(entries=entries).body())


def _missing_paths(response: Response) -> list[Path]:
    return [tuple(path) for path in response.body.get("missing_paths", ())]


def _home(vectors: Sequence[ArrayLike]) -> dict[str, list[float]]:
    """Return eye, target and, if given, up as the protocol's object."""
    names = ("eye", "target", "up")
    if not hasattr(vectors, "__len__") or len(vectors) not in (2, 3):
        raise ValueError(f"home must be eye, target and optionally up, not {describe(vectors)}")
    home: dict[str, list[float]] = {}
    for name, vector in zip(names, vectors, strict=False):
        home[name] = number_list(f"{name} of home", vector, 3)
        if not np.isfinite(home[name]).all():
            raise ValueError(f"{name} of home must have finite numbers, not {describe(home[name])}")
    return home
