"""Parses URDF (http://wiki.ros.org/urdf/XML) and Drake's extensions of it. Reads no other files.

Elements and attributes that are invalid are left out or get a default, with a warning.
"""

from __future__ import annotations

from scenegate.robots.errors import RobotFileError, no_links
from scenegate.robots.limits import RobotFileLimits, check_count
from scenegate.robots.link_model import Link, LinkModel
from scenegate.robots.robot import GeometryUse
from scenegate.robots.sdf_frames import WORLD
from scenegate.robots.urdf_geometry import UrdfGeometryReader
from scenegate.robots.urdf_joints import JOINT_TAGS, UrdfJointReader
from scenegate.robots.xml_text import Element, attribute


def parse_urdf(root: Element, use: GeometryUse, limits: RobotFileLimits, warnings: list[str]) -> LinkModel:
    """Return the content of a URDF document.

    Args:
        use: Geometry to return; the other one is not read.

    Raises:
        RobotFileError: There are no links, two links have the same name, or a limit is exceeded.
    """
    for element in root.iter():
        _check_attributes(element, limits.max_attribute_chars)
    link_elements = root.findall("link")
    joint_elements = [child for child in root if child.tag in JOINT_TAGS]
    check_count(len(link_elements), limits.max_links, "links")
    check_count(len(joint_elements), limits.max_links, "joints")
    check_count(sum(len(link.findall(use)) for link in link_elements), limits.max_geometries, "geometries")
    reader = UrdfGeometryReader(root, use, warnings)
    links: dict[str, Link] = {}
    for element in link_elements:
        name = attribute(element, "name")
        if not name:
            warnings.append("a <link> has no name, it is left out")
            continue
        if name in links:
            raise RobotFileError(f"two links are called {name!r}")
        links[name] = Link(name, reader.geometries(element, name))
    if not links:
        raise no_links(warnings)
    if any(attribute(joint.find("parent"), "link") == WORLD for joint in joint_elements):
        links.setdefault(WORLD, Link(WORLD, ()))  # in Drake and Gazebo, it needs no <link>
    joints = UrdfJointReader(links, warnings).read(joint_elements)
    return LinkModel(attribute(root, "name"), tuple(links.values()), joints)


def _check_attributes(element: Element, limit: int) -> None:
    for name, text in element.items():
        if len(text) > limit:
            raise RobotFileError(
                f"{name[:60]}={text[:60]!r}... of <{element.tag[:60]}> has {len(text)} characters, the limit is {limit}"
            )
