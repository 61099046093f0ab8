"""Parses URDF (http://wiki.ros.org/urdf/XML) and Drake's extensions of it. Reads no other files.

Elements and attributes that are invalid are left out or get a default, with a warning.
"""

import math
from collections.abc import Iterator
from typing import Final

from scenegate.name_hint import name_hint
from scenegate.robots.link_model import Link, LinkGeometry, LinkJoint, LinkMaterial, LinkModel
from scenegate.robots.robot import NEUTRAL, GeometryUse, Joint, JointKind
from scenegate.robots.robot_errors import RobotFileError, RobotFileLimits, check_count, no_links
from scenegate.robots.sdf_frames import WORLD
from scenegate.robots.xml_text import (
    Element,
    InvalidAttributeError,
    attribute,
    joint_kind,
    named_elements,
    numbers,
    pose_of_origin,
    read_color,
    read_mimic,
    read_shape,
    unit_axis,
)

_JOINT_TAGS: Final = ("joint", "drake:joint")
_KINDS: Final[dict[str, JointKind | None]] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "planar": "planar",
    "floating": "floating",
    "ball": "ball",
    "spherical": "ball",
    "screw": "revolute",
    "universal": "universal",
    "fixed": None,
}
"""Kind of a joint, by the attribute ``type``; None: it does not move. ``ball``, ``screw`` and ``universal`` are
Drake's, ``spherical`` is PyBullet's."""


def parse_urdf(root: Element, use: GeometryUse, limits: RobotFileLimits, warnings: list[str]) -> LinkModel:
    """Return the content of a URDF document; geometry of the other use is not read. Raises RobotFileError."""
    for element in root.iter():
        for name, text in element.items():
            if len(text) > limits.max_attribute_chars:
                start = f"{name[:60]}={text[:60]!r}... of <{element.tag[:60]}>"
                raise RobotFileError(f"{start} has {len(text)} characters, the limit is {limits.max_attribute_chars}")
    if attribute(root, "version") in ("", "1", "1.0") and any(
        "quat_xyzw" in each.attrib for each in root.iter("origin")
    ):
        warnings.append('quat_xyzw of <origin> is ignored, as by ROS, without version="1.1" of <robot>')
        for element in root.iter("origin"):
            element.attrib.pop("quat_xyzw", None)
    link_elements = root.findall("link")
    joint_elements = [child for child in root if child.tag in _JOINT_TAGS]
    check_count(len(link_elements), limits.max_links, "links")
    check_count(len(joint_elements), limits.max_links, "joints")
    check_count(sum(len(link.findall(use)) for link in link_elements), limits.max_geometries, "geometries")
    return _UrdfReader(root, use, warnings).read(attribute(root, "name"), link_elements, joint_elements)


class _UrdfReader:
    """Reads one document."""

    def __init__(self, root: Element, use: GeometryUse, warnings: list[str]) -> None:
        self._use = use
        self._warnings = warnings
        self._links: dict[str, Link] = {}
        self._materials = dict(self._named_materials(root)) if use == "visual" else {}
        self._undefined: set[str] = set()
        """Names of materials for which there is a warning."""

    def read(self, robot_name: str, link_elements: list[Element], joint_elements: list[Element]) -> LinkModel:
        for element in link_elements:
            name = attribute(element, "name")
            if not name:
                self._warnings.append("a <link> has no name, it is left out")
                continue
            if name in self._links:
                self._warnings.append(f"a second link is called {name!r}, it is left out")
                continue
            self._links[name] = Link(name, tuple(self._geometries(element, name)))
        if not self._links:
            raise no_links(self._warnings)
        if any(attribute(joint.find("parent"), "link") == WORLD for joint in joint_elements):
            self._links.setdefault(WORLD, Link(WORLD, ()))  # in Drake and Gazebo, it needs no <link>
        return LinkModel(robot_name, tuple(self._links.values()), tuple(self._joints(joint_elements)))

    def _joints(self, elements: list[Element]) -> Iterator[LinkJoint]:
        """Yield the joints that join two links. A repeated name is made unique."""
        used: set[str] = set()
        for index, element in enumerate(elements):
            name = attribute(element, "name")
            unique = name or f"joint_{index}"
            while unique in used:
                unique += "_"
            where = f"joint {name!r}" if name else f"joint {index}"
            if unique != name:
                reason = "a second joint has this name" if name else "it has no name"
                self._warnings.append(f"{where}: {reason}, it is called {unique!r}")
            joint = self._joint(element, unique, where)
            if joint is not None:
                used.add(unique)
                yield joint

    def _joint(self, element: Element, name: str, where: str) -> LinkJoint | None:
        """Return a joint; None, with a warning, if it does not join two links."""
        ends = []
        for tag in ("parent", "child"):
            link = attribute(element.find(tag), "link")
            if link not in self._links:
                hint = name_hint(link, self._links)
                reason = f"there is no link {link[:60]!r}{hint}" if link else f"it has no <{tag} link>"
                self._warnings.append(f"{where}: {reason}; the joint is left out")
                return None
            ends.append(link)
        urdf_type = attribute(element, "type")
        kind = joint_kind(urdf_type, _KINDS, where, self._warnings)
        x, y, z = numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0), where, self._warnings)
        axis, kind = unit_axis((x, y, z), kind, where, self._warnings)
        if kind == "universal":
            axis = (1.0, 0.0, 0.0)  # in Drake, always x, then y
        pitch = 0.0
        if urdf_type == "screw":
            thread = element.find("drake:screw_thread_pitch")
            pitch = numbers(thread, "value", (0.0,), where, self._warnings)[0] / math.tau
        motion = None
        if kind is not None:
            limit, limits = element.find("limit"), None
            if urdf_type in ("revolute", "prismatic") and limit is not None:
                (lower,) = numbers(limit, "lower", (0.0,), where, self._warnings)
                (upper,) = numbers(limit, "upper", (0.0,), where, self._warnings)
                limits = lower, upper
            mimic = read_mimic(element.find("mimic"), where, self._warnings)
            motion = Joint(name, kind, NEUTRAL[kind], limits, mimic)
        X_parent_joint = pose_of_origin(element, where, self._warnings)
        return LinkJoint(name, ends[0], ends[1], X_parent_joint, axis, motion, pitch=pitch)

    def _geometries(self, link: Element, name: str) -> Iterator[LinkGeometry]:
        """Yield the geometries of a link. Those without a shape that can be drawn are left out with a warning."""
        for element, where in named_elements(link, self._use, f"link {name!r}, {self._use}"):
            try:
                shape = read_shape(element.find("geometry"), where, self._warnings)
            except InvalidAttributeError as error:
                self._warnings.append(f"{where}: {error}; it is not shown")
                continue
            X = pose_of_origin(element, where, self._warnings)
            yield LinkGeometry(shape, X, self._material_of(element, where))

    def _named_materials(self, root: Element) -> Iterator[tuple[str, LinkMaterial]]:
        """Yield name and material of each named material with a colour or texture: those of links, then the robot's.

        A later material overrides an earlier one with the same name.
        """
        for element in (*root.findall("link/visual/material"), *root.findall("material")):
            if name := element.get("name"):
                material = self._material(element, f"material {name!r}")
                if material is not None:
                    yield name, material

    def _material_of(self, element: Element, where: str) -> LinkMaterial | None:
        material_element = element.find("material")
        if material_element is None or self._use == "collision":
            return None
        name = material_element.get("name")
        material = self._material(material_element, f"material {name!r}" if name else where)
        if material is not None:
            return material
        if name and name not in self._materials and name not in self._undefined:
            self._undefined.add(name)
            self._warnings.append(f"{where}: material {name!r} is not defined; what has it is grey")
        return self._materials.get(name or "")

    def _material(self, element: Element, where: str) -> LinkMaterial | None:
        """Return a material; None if it has neither colour nor texture."""
        color, texture = element.find("color"), attribute(element.find("texture"), "filename") or None
        if color is None and texture is None:
            return None
        return LinkMaterial(None if color is None else read_color(color, "rgba", where, self._warnings), texture)
