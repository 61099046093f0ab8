"""Content of a URDF or SDF file as dataclasses, which ``urdf`` and ``sdf`` create."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from scenegate.robots.robot import Joint, without_invalid_mimics
from scenegate.transforms import IDENTITY

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
