"""Robots in the tree viewer: ``PublishedRobot`` sends the geometry once, then the transforms of links that move."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from scenegate.messages.arguments import describe
from scenegate.messages.changes import Changes, Entry, Path
from scenegate.messages.geometry import Geometry
from scenegate.messages.wire import OK
from scenegate.transforms import quaternions_of
from scenegate.tree.answer import Answer
from scenegate.tree.node_handles import NodeHandle, Sender
from scenegate.warning_text import NOTHING_DRAWN

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
