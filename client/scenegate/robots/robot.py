"""A robot: links with geometry, joints, and the poses of the links for joint values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Generic, Literal, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scenegate.name_hint import name_hint
from scenegate.robots.robot_errors import RobotFileError

PartType = TypeVar("PartType")
"""Type of the geometry: ``Geometry`` to publish, or the server's own."""
GeometryUse = Literal["visual", "collision"]
"""Use of a link's geometry: to show it, or to check for collisions in a simulation."""
JointKind = Literal["revolute", "prismatic", "universal", "ball", "planar", "floating"]
"""Kind of a joint that moves. ``revolute`` includes URDF's ``continuous``, and screws."""
JointValue: TypeAlias = ArrayLike
"""Value of a joint: a number, or a sequence; see ``NEUTRAL``."""
MAX_MIMIC_CHAIN: Final = 100
"""Maximum length of a chain of joints that mimic each other. Each joint's value is computed along its whole chain, so a
chain of N joints takes N² steps. Robots have fewer than 10."""

NEUTRAL: Final[Mapping[JointKind, tuple[float, ...]]] = {
    "revolute": (0.0,),
    "prismatic": (0.0,),
    "universal": (0.0, 0.0),
    "ball": (1.0, 0.0, 0.0, 0.0),
    "planar": (0.0, 0.0, 0.0),
    "floating": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
}
"""Values of the zero configuration. Angles are in radians, lengths in metres. ``universal``: angles about both axes.
``ball``: a quaternion [w, x, y, z]. ``planar``: x, y and the angle. ``floating``: x, y, z and a quaternion
[w, x, y, z]."""

_UNITS: Final[Mapping[JointKind, Literal["rad", "m"]]] = {"revolute": "rad", "prismatic": "m"}


@dataclass(frozen=True, slots=True)
class Mimic:
    """Rule of a joint that follows another joint, its leader: a polynomial of the leader's value."""

    joint: str
    """Name of the leader."""
    coefficients: tuple[float, ...]
    """c0, c1, …: value = c0 + c1 q + c2 q² + …, where q is the leader's value minus ``reference``."""
    reference: float = 0.0
    """Value of the leader for q = 0, radians or metres."""

    def value(self, leader: float) -> float:
        """Return the value of the joint for the leader's value."""
        q, value = leader - self.reference, 0.0
        for coefficient in reversed(self.coefficients):  # Horner's scheme overflows to infinity, where ** raises
            value = value * q + coefficient
        return value


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint that moves. Fixed joints are only part of the ``Kinematics``."""

    name: str
    kind: JointKind
    default: tuple[float, ...]
    """Value in the file's initial configuration; see ``NEUTRAL`` for order and units."""
    limits: tuple[float, float] | None = None
    """Lowest and highest value, for information; values beyond are accepted. None: no limits."""
    mimic: Mimic | None = None
    """Rule that applies while no value is given for the joint; None: the default applies."""

    @property
    def unit(self) -> Literal["rad", "m", ""]:
        """Unit of the value and its limits; empty for joints with several values, see ``NEUTRAL``."""
        return _UNITS.get(self.kind, "")


class Kinematics(Protocol):
    """Forward kinematics: computes the poses of links."""

    def link_poses(self, values: Mapping[str, tuple[float, ...]]) -> NDArray[np.float64]:
        """Return X_robot_link, (number of links, 4, 4) float64, for the values of all joints."""


@dataclass(frozen=True, slots=True, eq=False)
class Robot(Generic[PartType]):
    """A robot as its file describes it. Z is up, lengths are in metres."""

    name: str
    links: tuple[str, ...]
    """Names of the links, which are unique."""
    joints: Mapping[str, Joint]
    """Joints that move, by name, in the order of the file."""
    parts: tuple[tuple[PartType, ...], ...]
    """Geometry of each link, in the link's frame."""
    kinematics: Kinematics
    warnings: tuple[str, ...] = ()
    """Sentences about content of the file that is not shown."""
    notes: tuple[str, ...] = ()
    """Sentences about choices that the reader made."""
    digests: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 in hexadecimal of the files that were read, by path relative to the robot file's folder. The robot file
    is first."""

    def joint_values(self, values: Mapping[str, JointValue]) -> dict[str, tuple[float, ...]]:
        """Return the values of all joints. The others follow the joint that they mimic, or have their defaults.

        Raises RobotFileError if there is no such joint, or a value has the wrong length, a number that is not finite,
        or a quaternion of zeros.
        """
        given = {name: self._value_of(name, value) for name, value in values.items()}
        complete = {}
        for name, joint in self.joints.items():
            value = given.get(name)
            if value is None:
                value = joint.default if joint.mimic is None else (self._mimicked_value(joint, given),)
            complete[name] = value
        return complete

    def link_poses(self, values: Mapping[str, JointValue]) -> NDArray[np.float64]:
        """Return X_robot_link, (number of links, 4, 4). Values as for ``joint_values``.

        Raises RobotFileError as ``joint_values``, or if a pose is not finite, since numbers are too large.
        """
        joint_values = self.joint_values(values)
        with np.errstate(all="ignore"):
            poses = self.kinematics.link_poses(joint_values)
        if not np.isfinite(poses).all():
            link = self.links[int(np.argmin(np.isfinite(poses).all(axis=(1, 2))))]
            raise RobotFileError(f"the pose of the link {link!r} is not finite: numbers that lead to it are too large")
        return poses

    def _value_of(self, name: str, value: JointValue) -> tuple[float, ...]:
        """Return a given value as a tuple; raises RobotFileError if the joint cannot have it."""
        joint = self.joints.get(name)
        if joint is None:
            raise RobotFileError(f"the robot has no joint {name!r}{name_hint(name, self.joints)}")
        try:
            numbers = np.atleast_1d(np.asarray(value, np.float64))
        except (TypeError, ValueError):  # a text, or lists of different lengths
            numbers = np.empty(0)
        count = len(joint.default)
        if numbers.shape != (count,) or not np.isfinite(numbers).all():
            expected = "one finite number" if count == 1 else f"{count} finite numbers"
            raise RobotFileError(f"the value of the {joint.kind} joint {name!r} must be {expected}, not {value!r}")
        if joint.kind in ("ball", "floating") and not np.any(numbers[-4:]):
            raise RobotFileError(f"the quaternion of the joint {name!r} must not be zero")
        return tuple(numbers.tolist())

    def _mimicked_value(self, joint: Joint, given: Mapping[str, tuple[float, ...]]) -> float:
        """Return the value of a joint that follows a leader, which may follow another one."""
        rules: list[Mimic] = []
        leader = joint
        while leader.mimic is not None and leader.name not in given:
            rules.append(leader.mimic)
            leader = self.joints[leader.mimic.joint]
        (value,) = given.get(leader.name, leader.default)
        for rule in reversed(rules):
            value = rule.value(value)
        return value


def without_invalid_mimics(joints: Mapping[str, Joint], warnings: list[str]) -> dict[str, Joint]:
    """Return the joints without invalid mimic rules, each of which adds a warning.

    A rule is invalid if its leader does not exist, has several values or follows the joint itself, or if the chain of
    leaders is too long.
    """
    valid = dict(joints)
    for joint in joints.values():
        reason = _mimic_problem(joint, valid)
        if reason is not None:
            warnings.append(f"joint {joint.name!r}: {reason}; it does not follow another joint")
            valid[joint.name] = replace(joint, mimic=None)
    return valid


def _mimic_problem(joint: Joint, joints: Mapping[str, Joint]) -> str | None:
    """Return the reason why a joint cannot follow its leader; None if it can, or follows none."""
    follower, chain = joint, [joint.name]
    while follower.mimic is not None:
        leader = joints.get(follower.mimic.joint)
        if leader is None:
            name = follower.mimic.joint
            return f"it mimics {name!r}, which is not a joint that moves{name_hint(name, joints)}"
        if len(leader.default) != 1 or len(follower.default) != 1:
            return f"it cannot mimic {leader.name!r}, as one of them has several values"
        if leader.name in chain[1:]:
            return None  # a circle of other joints, one of which loses its rule
        if leader.name == joint.name:
            return f"the joints {', '.join(chain)} mimic each other in a circle"
        if len(chain) > MAX_MIMIC_CHAIN:
            return f"it mimics a chain of more than {MAX_MIMIC_CHAIN} joints, which is the limit"
        chain.append(leader.name)
        follower = leader
    return None
