"""Parses the visual or collision geometry of URDF: shapes, poses and materials."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from gateway.robots.robot import GeometryUse
from gateway.robots.urdf_model import UrdfGeometry, UrdfMaterial, UrdfMesh, UrdfShape
from gateway.robots.xml_text import (
    Element,
    InvalidAttributeError,
    attribute,
    finite_numbers,
    numbers,
    origin,
    required_numbers,
)
from gateway.scene.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere

_SHAPES: Final = ("box", "sphere", "cylinder", "capsule", "ellipsoid", "mesh", "drake:capsule", "drake:ellipsoid")
_LARGEST_UNIT_COLOR: Final = 2.0
"""Colours with a larger number have the range 0 to 255."""
_ROUNDING: Final = 1e-3
"""Colours beyond 0 or 1 by less than this are clamped without a warning."""


class UrdfGeometryReader:
    """Reads the geometry of links."""

    def __init__(self, root: Element, use: GeometryUse, warnings: list[str]) -> None:
        """
        Args:
            root: Root element, which has materials that geometry refers to by name.
            use: Geometry to read.
            warnings: Warnings are appended to this list.
        """
        self._use = use
        self._warnings = warnings
        self._materials = dict(self._named_materials(root)) if use == "visual" else {}

    def geometries(self, link: Element, name: str) -> tuple[UrdfGeometry, ...]:
        """Return the geometries of a link. Those without a shape that can be drawn are left out with a warning."""
        where = f"link {name!r}, {self._use}"
        geometries = []
        for element in link.findall(self._use):
            try:
                shape = self._shape(element.find("geometry"), where)
            except InvalidAttributeError as error:
                self._warnings.append(f"{where}: {error}; it is not shown")
                continue
            X = origin(element, where, self._warnings)
            geometries.append(UrdfGeometry(shape, X, self._material_of(element, where)))
        return tuple(geometries)

    def _shape(self, geometry: Element | None, where: str) -> UrdfShape:
        """Return the shape of a ``<geometry>``; raises InvalidAttributeError if it has none that can be drawn."""
        shapes = list(geometry) if geometry is not None else []
        known = [shape for shape in shapes if shape.tag in _SHAPES]
        if not shapes:
            raise InvalidAttributeError("it has no shape")
        if not known:
            raise InvalidAttributeError(f"the shape <{shapes[0].tag[:60]}> is unknown")
        if len(known) > 1:
            self._warnings.append(f"{where}: it has {len(known)} shapes, only the first, <{known[0].tag}>, is shown")
        element = known[0]
        match element.tag:
            case "box":
                return self._box(element, where)
            case "sphere":
                (radius,) = self._sizes(element, where, "radius")
                return Sphere(radius)
            case "cylinder":
                radius, length = self._sizes(element, where, "radius", "length")
                return Cylinder(radius, length)
            case "capsule" | "drake:capsule":
                radius, length = self._sizes(element, where, "radius", "length")
                return Capsule(radius, length)
            case "drake:ellipsoid":
                a, b, c = self._sizes(element, where, "a", "b", "c")
                return Ellipsoid((a, b, c))
            case "ellipsoid":
                x, y, z = _positive(element, "radii", *required_numbers(element, "radii", 3, where, self._warnings))
                return Ellipsoid((x, y, z))
            case _:
                return self._mesh(element, where)

    def _sizes(self, element: Element, where: str, *names: str) -> list[float]:
        """Return attributes that are one number above 0 each."""
        return [
            value
            for name in names
            for value in _positive(element, name, *required_numbers(element, name, 1, where, self._warnings))
        ]

    def _box(self, element: Element, where: str) -> Box:
        x, y, z = required_numbers(element, "size", 3, where, self._warnings)
        if min(x, y, z) < 0.0 or (x, y, z).count(0.0) > 1:
            raise InvalidAttributeError(f"size={attribute(element, 'size')[:60]!r} of <box> must be above 0")
        return Box((x, y, z))  # with one length of 0, it is a sheet

    def _mesh(self, element: Element, where: str) -> UrdfMesh:
        filename = attribute(element, "filename")
        if not filename:
            raise InvalidAttributeError("<mesh> has no filename")
        if len(attribute(element, "scale").split()) == 1:  # one number, as some exporters write
            (factor,) = numbers(element, "scale", (1.0,), where, self._warnings)
            return UrdfMesh(filename, (factor, factor, factor))
        x, y, z = numbers(element, "scale", (1.0, 1.0, 1.0), where, self._warnings)
        return UrdfMesh(filename, (x, y, z))

    def _named_materials(self, root: Element) -> Iterator[tuple[str, UrdfMaterial]]:
        """Yield name and material of each named material with a colour or texture: those of links, then the robot's.

        A later material overrides an earlier one with the same name.
        """
        for element in (*root.findall("link/visual/material"), *root.findall("material")):
            if name := element.get("name"):
                material = self._material(element, f"material {name!r}")
                if material.rgba is not None or material.texture is not None:
                    yield name, material

    def _material_of(self, element: Element, where: str) -> UrdfMaterial | None:
        material_element = element.find("material")
        if material_element is None or self._use == "collision":
            return None
        name = material_element.get("name")
        material = self._material(material_element, f"material {name!r}" if name else where)
        if material.rgba is None and material.texture is None:
            return self._materials.get(name or "")
        return material

    def _material(self, element: Element, where: str) -> UrdfMaterial:
        color, texture = element.find("color"), element.find("texture")
        rgba = None if color is None else self._rgba(color, where)
        return UrdfMaterial(rgba, attribute(texture, "filename") or None)

    def _rgba(self, color: Element, where: str) -> tuple[float, float, float, float]:
        """Return sRGB and opacity, 0 to 1. Without an opacity, it is 1."""
        values: tuple[float, ...] = finite_numbers(color.get("rgba", ""))
        if len(values) == 3:
            self._warnings.append(f"{where}: rgba={color.get('rgba')!r} has no opacity, 1 is used")
            values = (*values, 1.0)
        else:
            values = numbers(color, "rgba", (1.0, 1.0, 1.0, 1.0), where, self._warnings)
        r, g, b, a = values
        scaled = [*_unit_range((r, g, b)), *_unit_range((a,))]
        if scaled != list(values):
            how = "read as 0 to 255" if max(values) > _LARGEST_UNIT_COLOR else "clamped to 0 to 1"
            self._warnings.append(f"{where}: rgba={color.get('rgba')!r} is {how}")
        r, g, b, a = np.clip(scaled, 0.0, 1.0).tolist()
        return r, g, b, a


def _unit_range(values: tuple[float, ...]) -> list[float]:
    """Return numbers from 0 to 1, but for rounding errors. If one is above 2, all are read as 0 to 255."""
    divisor = 255.0 if max(values) > _LARGEST_UNIT_COLOR else 1.0
    return [
        value if -_ROUNDING <= (value := number / divisor) <= 1.0 + _ROUNDING else min(max(value, 0.0), 1.0)
        for number in values
    ]


def _positive(element: Element, name: str, *values: float) -> tuple[float, ...]:
    if min(values) <= 0.0:
        raise InvalidAttributeError(f"{name}={attribute(element, name)[:60]!r} of <{element.tag}> must be above 0")
    return values
