"""``NodeHandle``, which changes one path of the tree, and ``Batch``, which collects changes for one request.

Indexing a viewer, a batch or a node returns a ``NodeHandle``.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scenegate.messages.arguments import as_array, describe
from scenegate.messages.changes import Changes, Entry, Key, Path, path_of
from scenegate.messages.field_kinds import write_number
from scenegate.messages.geometry import Geometry, Transform
from scenegate.messages.wire import OK
from scenegate.transforms import quaternions_of
from scenegate.tree.answer import Answer
from scenegate.warning_text import NOTHING_DRAWN


class Sender(Protocol):
    """Sends changes: a viewer at once, a batch at the end of its block."""

    def send(self, changes: Changes) -> Answer:
        """Send changes and wait for the response, or collect them."""


class NodeHandle:
    """A path of the tree. Indexing gives the paths below: ``node["arm"][0]``, ``node["arm", 0]``, ``node["arm/x"]``."""

    __slots__ = ("_sender", "path")

    def __init__(self, sender: Sender, path: Path) -> None:
        self._sender = sender
        self.path = path

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {'/'.join(map(str, self.path)) or '/'} of {self._sender!r}>"

    def __getitem__(self, key: Key) -> NodeHandle:
        return NodeHandle(self._sender, self.path + path_of(key))

    def set(self, *geometries: Geometry, transform: Transform | ArrayLike | None = None) -> Answer:
        """Replace the geometries of this path, and its transform if one is given. Paths below stay as they are."""
        for geometry in geometries:
            if not isinstance(geometry, Geometry):
                raise TypeError(f"set takes geometries such as Box((1, 1, 1)), not {describe(geometry)}")
        transform_body = None if transform is None else Transform.of(transform).body()
        return self._send_entry(Entry([geometry.body() for geometry in geometries], transform_body))

    def transform(self, value: Transform | ArrayLike) -> Answer:
        """Replace X_parent_node: a ``Transform``, (4, 4), three numbers (a translation in metres), or seven.

        Seven numbers are a pose: x, y, z in metres, and the quaternion w, x, y, z.
        """
        return self._send_entry(Entry(transform=Transform.of(value).body()))

    def set_visible(self, visible: bool) -> Answer:
        """Show or hide this path and everything below it, in the browser and in images."""
        if not isinstance(visible, (bool, np.bool_)):
            raise TypeError(f"visible must be True or False, not {describe(visible)}")
        return self._send_entry(Entry(visible=bool(visible)))

    def set_opacity(self, opacity: float) -> Answer:
        """Set the opacity of this path, 0 to 1: a factor of the alpha of everything at and below it."""
        number = write_number("opacity", opacity)
        if not 0.0 <= number <= 1.0:
            raise ValueError(f"opacity must be from 0 to 1, not {number:g}")
        return self._send_entry(Entry(opacity=number))

    def delete(self) -> Answer:
        """Delete this path and everything below it."""
        return self._sender.send(Changes().delete(self.path))

    def _send_entry(self, entry: Entry) -> Answer:
        return self._sender.send(Changes().set_entry(self.path, entry))


class Batch:
    """Collects changes for one request. Later changes of a path override earlier ones."""

    def __init__(self) -> None:
        self.changes = Changes()
        self.answer: Answer | None = None
        """Result of the request; None until the block has ended."""

    def __repr__(self) -> str:
        return f"<Batch of {len(self.changes.entries)} paths>"

    def __getitem__(self, key: Key) -> NodeHandle:
        return NodeHandle(self, path_of(key))

    def send(self, changes: Changes) -> Answer:
        """Add changes to the batch. The result is a placeholder: the viewer has not received them yet."""
        self.changes.add(changes)
        return Answer(OK)

    def set_transforms(self, paths: Iterable[Key], poses: ArrayLike) -> Answer:
        """See ``TreeViewer.set_transforms``."""
        return self.send(transforms_of(paths, poses))


def transforms_of(paths: Iterable[Key], poses: ArrayLike) -> Changes:
    """Return the changes that replace the transforms of many paths; see ``TreeViewer.set_transforms``."""
    if isinstance(paths, str):
        raise TypeError(
            f"paths must be a list of paths, not {describe(paths)}; for one path use set_transforms([path], ...)"
        )
    node_paths = [path_of(path) for path in paths]
    wanted = f"poses must have shape ({len(node_paths)}, 7) for {len(node_paths)} paths"
    array = as_array(poses, wanted, np.float64)
    if not node_paths and array.size == 0:  # [] has the shape (0,)
        array = array.reshape(0, 7)
    if array.shape != (len(node_paths), 7):
        raise ValueError(f"{wanted}, not {array.shape}")
    is_finite, has_rotation = np.isfinite(array).all(axis=1), array[:, 3:].any(axis=1)
    if not is_finite.all():
        raise ValueError(f"pose {is_finite.argmin()} is not finite")
    if not has_rotation.all():
        raise ValueError(f"pose {has_rotation.argmin()} has a quaternion of zeros")
    changes = Changes()
    for path, row in zip(node_paths, array.tolist(), strict=True):  # bodies as of Transform, for many at once
        changes.set_entry(path, Entry(transform={"translation": row[:3], "quaternion": row[3:]}))
    return changes


_NEEDS_SERVER: Final = (
    "MJCF, keyframes, gltf_up='auto', textures=False and viewers other than Scenegate need packages of the server: "
    "pip install 'scenegate[robots]'"
)


if TYPE_CHECKING:
    from scenegate.robots.robot import Joint, JointValue, Robot


class PublishedRobot(NodeHandle):
    """A robot in the viewer: the node of its path, with a node for each link below it. Thread-safe."""

    def __init__(self, viewer: Sender, path: Path, robot: Robot[Geometry], joints: Mapping[str, JointValue]) -> None:
        """Publish the links of a robot. See ``TreeViewer.robot``."""
        super().__init__(viewer, path)
        self._robot = robot
        self._lock = threading.Lock()
        self._values = _checked(joints)
        """Values of joints that have been set, by name."""
        self.warnings = robot.warnings
        """Sentences about content of the file that is not shown."""
        self.notes = robot.notes
        """Sentences about choices that the reader made."""
        self.files = tuple(robot.digests)
        """Files that were read, by path relative to the folder of the robot file, which is first."""
        self._poses = robot.link_poses(self._values)
        """X_robot_link that the viewer shows, (number of links, 4, 4)."""
        changes = Changes().delete(path)
        for link, parts in zip(robot.links, robot.parts, strict=True):
            changes.set_entry((*path, link), Entry([part.body() for part in parts]))
        _add_poses(changes, path, robot.links, self._poses)
        self.answer: Answer = viewer.send(changes)
        """Result of publishing the robot."""
        not_drawn = sum(warning.endswith(NOTHING_DRAWN) for warning in self.answer.warnings)
        self.drawn_count = sum(map(len, robot.parts)) - not_drawn
        """Number of geometries that the viewer draws."""

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links."""
        return self._robot.links

    @property
    def joints(self) -> Mapping[str, Joint]:
        """Joints that move, by name, with their limits."""
        return self._robot.joints

    @property
    def joint_values(self) -> dict[str, tuple[float, ...]]:
        """Values of all joints."""
        return self._robot.joint_values(self._values)

    def set_joints(self, values: Mapping[str, JointValue]) -> Answer:
        """Set joint values. One request has the transforms of all links that move; none is sent if no link moves.

        Args:
            values: Values in radians or metres, by joint name. Other joints keep their values.

        Raises:
            ValueError: There is no such joint, or a value is invalid.
            TreeViewerError, TimeoutError, ConnectionError: See ``TreeViewer.send``.
        """
        with self._lock:
            merged = self._values | _checked(values)
            poses = self._robot.link_poses(merged)
            moved = np.flatnonzero((poses != self._poses).any(axis=(1, 2)))
            changes = Changes()
            _add_poses(changes, self.path, [self.links[index] for index in moved], poses[moved])
            answer = self._sender.send(changes) if moved.size else Answer(OK)
            self._values, self._poses = merged, poses
        return answer


def read_robot_for(
    reads_files: Callable[[], bool],
    file: str | PathLike[str],
    options: dict[str, Any],
    *,
    textures: bool,
    keyframe: str,
) -> Robot[Geometry]:
    """Read a robot file in the form that the viewer shows, by the client's reader or the server's.

    ``reads_files`` returns True if the viewer reads the content of mesh files. ``options`` are arguments of both
    readers; see ``TreeViewer.robot`` for the others and for errors.
    """
    from importlib.metadata import entry_points  # these are slow to import, and most clients publish no robots

    from scenegate.robots.robot_reader import NeedsServerError, read_robot

    needs_server = NeedsServerError(_NEEDS_SERVER)
    if textures and not keyframe and options["gltf_up"] != "auto" and reads_files():
        try:
            return read_robot(fspath(file), **options)
        except NeedsServerError as error:
            needs_server = error
    readers = entry_points(group="scenegate.robots")
    if not readers:
        raise needs_server
    robot: Robot[Geometry] = next(iter(readers)).load()(file, **options, keyframe=keyframe, textures=textures)
    return robot


def _checked(joints: Mapping[str, JointValue]) -> dict[str, JointValue]:
    """Return a copy of joint values; raise ValueError if they are no mapping."""
    if not isinstance(joints, Mapping):
        raise ValueError(f"joint values must be a mapping such as {{'elbow': 0.5}}, not {describe(joints)}")
    return dict(joints)


def _add_poses(changes: Changes, path: Path, links: Iterable[str], poses: NDArray[np.float64]) -> None:
    """Add the transforms of N links of the robot at ``path`` to changes; ``poses`` are X_robot_link, (N, 4, 4)."""
    quaternions = quaternions_of(poses[:, :3, :3]).tolist()
    for link, translation, quaternion in zip(links, poses[:, :3, 3].tolist(), quaternions, strict=True):
        changes.set_entry((*path, link), Entry(transform={"translation": translation, "quaternion": quaternion}))
