"""Parses the visual or collision geometry of SDF links."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scenegate.messages.geometry import Box
from scenegate.robots.link_model import Cone, LinkGeometry, LinkMaterial, LinkShape, MeshReference
from scenegate.robots.robot import GeometryUse
from scenegate.robots.robot_files import color_of
from scenegate.robots.sdf_frames import read_pose
from scenegate.robots.xml_text import (
    Element,
    InvalidAttributeError,
    children_as_attributes,
    is_true,
    named_elements,
    numbers,
    read_color,
    read_shape,
    sizes,
)
from scenegate.transforms import IDENTITY, rotation_from_z

_GAZEBO_COLORS: Final[dict[str, tuple[float, float, float]]] = {
    "Black": (0.0, 0.0, 0.0),
    "Blue": (0.0, 0.0, 1.0),
    "DarkGray": (0.175, 0.175, 0.175),
    "DarkGrey": (0.175, 0.175, 0.175),
    "DarkYellow": (0.7, 0.7, 0.0),
    "FlatBlack": (0.1, 0.1, 0.1),
    "Gold": (0.8, 0.64869, 0.120759),
    "Gray": (0.7, 0.7, 0.7),
    "Green": (0.0, 1.0, 0.0),
    "Grey": (0.7, 0.7, 0.7),
    "Indigo": (0.33, 0.0, 0.5),
    "Orange": (1.0, 0.5088, 0.0468),
    "Purple": (1.0, 0.0, 1.0),
    "Red": (1.0, 0.0, 0.0),
    "RedBright": (0.87, 0.26, 0.07),
    "SkyBlue": (0.0, 0.0, 1.0),
    "Turquoise": (0.0, 1.0, 1.0),
    "White": (1.0, 1.0, 1.0),
    "Yellow": (1.0, 1.0, 0.0),
    "ZincYellow": (0.9725, 0.9529, 0.2078),
}
"""Diffuse colours of Gazebo's own material scripts, which are named ``Gazebo/Red``."""

_DEFAULT_SIZES: Final[dict[str, dict[str, str]]] = {
    "box": {"size": "1 1 1"},
    "capsule": {"radius": "0.5", "length": "1"},
    "cone": {"radius": "1", "length": "1"},
    "cylinder": {"radius": "1", "length": "1"},
    "ellipsoid": {"radii": "1 1 1"},
    "sphere": {"radius": "1"},
}
"""Sizes that shapes have without elements of their own, in the format's specification."""


def read_geometries(
    link: Element, name: str, use: GeometryUse, X_link: Callable[[str], NDArray[np.float64]], warnings: list[str]
) -> tuple[LinkGeometry, ...]:
    """Return the geometries of a link. Those without a shape that can be drawn are left out with a warning.

    ``X_link`` returns X_link_frame, (4, 4), for the name of a frame of the model.
    """
    geometries = []
    for element, where in named_elements(link, use, f"link {name!r}, {use}"):
        if element.find("geometry/empty") is not None:
            continue
        X, relative_to = read_pose(element, where, warnings)
        if relative_to:
            X = X_link(relative_to) @ X
        try:
            shape, X_shape = _shape(element.find("geometry"), where, warnings)
        except InvalidAttributeError as error:
            warnings.append(f"{where}: {error}; it is not shown")
            continue
        material = _material(element, where, warnings)
        (transparency,) = numbers(children_as_attributes(element), "transparency", (0.0,), where, warnings)
        if transparency > 0.0:
            r, g, b, opacity = color_of(material)
            color = r, g, b, opacity * max(1.0 - transparency, 0.0)
            material = LinkMaterial(color, None if material is None else material.texture)
        geometries.append(LinkGeometry(shape, X @ X_shape, material))
    return tuple(geometries)


def _shape(geometry: Element | None, where: str, warnings: list[str]) -> tuple[LinkShape, NDArray[np.float64]]:
    """Return a shape and its pose in the geometry's frame; raises InvalidAttributeError if it cannot be drawn."""
    if geometry is None:
        raise InvalidAttributeError("it has no shape")
    plane = geometry.find("plane")
    if plane is not None:
        return _plane(plane, where, warnings)
    as_urdf = Element("geometry")
    for shape in map(children_as_attributes, geometry):
        shape.attrib = _DEFAULT_SIZES.get(shape.tag, {}) | shape.attrib
        if shape.tag == "cone":
            radius, length = sizes(shape, where, warnings, "radius", "length")
            return Cone(radius, length), IDENTITY
        if "uri" in shape.attrib:
            shape.set("filename", shape.attrib["uri"])
        as_urdf.append(shape)
    read = read_shape(as_urdf, where, warnings)
    submesh = geometry.find("mesh/submesh")
    if submesh is not None and isinstance(read, MeshReference):
        center = is_true(submesh.findtext("center"))
        read = replace(read, submesh=(submesh.findtext("name") or "").strip(), center=center)
    return read, IDENTITY


def _plane(plane: Element, where: str, warnings: list[str]) -> tuple[Box, NDArray[np.float64]]:
    """Return a plane as a box of height 0, and the (4, 4) rotation from +z to its normal, as in Gazebo."""
    texts = children_as_attributes(plane)
    width, height = numbers(texts, "size", (1.0, 1.0), where, warnings)
    normal = np.array(numbers(texts, "normal", (0.0, 0.0, 1.0), where, warnings))
    length = float(np.linalg.norm(normal))
    if min(width, height) <= 0.0 or not 0.0 < length < np.inf:
        raise InvalidAttributeError("size and normal of <plane> must be above 0")
    X = np.eye(4)
    X[:3, :3] = rotation_from_z(normal / length)
    return Box((width, height, 0.0)), X


def _material(element: Element, where: str, warnings: list[str]) -> LinkMaterial | None:
    material = element.find("material")
    if material is None:
        return None
    texture = (material.findtext("pbr/metal/albedo_map") or "").strip() or None
    texts = children_as_attributes(material)
    for name in ("diffuse", "ambient"):
        if name in texts.attrib:
            if len(texts.attrib[name].split()) == 3:
                texts.set(name, f"{texts.attrib[name]} 1")
            return LinkMaterial(read_color(texts, name, where, warnings), texture)
    script = (material.findtext("script/name") or "").strip()
    if not script:
        return LinkMaterial(None, texture)
    color = _GAZEBO_COLORS.get(script.removeprefix("Gazebo/"))
    if color is not None:
        return LinkMaterial((*color, 1.0), texture)
    warnings.append(f"{where}: the material script {script[:60]!r} is not read, the default colour is used")
    return LinkMaterial(None, texture)
