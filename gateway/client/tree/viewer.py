"""Blocking client of the tree viewer: ``TreeViewer()["robot"]["base"].set(Box((1, 1, 1)))``."""

from __future__ import annotations

import contextlib
import itertools
import os
import secrets
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from os import PathLike
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Literal

from numpy.typing import ArrayLike

from gateway.client.tree import wire
from gateway.client.tree.answer import Answer
from gateway.client.tree.connection import LcmConnection
from gateway.client.tree.geometry import Geometry, Transform
from gateway.client.tree.published import Changes, Path, PublishedTree, path_of
from gateway.client.tree.robot import PublishedRobot, publish_robot

if TYPE_CHECKING:
    from gateway.robots.robot import JointValue

OK, MISSING_PATHS, UNKNOWN_FORMAT, UNKNOWN_VERSION = 0, 1, -1, -2
"""Status codes of responses. All negative codes are failures."""


class TreeViewerError(RuntimeError):
    """The viewer refused at least one command of a request. It executed the other commands."""

    def __init__(self, answer: Answer) -> None:
        super().__init__(answer.error or f"the viewer answered with status {answer.status}")
        self.answer = answer


class Node:
    """A path of the tree. Indexing gives the paths below: ``node["arm"][0]``, ``node["arm", 0]``, ``node["arm/x"]``."""

    __slots__ = ("_target", "path")

    def __init__(self, target: TreeViewer | Batch, path: Path) -> None:
        self._target = target
        self.path = path

    def __getitem__(self, key: str | int | tuple[str | int, ...]) -> Node:
        return Node(self._target, self.path + path_of(key))

    def set(self, *geometries: Geometry, transform: Transform | ArrayLike | None = None) -> Answer:
        """Replace the geometries of this path, and its transform if one is given. Paths below stay as they are."""
        for geometry in geometries:
            if not isinstance(geometry, Geometry):
                raise TypeError(f"set takes geometries such as Box((1, 1, 1)), not {_describe(geometry)}")
        changes = Changes()
        changes.set(self.path, [geometry.body() for geometry in geometries])
        if transform is not None:
            changes.transform(self.path, Transform.of(transform).body())
        return self._target.send(changes)

    def transform(self, value: Transform | ArrayLike) -> Answer:
        """Replace the transform to the parent: (4, 4), three numbers (a translation) or a ``Transform``."""
        changes = Changes()
        changes.transform(self.path, Transform.of(value).body())
        return self._target.send(changes)

    def delete(self) -> Answer:
        """Delete this path and everything below it."""
        changes = Changes()
        changes.delete(self.path)
        return self._target.send(changes)


class Batch:
    """Collects changes for one request. Later changes of a path override earlier ones."""

    def __init__(self) -> None:
        self.changes = Changes()
        self.answer: Answer | None = None
        """Result of the request, after the block has ended."""

    def __getitem__(self, key: str | int | tuple[str | int, ...]) -> Node:
        return Node(self, path_of(key))

    def send(self, changes: Changes) -> Answer:
        """Add changes to the batch. The result says nothing, since the viewer has not received them yet."""
        for path in changes.deleted:
            self.changes.delete(path)
        for path, entry in changes.entries.items():
            if entry.geometries is not None:
                self.changes.set(path, entry.geometries)
            if entry.transform is not None:
                self.changes.transform(path, entry.transform)
        return Answer(OK)


class TreeViewer:
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
            ImportError: the package lcm cannot be loaded.
        """
        self.timeout = timeout
        self._negotiate = binary is None
        self.message_format: str | None = {None: None, True: wire.BINARY, False: wire.JSON}[binary]
        """Format of requests; None: not negotiated yet."""
        self._published = PublishedTree()
        self._lock = threading.Lock()
        self._last_utime = 0
        """``utime`` of the last request: microseconds since 1970, made unique."""
        self.pending: dict[int, Future[wire.Response]] = {}
        """Requests without a response, by ``utime``."""
        self.client_id = f"sg{os.getpid()}_{next(self._instance_numbers)}_{secrets.token_hex(4)}"
        handlers = {f"{wire.RESPONSE}_<{self.client_id}>": self._on_response, wire.RESPONSE: self._on_announcement}
        self._connection = LcmConnection(url, handlers, timeout)

    @property
    def url(self) -> str:
        """URL of the LCM network."""
        return self._connection.url

    def __getitem__(self, key: str | int | tuple[str | int, ...]) -> Node:
        return Node(self, path_of(key))

    def __enter__(self) -> TreeViewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection. The published geometry stays in the viewer."""
        self._connection.close()

    def delete(self) -> Answer:
        """Delete everything in the viewer, including the geometry of other clients."""
        return Node(self, ()).delete()

    @contextmanager
    def batch(self) -> Iterator[Batch]:
        """Collect changes inside the context and send them in one request when it ends. An exception sends nothing."""
        batch = Batch()
        yield batch
        batch.answer = self.send(batch.changes)

    def robot(
        self,
        path: str | int | tuple[str | int, ...],
        file: str | PathLike[str],
        *,
        joints: Mapping[str, JointValue] | None = None,
        roots: Iterable[str | PathLike[str]] = (),
        geometry: Literal["visual", "collision"] = "visual",
    ) -> PublishedRobot:
        """Publish a robot file in place of everything at a path: each link at a path below it, named like the link.

        Args:
            path: Path of the robot: ``"panda"``.
            file: URDF, or MJCF with the extra ``scenegate[robots]``, on this machine.
            joints: Values in radians or metres, by joint name. The others are as in the file.
            roots: Folders with the packages of ``package://`` names.
            geometry: Geometry of the links to publish.
        Raises:
            ValueError: the file cannot be used, or a joint or its value is invalid.
            ImportError: a package that is needed to read the file is not installed.
            TreeViewerError, TimeoutError, ConnectionError: see ``send``.
        """
        return publish_robot(self, path, file, joints or {}, roots, geometry)

    def send(self, changes: Changes) -> Answer:
        """Send changes and wait for the response. If the viewer reports missing paths, publish them again.

        Raises:
            TreeViewerError: the viewer refused a command.
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
        answer = _answer(response, missing)
        if answer.status < OK:
            raise TreeViewerError(answer)
        return answer

    def _request(self, changes: Changes) -> wire.Response:
        """Send changes in the negotiated format, and return the response. An empty request negotiates the format."""
        if self.message_format is None:
            status = self._exchange({}, wire.BINARY).status
            self.message_format = wire.JSON if status in (UNKNOWN_FORMAT, UNKNOWN_VERSION) else wire.BINARY
        response = self._exchange(changes.body(), self.message_format)
        refused = response.status in (UNKNOWN_FORMAT, UNKNOWN_VERSION)
        if refused and self.message_format == wire.BINARY and self._negotiate:
            self.message_format = wire.JSON  # another viewer, without MessagePack, runs now
            response = self._exchange(changes.body(), self.message_format)
        return response

    def _exchange(self, body: dict[str, Any], message_format: str) -> wire.Response:
        """Send one request and wait for its response."""
        utime, future = self._post(body, message_format)
        try:
            return future.result(self.timeout)
        except TimeoutError:
            hint = "; big messages can get lost over UDP, tcpq:// loses none" if self.url.startswith("udpm") else ""
            raise TimeoutError(f"no viewer answered within {self.timeout:g} s on {self.url}{hint}") from None
        finally:
            self.pending.pop(utime, None)

    def _post(self, body: dict[str, Any], message_format: str) -> tuple[int, Future[wire.Response]]:
        """Send one request, and return its ``utime`` and the future of its response."""
        with self._lock:
            utime = self._last_utime = max(self._last_utime + 1, time.time_ns() // 1000)
            future = self.pending[utime] = Future()
        try:
            message = wire.encode({"timestamp": utime, **body}, utime, message_format)
            self._connection.publish(f"{wire.REQUEST}_<{self.client_id}>", message)
        except BaseException:
            self.pending.pop(utime, None)
            raise
        return utime, future

    def _on_response(self, message: bytes) -> None:
        """Complete the future of the request that a response belongs to. Runs in the receiving thread."""
        response = wire.decode(message)
        future = self.pending.pop(response.timestamp, None) if response is not None else None
        if future is not None and response is not None:
            future.set_result(response)

    def _on_announcement(self, message: bytes) -> None:
        """Publish everything for a viewer that has just started. Runs in the receiving thread."""
        response = wire.decode(message)
        if response is None or response.body.get("ready") is not True:
            return
        with self._lock:
            everything = self._published.all()
        if everything.entries:
            with contextlib.suppress(ConnectionError):  # there is no caller to tell; the next request may restore it
                utime, _ = self._post(everything.body(), self.message_format or wire.JSON)
                self.pending.pop(utime, None)


def _describe(value: object) -> str:
    """Return at most about 40 characters on any value, for an error text."""
    text = repr(value) if isinstance(value, (str, int, float)) else f"a {type(value).__name__}"
    return text if len(text) <= 40 else f"{text[:40]}…"


def _answer(response: wire.Response, missing: list[Path]) -> Answer:
    """Return the result of a request, given the paths that are missing after publishing again."""
    body = response.body

    def paths(name: str) -> tuple[Path, ...]:
        return tuple(tuple(path) for path in body.get(name, ()))

    status = response.status
    if status == MISSING_PATHS and not missing:
        status = OK
    errors: Final = body.get("errors", ())
    failure_count = f" ({len(errors)} commands failed)" if len(errors) > 1 else ""
    return Answer(
        status,
        paths("deleted_paths"),
        paths("added_geometries"),
        paths("set_transforms"),
        tuple(missing),
        tuple(body.get("warnings", ())),
        f"{body.get('error', '')}{failure_count}",
    )
