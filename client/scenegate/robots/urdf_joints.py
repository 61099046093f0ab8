"""Parses the joints of URDF. A joint that cannot move gets a warning and is fixed."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from typing import Final

from scenegate.name_hint import name_hint
from scenegate.robots.link_model import LinkJoint
from scenegate.robots.robot import NEUTRAL, Joint, JointKind, Mimic
from scenegate.robots.xml_text import Element, attribute, numbers, pose_of_origin

JOINT_TAGS: Final = ("joint", "drake:joint")
_KINDS: Final[dict[str, JointKind | None]] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "planar": "planar",
    "floating": "floating",
    "fixed": None,
}
"""Kind of a joint, by the attribute ``type``; None: it does not move."""


class UrdfJointReader:
    """Reads the joints of a robot."""

    def __init__(self, links: Collection[str], warnings: list[str]) -> None:
        """
        Args:
            links: Names of the links.
        """
        self._links = links
        self._warnings = warnings

    def read(self, elements: list[Element]) -> tuple[LinkJoint, ...]:
        """Return the joints. A joint without parent or child is left out; a repeated name is made unique."""
        joints: dict[str, LinkJoint] = {}
        for index, element in enumerate(elements):
            name = attribute(element, "name")
            unique = name or f"joint_{index}"
            while unique in joints:
                unique += "_"
            where = f"joint {name!r}" if name else f"joint {index}"
            if unique != name:
                reason = "a second joint has this name" if name else "it has no name"
                self._warnings.append(f"{where}: {reason}, it is called {unique!r}")
            for joint in self._joint(element, unique, where):
                joints[unique] = joint
        return tuple(joints.values())

    def _joint(self, element: Element, name: str, where: str) -> Iterator[LinkJoint]:
        """Yield a joint; nothing if it does not join two links."""
        ends = []
        for tag in ("parent", "child"):
            link = attribute(element.find(tag), "link")
            if link not in self._links:
                hint = name_hint(link, self._links)
                reason = f"there is no link {link[:60]!r}{hint}" if link else f"it has no <{tag} link>"
                self._warnings.append(f"{where}: {reason}; the joint is left out")
                return
            ends.append(link)
        urdf_type = attribute(element, "type")
        kind = joint_kind(urdf_type, _KINDS, where, self._warnings)
        x, y, z = numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0), where, self._warnings)
        axis, kind = unit_axis((x, y, z), kind, where, self._warnings)
        motion = None
        if kind is not None:
            limit, limits = element.find("limit"), None
            if urdf_type in ("revolute", "prismatic") and limit is not None:
                (lower,) = numbers(limit, "lower", (0.0,), where, self._warnings)
                (upper,) = numbers(limit, "upper", (0.0,), where, self._warnings)
                limits = lower, upper
            mimic = read_mimic(element.find("mimic"), where, self._warnings)
            motion = Joint(name, kind, NEUTRAL[kind], limits, mimic)
        yield LinkJoint(name, ends[0], ends[1], pose_of_origin(element, where, self._warnings), axis, motion)


def read_mimic(mimic: Element | None, where: str, warnings: list[str]) -> Mimic | None:
    """Return the rule of a ``<mimic>``; None if there is none. Only SDF has a ``reference``."""
    if mimic is None:
        return None
    (multiplier,) = numbers(mimic, "multiplier", (1.0,), where, warnings)
    (offset,) = numbers(mimic, "offset", (0.0,), where, warnings)
    (reference,) = numbers(mimic, "reference", (0.0,), where, warnings)
    return Mimic(attribute(mimic, "joint"), (offset, multiplier), reference)


def joint_kind(name: str, kinds: Mapping[str, JointKind | None], where: str, warnings: list[str]) -> JointKind | None:
    """Return the kind of a joint by its type in the file; None, with a warning, for an unknown type."""
    if name not in kinds:
        warnings.append(f"{where}: type={name[:60]!r} is not one of {', '.join(kinds)}; the joint stays at rest")
    return kinds.get(name)


def unit_axis(
    axis: tuple[float, float, float], kind: JointKind | None, where: str, warnings: list[str]
) -> tuple[tuple[float, float, float], JointKind | None]:
    """Return an axis of unit length and the joint's kind: None, with a warning, if it cannot move about the axis."""
    x, y, z = axis
    norm = math.hypot(x, y, z)
    if 0.0 < norm < math.inf:
        return (x / norm, y / norm, z / norm), kind
    if kind in ("revolute", "prismatic", "planar"):
        problem = "zero" if norm == 0.0 else "too long"
        warnings.append(f"{where}: its axis is {problem}; the joint stays at rest")
        kind = None
    return (1.0, 0.0, 0.0), kind
