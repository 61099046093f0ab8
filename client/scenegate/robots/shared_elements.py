"""Parses what URDF and SDF have in common: shapes, also those of Drake, colours, joint types, axes, mimic rules."""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from scenegate.robots.link_model import LinkShape, MeshReference
from scenegate.robots.robot import JointKind, Mimic
from scenegate.robots.xml_text import (
    Element,
    InvalidAttributeError,
    attribute,
    finite_numbers,
    numbers,
    required_numbers,
)

_SHAPES: Final = ("box", "sphere", "cylinder", "capsule", "ellipsoid", "mesh", "drake:capsule", "drake:ellipsoid")
_LARGEST_UNIT_COLOR: Final = 2.0
"""Colours with a larger component are read as 0 to 255."""
_ROUNDING: Final = 1e-3
"""Colours beyond 0 or 1 by less than this are clamped without a warning."""


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
    if kind in ("revolute", "prismatic", "universal", "planar"):
        problem = "zero" if norm == 0.0 else "too long"
        warnings.append(f"{where}: its axis is {problem}; the joint stays at rest")
        kind = None
    return (1.0, 0.0, 0.0), kind
