"""Parses URDF (http://wiki.ros.org/urdf/XML): links, joints, geometry and materials. Reads no other files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.robots.errors import RobotFileError
from gateway.robots.limits import RobotLimits, check_count
from gateway.robots.robot import NEUTRAL, GeometryUse, Joint, JointKind, Mimic
from gateway.robots.urdf_model import UrdfGeometry, UrdfJoint, UrdfLink, UrdfMaterial, UrdfMesh, UrdfModel
from gateway.robots.xml_text import Element, numbers, positive_number, required
from gateway.scene.geometry import Box, Capsule, Cylinder, Sphere

_KINDS: Final[dict[str, JointKind | None]] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "planar": "planar",
    "floating": "floating",
    "fixed": None,
}
"""Kind of a joint, by the attribute ``type``; None: it does not move."""


def parse_urdf(root: Element, limits: RobotLimits) -> UrdfModel:
    """Return the content of a URDF document.

    Raises:
        RobotFileError: An element or attribute is missing or invalid, a name appears twice, or a limit is exceeded.
    """
    for element in root.iter():
        if element.tag.startswith("{") and "xacro" in element.tag:
            raise RobotFileError("it has xacro elements: expand it first, xacro robot.urdf.xacro > robot.urdf")
        _check_attributes(element, limits.max_attribute_chars)
    links, joints = root.findall("link"), root.findall("joint")
    geometry_count = sum(1 for link in links for _ in (*link.iter("visual"), *link.iter("collision")))
    check_count(len(links), limits.max_links, "links")
    check_count(len(joints), limits.max_links, "joints")
    check_count(geometry_count, limits.max_geometries, "geometries")
    if not links:
        raise RobotFileError("it has no links")
    materials = dict(_named_materials(root))
    model = UrdfModel(
        (root.get("name") or "").strip(),
        tuple(_link(link, materials) for link in links),
        tuple(_joint(joint) for joint in joints),
    )
    _check_names("link", [link.name for link in model.links])
    _check_names("joint", [joint.name for joint in model.joints])
    return model


def _check_attributes(element: Element, limit: int) -> None:
    for name, text in element.items():
        if len(text) > limit:
            raise RobotFileError(
                f"{name[:60]}={text[:60]!r}... of <{element.tag[:60]}> has {len(text)} characters, the limit is {limit}"
            )


def _check_names(what: str, names: list[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise RobotFileError(f"two {what}s are called {name!r}")
        seen.add(name)


def _named_materials(root: Element) -> Iterator[tuple[str, UrdfMaterial]]:
    """Yield name and material of each named material with a colour or texture: those of links, then those of the robot.

    A later material overrides an earlier one with the same name.
    """
    for element in (*root.findall("link/visual/material"), *root.findall("material")):
        if name := element.get("name"):
            material = _material(element, f"material {name!r}")
            if material.rgba is not None or material.texture is not None:
                yield name, material


def _material(element: Element, where: str) -> UrdfMaterial:
    color, texture = element.find("color"), element.find("texture")
    rgba = None
    if color is not None:
        r, g, b, a = np.clip(numbers(color, "rgba", (1.0, 1.0, 1.0, 1.0), where), 0.0, 1.0).tolist()
        rgba = (r, g, b, a)
    return UrdfMaterial(rgba, texture.get("filename") if texture is not None else None)


def _link(element: Element, materials: dict[str, UrdfMaterial]) -> UrdfLink:
    name = required(element, "name", "a link")
    visual = tuple(_geometry(child, name, "visual", materials) for child in element.findall("visual"))
    collision = tuple(_geometry(child, name, "collision", materials) for child in element.findall("collision"))
    return UrdfLink(name, visual, collision)


def _geometry(element: Element, link: str, use: GeometryUse, materials: dict[str, UrdfMaterial]) -> UrdfGeometry:
    where = f"link {link!r}, {use}"
    geometry = element.find("geometry")
    shapes = [child for child in geometry if isinstance(child.tag, str)] if geometry is not None else []
    if len(shapes) != 1:
        raise RobotFileError(f"{where}: <geometry> must have one shape, not {len(shapes)}")
    material_element, material = element.find("material"), None
    if material_element is not None:
        material = _material(material_element, where)
        if material.rgba is None and material.texture is None:
            material = materials.get(material_element.get("name") or "")
    return UrdfGeometry(_shape(shapes[0], where), _origin(element, where), material)


def _shape(element: Element, where: str) -> Box | Sphere | Cylinder | Capsule | UrdfMesh:
    if element.tag == "box":
        required(element, "size", where)
        x, y, z = numbers(element, "size", (1.0, 1.0, 1.0), where)
        return Box((abs(x), abs(y), abs(z)))
    if element.tag == "sphere":
        return Sphere(positive_number(element, "radius", where))
    if element.tag == "cylinder":
        return Cylinder(positive_number(element, "radius", where), positive_number(element, "length", where))
    if element.tag == "capsule":
        return Capsule(positive_number(element, "radius", where), positive_number(element, "length", where))
    if element.tag == "mesh":
        text = element.get("scale", "")
        if len(text.split()) == 1:  # one number, as some exporters write
            (factor,) = numbers(element, "scale", (1.0,), where)
            scale = (factor, factor, factor)
        else:
            x, y, z = numbers(element, "scale", (1.0, 1.0, 1.0), where)
            scale = (x, y, z)
        return UrdfMesh(required(element, "filename", where), scale)
    raise RobotFileError(f"{where}: the shape <{element.tag}> is not one of box, sphere, cylinder, capsule, mesh")


def _joint(element: Element) -> UrdfJoint:
    name = required(element, "name", "a joint")
    where = f"joint {name!r}"
    urdf_type = required(element, "type", where)
    if urdf_type not in _KINDS:
        raise RobotFileError(f"{where}: its type {urdf_type!r} is not one of {', '.join(_KINDS)}")
    ends = []
    for end in ("parent", "child"):
        child = element.find(end)
        if child is None:
            raise RobotFileError(f"{where} has no <{end}>")
        ends.append(required(child, "link", where))
    axis = numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0), where)
    norm = math.hypot(*axis)
    kind = _KINDS[urdf_type]
    if kind not in (None, "floating") and not 0.0 < norm < math.inf:
        raise RobotFileError(f"{where}: its axis is {'zero' if norm == 0.0 else 'too long'}")
    x, y, z = (component / (norm or 1.0) for component in axis)
    limit = element.find("limit")
    limits = None
    if limit is not None and urdf_type in ("revolute", "prismatic"):
        (lower,), (upper,) = numbers(limit, "lower", (0.0,), where), numbers(limit, "upper", (0.0,), where)
        limits = (lower, upper)
    joint = None if kind is None else Joint(name, kind, NEUTRAL[kind], limits, _mimic(element, where))
    return UrdfJoint(name, ends[0], ends[1], _origin(element, where), (x, y, z), joint)


def _mimic(element: Element, where: str) -> Mimic | None:
    mimic = element.find("mimic")
    if mimic is None:
        return None
    (multiplier,), (offset,) = numbers(mimic, "multiplier", (1.0,), where), numbers(mimic, "offset", (0.0,), where)
    return Mimic(required(mimic, "joint", where), (offset, multiplier))


def _origin(element: Element, where: str) -> NDArray[np.float64]:
    """Return the (4, 4) pose of ``<origin xyz rpy>``: metres and radians, R = Rz(yaw) Ry(pitch) Rx(roll)."""
    origin = element.find("origin")
    roll, pitch, yaw = numbers(origin, "rpy", (0.0, 0.0, 0.0), where)
    sines, cosines = np.sin((roll, pitch, yaw)).tolist(), np.cos((roll, pitch, yaw)).tolist()
    (sr, sp, sy), (cr, cp, cy) = sines, cosines
    X = np.eye(4)
    X[:3, :3] = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    X[:3, 3] = numbers(origin, "xyz", (0.0, 0.0, 0.0), where)
    return X
