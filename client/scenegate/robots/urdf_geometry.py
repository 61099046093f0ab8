"""Parses the visual or collision geometry of URDF: shapes, poses and materials."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from scenegate.robots.link_model import LinkGeometry, LinkMaterial
from scenegate.robots.robot import GeometryUse
from scenegate.robots.urdf_shapes import read_shape
from scenegate.robots.xml_text import (
    Element,
    InvalidAttributeError,
    attribute,
    finite_numbers,
    named_elements,
    numbers,
    pose_of_origin,
)

_LARGEST_UNIT_COLOR: Final = 2.0
"""Colours with a larger component are read as 0 to 255."""
_ROUNDING: Final = 1e-3
"""Colours beyond 0 or 1 by less than this are clamped without a warning."""


class UrdfGeometryReader:
    """Reads the geometry of links."""

    def __init__(self, root: Element, use: GeometryUse, warnings: list[str]) -> None:
        """
        Args:
            root: Root element, which has materials that geometry refers to by name.
            use: Geometry to read.
        """
        self._use = use
        self._warnings = warnings
        self._undefined: set[str] = set()
        """Names of materials for which there is a warning."""
        self._materials = dict(self._named_materials(root)) if use == "visual" else {}

    def geometries(self, link: Element, name: str) -> tuple[LinkGeometry, ...]:
        """Return the geometries of a link. Those without a shape that can be drawn are left out with a warning."""
        geometries = []
        for element, where in named_elements(link, self._use, f"link {name!r}, {self._use}"):
            try:
                shape = read_shape(element.find("geometry"), where, self._warnings)
            except InvalidAttributeError as error:
                self._warnings.append(f"{where}: {error}; it is not shown")
                continue
            X = pose_of_origin(element, where, self._warnings)
            geometries.append(LinkGeometry(shape, X, self._material_of(element, where)))
        return tuple(geometries)

    def _named_materials(self, root: Element) -> Iterator[tuple[str, LinkMaterial]]:
        """Yield name and material of each named material with a colour or texture: those of links, then the robot's.

        A later material overrides an earlier one with the same name.
        """
        for element in (*root.findall("link/visual/material"), *root.findall("material")):
            if name := element.get("name"):
                material = self._material(element, f"material {name!r}")
                if material.rgba is not None or material.texture is not None:
                    yield name, material

    def _material_of(self, element: Element, where: str) -> LinkMaterial | None:
        material_element = element.find("material")
        if material_element is None or self._use == "collision":
            return None
        name = material_element.get("name")
        material = self._material(material_element, f"material {name!r}" if name else where)
        if material.rgba is not None or material.texture is not None:
            return material
        if name and name not in self._materials and name not in self._undefined:
            self._undefined.add(name)
            self._warnings.append(f"{where}: material {name!r} is not defined; what has it is grey")
        return self._materials.get(name or "")

    def _material(self, element: Element, where: str) -> LinkMaterial:
        color, texture = element.find("color"), element.find("texture")
        rgba = None if color is None else read_color(color, "rgba", where, self._warnings)
        return LinkMaterial(rgba, attribute(texture, "filename") or None)


def read_color(element: Element, name: str, where: str, warnings: list[str]) -> tuple[float, float, float, float]:
    """Return an attribute as sRGB and opacity, 0 to 1. Without an opacity, it is 1."""
    values: tuple[float, ...] = finite_numbers(element.get(name, ""))
    if len(values) == 3:
        warnings.append(f"{where}: {name}={element.get(name)!r} has no opacity, 1 is used")
        values = (*values, 1.0)
    else:
        values = numbers(element, name, (1.0, 1.0, 1.0, 1.0), where, warnings)
    r, g, b, a = values
    scaled = [*_unit_range((r, g, b)), *_unit_range((a,))]
    if scaled != list(values):
        how = "read as 0 to 255" if max(values) > _LARGEST_UNIT_COLOR else "clamped to 0 to 1"
        warnings.append(f"{where}: {name}={element.get(name)!r} is {how}")
    r, g, b, a = np.clip(scaled, 0.0, 1.0).tolist()
    return r, g, b, a


def _unit_range(values: tuple[float, ...]) -> list[float]:
    """Clamp numbers to 0 to 1, except rounding errors. If one is above 2, divide all by 255 first."""
    divisor = 255.0 if max(values) > _LARGEST_UNIT_COLOR else 1.0
    return [
        value if -_ROUNDING <= (value := number / divisor) <= 1.0 + _ROUNDING else min(max(value, 0.0), 1.0)
        for number in values
    ]
