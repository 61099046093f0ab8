"""Content of a URDF or SDF file as dataclasses, which ``urdf`` and ``sdf`` create, and its forward kinematics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from scenegate.robots.robot import Joint, without_invalid_mimics
from scenegate.robots.robot_errors import RobotFileError
from scenegate.transforms import IDENTITY, from_pose, rotation_from_z

LinkShape: TypeAlias = "Box | Sphere | Ellipsoid | Cylinder | Capsule | Cone | MeshReference"


@dataclass(frozen=True, slots=True)
class Cone:
    """A cone along z, centred on the origin, with its tip at the top."""

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class MeshReference:
    """A mesh file."""

    filename: str
    """File name or URL, as in the robot file."""
    scale: tuple[float, float, float]
    """Factors along the mesh's x, y and z; negative ones mirror it."""
    submesh: str = ""
    """Name of the node of a COLLADA file that is shown, as in SDF; empty: all of them."""
    center: bool = False
    """True: before it is scaled, the mesh is moved so that the centre of its bounds is at the origin."""


@dataclass(frozen=True, slots=True)
class LinkMaterial:
    """A material."""

    rgba: tuple[float, float, float, float] | None
    """sRGB and opacity, 0 to 1; None: the file gives no colour."""
    texture: str | None
    """Name of an image file; None: the material has none."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkGeometry:
    """Visual or collision geometry of a link."""

    shape: LinkShape
    X_link_geometry: NDArray[np.float64]
    """(4, 4) float64: pose of the geometry in the link's frame."""
    material: LinkMaterial | None
    """None: the file gives none."""


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A link."""

    name: str
    geometries: tuple[LinkGeometry, ...]
    """Geometries of the use that the caller asked for, ``GeometryUse``."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkJoint:
    """A joint, fixed joints included."""

    name: str
    parent: str
    """Name of the parent link."""
    child: str
    """Name of the child link."""
    X_parent_joint: NDArray[np.float64]
    """(4, 4) float64: pose of the joint's frame in the parent's."""
    axis: tuple[float, float, float]
    """Unit vector in the joint's frame."""
    motion: Joint | None
    """Kind, default value, limits and mimic rule; None: the joint is fixed."""
    X_joint_child: NDArray[np.float64] = field(default_factory=lambda: IDENTITY)  # an array is no valid default
    """(4, 4) float64: pose of the child in the joint's frame at the neutral value. In URDF it is the identity."""
    pitch: float = 0.0
    """Translation of a revolute joint along its axis, metres per radian: that of a screw."""
    second_axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Second axis of a universal joint: a unit vector in the frame that has turned about the first one."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkModel:
    """Content of a URDF or SDF file."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[LinkJoint, ...]
    X_robot_root: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """(4, 4) float64 poses of links without a parent, by name; default: the identity. Empty for URDF."""

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the links."""
        return tuple(link.name for link in self.links)

    def moving_joints(self, warnings: list[str]) -> dict[str, Joint]:
        """Return the joints that move, by name; each invalid mimic rule is left out and adds a warning."""
        joints = {joint.name: joint.motion for joint in self.joints if joint.motion is not None}
        return without_invalid_mimics(joints, warnings)


class LinkKinematics:
    """Forward kinematics of a tree of joints."""

    def __init__(self, model: LinkModel) -> None:
        """Raises RobotFileError if a link has two parents, or joints form a cycle."""
        links = [link.name for link in model.links]
        ordered = _parents_first(links, model.joints)
        self._X_rest = np.array([model.X_robot_root.get(name, IDENTITY) for name in links])
        """X_robot_link of links without a parent, the identity for others, (number of links, 4, 4)."""
        index = {name: number for number, name in enumerate(links)}
        self._ends = [(index[joint.parent], index[joint.child]) for joint in ordered]
        """Indices of the parent and child link of each joint, parents first."""
        self._X_parent_joint = np.array([joint.X_parent_joint for joint in ordered]).reshape(-1, 4, 4)
        self._X_joint_child = np.array([joint.X_joint_child for joint in ordered]).reshape(-1, 4, 4)
        kinds = [joint.motion.kind if joint.motion is not None else None for joint in ordered]
        self._revolute = np.array([i for i, kind in enumerate(kinds) if kind == "revolute"], np.intp)
        self._prismatic = np.array([i for i, kind in enumerate(kinds) if kind == "prismatic"], np.intp)
        self._other_joints = [
            (i, kind) for i, kind in enumerate(kinds) if kind in ("universal", "ball", "planar", "floating")
        ]
        """Index and kind of each joint with several values."""
        self._names = [joint.name for joint in ordered]
        self._axes = np.array([joint.axis for joint in ordered]).reshape(-1, 3)
        self._second_axes = np.array([joint.second_axis for joint in ordered]).reshape(-1, 3)
        self._pitches = np.array([joint.pitch for joint in ordered])

    def link_poses(self, values: Mapping[str, tuple[float, ...]]) -> NDArray[np.float64]:
        """Return X_robot_link, (number of links, 4, 4) float64, for the values of all joints."""
        X_motion = np.tile(np.eye(4), (len(self._ends), 1, 1))
        if len(self._revolute):
            q = np.array([values[self._names[i]][0] for i in self._revolute])
            X_motion[self._revolute, :3, :3] = _rotations(self._axes[self._revolute], q)
            X_motion[self._revolute, :3, 3] = (q * self._pitches[self._revolute])[:, None] * self._axes[self._revolute]
        if len(self._prismatic):
            q = np.array([values[self._names[i]] for i in self._prismatic])
            X_motion[self._prismatic, :3, 3] = q * self._axes[self._prismatic]
        for i, kind in self._other_joints:
            value = values[self._names[i]]
            if kind == "planar":
                X_motion[i] = _planar(self._axes[i], value)
            elif kind == "universal":
                axes = np.stack((self._axes[i], self._second_axes[i]))
                X_motion[i, :3, :3] = np.matmul(*_rotations(axes, np.array(value)))
            else:
                X_motion[i] = from_pose(value[:-4] or (0.0, 0.0, 0.0), value[-4:])
        X_parent_child = self._X_parent_joint @ X_motion @ self._X_joint_child
        X_robot_link = self._X_rest.copy()
        for (parent, child), X in zip(self._ends, X_parent_child, strict=True):
            X_robot_link[child] = X_robot_link[parent] @ X
        return X_robot_link


def _rotations(axes: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotations about unit vectors, (N, 3, 3), by Rodrigues' formula: R = I + sin q K + (1 - cos q) K²."""
    K = np.zeros((len(axes), 3, 3))
    K[:, (2, 0, 1), (1, 2, 0)] = axes
    K -= K.swapaxes(1, 2).copy()  # K v = axis × v
    q = angles[:, None, None]
    return np.asarray(np.eye(3) + (np.sin(q) * K + (1.0 - np.cos(q)) * (K @ K)))


def _planar(normal: NDArray[np.float64], value: Sequence[float]) -> NDArray[np.float64]:
    """Return the motion of a planar joint, (4, 4): a translation in the plane, and a rotation about its unit normal.

    As in Drake and MuJoCo, the plane's axes are those of ``rotation_from_z``. ``value``: x and y in metres, angle in
    radians.
    """
    X = np.eye(4)
    X[:3, :3] = _rotations(normal[None], np.array([value[2]]))[0]
    X[:3, 3] = rotation_from_z(normal)[:, :2] @ value[:2]
    return X


def _parents_first(links: Sequence[str], joints: Sequence[LinkJoint]) -> list[LinkJoint]:
    """Return the joints, each after the joints above it. Raises RobotFileError if they do not form a tree."""
    children: dict[str, list[LinkJoint]] = {name: [] for name in links}
    parent_of: dict[str, LinkJoint] = {}
    for joint in joints:
        other = parent_of.setdefault(joint.child, joint)
        if other is not joint:
            raise RobotFileError(f"link {joint.child!r} is the child of two joints, {other.name!r} and {joint.name!r}")
        children[joint.parent].append(joint)
    ordered: list[LinkJoint] = []
    remaining = [name for name in links if name not in parent_of]
    while remaining:
        below = children[remaining.pop()]
        ordered += below
        remaining += [joint.child for joint in below]
    if len(ordered) != len(joints):
        reached = {joint.name for joint in ordered}
        cycle = [joint.name for joint in joints if joint.name not in reached]
        raise RobotFileError(f"the joints {', '.join(cycle[:8])} form a circle: the links must be a tree")
    return ordered
