"""Parses the shapes of robot files: ``<geometry>`` of URDF, with Drake's extensions."""

from __future__ import annotations

from typing import Final

from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from scenegate.robots.link_model import LinkShape, MeshReference
from scenegate.robots.xml_text import Element, InvalidAttributeError, attribute, numbers, required_numbers

_SHAPES: Final = ("box", "sphere", "cylinder", "capsule", "ellipsoid", "mesh", "drake:capsule", "drake:ellipsoid")


def read_shape(geometry: Element | None, where: str, warnings: list[str]) -> LinkShape:
    """Return the shape of a ``<geometry>``; raises InvalidAttributeError if it has none that can be drawn."""
    shapes = list(geometry) if geometry is not None else []
    known = [shape for shape in shapes if shape.tag in _SHAPES]
    if not shapes:
        raise InvalidAttributeError("it has no shape")
    if not known:
        raise InvalidAttributeError(f"the shape <{shapes[0].tag[:60]}> is not supported")
    if len(known) > 1:
        warnings.append(f"{where}: it has {len(known)} shapes, only the first, <{known[0].tag}>, is shown")
    element = known[0]
    match element.tag:
        case "box":
            return _box(element, where, warnings)
        case "sphere":
            (radius,) = sizes(element, where, warnings, "radius")
            return Sphere(radius)
        case "cylinder":
            radius, length = sizes(element, where, warnings, "radius", "length")
            return Cylinder(radius, length)
        case "capsule" | "drake:capsule":
            radius, length = sizes(element, where, warnings, "radius", "length")
            return Capsule(radius, length)
        case "drake:ellipsoid":
            a, b, c = sizes(element, where, warnings, "a", "b", "c")
            return Ellipsoid((a, b, c))
        case "ellipsoid":
            x, y, z = _positive(element, "radii", *required_numbers(element, "radii", 3, where, warnings))
            return Ellipsoid((x, y, z))
        case _:
            return _mesh(element, where, warnings)


def sizes(element: Element, where: str, warnings: list[str], *names: str) -> list[float]:
    """Return the named attributes, one positive number each; raises InvalidAttributeError."""
    return [
        value
        for name in names
        for value in _positive(element, name, *required_numbers(element, name, 1, where, warnings))
    ]


def _box(element: Element, where: str, warnings: list[str]) -> Box:
    x, y, z = required_numbers(element, "size", 3, where, warnings)
    if min(x, y, z) < 0.0 or (x, y, z).count(0.0) > 1:
        raise InvalidAttributeError(f"size={attribute(element, 'size')[:60]!r} of <box> must be above 0")
    return Box((x, y, z))  # with one length of 0, it is a sheet


def _mesh(element: Element, where: str, warnings: list[str]) -> MeshReference:
    filename = attribute(element, "filename")
    if not filename:
        raise InvalidAttributeError("<mesh> has no filename")
    if len(attribute(element, "scale").split()) == 1:  # one number, as some exporters write
        (factor,) = numbers(element, "scale", (1.0,), where, warnings)
        return MeshReference(filename, (factor, factor, factor))
    x, y, z = numbers(element, "scale", (1.0, 1.0, 1.0), where, warnings)
    return MeshReference(filename, (x, y, z))


def _positive(element: Element, name: str, *values: float) -> tuple[float, ...]:
    if min(values) <= 0.0:
        raise InvalidAttributeError(f"{name}={attribute(element, name)[:60]!r} of <{element.tag}> must be above 0")
    return values
