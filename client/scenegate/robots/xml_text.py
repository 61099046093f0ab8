"""Parses XML, and the elements that URDF and SDF have in common: shapes, colours, joint types, axes, mimic rules.

In all functions, ``where`` is the start of a warning: the link or joint of the element. Warnings are appended to
the list ``warnings``.
"""

import codecs
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from scenegate.robots.link_model import LinkShape, MeshReference
from scenegate.robots.robot import JointKind, Mimic
from scenegate.robots.robot_errors import RobotFileError
from scenegate.transforms import from_pose

Element = ElementTree.Element

MAX_DEPTH: Final = 10_000
"""Maximum depth of XML elements. Bodies of MJCF files contain each other: a chain of 1000 links has as many levels."""


def parse_xml(data: bytes, max_elements: int, warnings: list[str]) -> Element:
    """Return the root element. Tags and attributes keep their prefixes, which need no declaration: ``drake:capsule``.

    As in ROS, Drake and MuJoCo, some invalid XML is accepted: white space before the XML declaration; with a warning,
    other text in comments and Latin-1 in place of UTF-8. Raises RobotFileError if the data is not XML, declares
    entities, or has more elements or levels than allowed.
    """
    if not data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = data.strip(b" \t\r\n\0")
    forbidden = "comments before its declaration, with -- inside or in another encoding, which XML forbids, are ignored"
    attempts = (
        (False, None, ""),
        (True, None, forbidden),
        (True, "iso-8859-1", "it is not in the encoding that it names; it is read as Latin-1"),
    )
    reason = ""
    for without_comments, encoding, warning in attempts:
        text = _remove_comments(data).lstrip() if without_comments else data
        try:
            root = _parse(text, max_elements, encoding)
        except (expat.ExpatError, LookupError) as error:  # LookupError: an unknown encoding
            reason = reason or str(error)
            continue
        if warning:
            warnings.append(warning)
        return root
    raise RobotFileError(f"it is not XML: {reason}")


def _parse(data: bytes, max_elements: int, encoding: str | None = None) -> Element:
    """Return the root element of XML; see ``parse_xml`` for the limits. ``encoding`` overrides that of the file."""
    # Without a namespace separator, expat accepts prefixes that are not declared.
    parser = expat.ParserCreate(encoding)
    builder = ElementTree.TreeBuilder()
    count = depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > max_elements:
            raise RobotFileError(f"it has more than {max_elements} XML elements, which is the limit")
        if depth > MAX_DEPTH:
            raise RobotFileError(f"its XML has more than {MAX_DEPTH} levels, which is the limit")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def entity(name: str, *_: object) -> NoReturn:  # entities could expand to gigabytes
        raise RobotFileError(f"it declares the XML entity {name[:60]!r}: files with entities are refused")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = entity
    parser.Parse(data, True)
    return builder.close()


def uses_xacro(root: Element) -> bool:
    """Return True if a document has elements of xacro, under any prefix that it declares for them."""
    prefixes = {"xacro"}
    for element in root.iter():
        prefixes |= {
            name.removeprefix("xmlns:") for name, url in element.items() if name.startswith("xmlns:") and "xacro" in url
        }
    return any(element.tag.partition(":")[0] in prefixes for element in root.iter() if ":" in element.tag)


def _remove_comments(data: bytes) -> bytes:
    """Return the data without comments, including those with ``--`` inside."""
    pieces, position = [], 0
    while (start := data.find(b"<!--", position)) >= 0 and (end := data.find(b"-->", start + 4)) >= 0:
        pieces.append(data[position:start])
        position = end + 3
    return b"".join((*pieces, data[position:]))


def named_elements(parent: Element, tag: str, where: str) -> Iterator[tuple[Element, str]]:
    """Yield the children of a tag, each with the ``where`` of its warnings.

    If there are several, their names, or else numbers, tell them apart: ``link 'arm', visual 'hand'``.
    """
    elements = parent.findall(tag)
    for number, element in enumerate(elements, 1):
        name = element.get("name")
        label = repr(name) if name else str(number)
        yield element, where if len(elements) == 1 else f"{where} {label}"


class InvalidAttributeError(ValueError):
    """An attribute that is missing or invalid. The message has its name and value."""


def attribute(element: Element | None, name: str) -> str:
    """Return an attribute without surrounding space; empty if it is missing."""
    return "" if element is None else (element.get(name) or "").strip()


def is_true(text: str | None) -> bool:
    """Return True for a text that libsdformat reads so: true in any case, as Python prints it, or 1."""
    return (text or "").strip().lower() in ("true", "1")


def numbers(
    element: Element | None, name: str, default: tuple[float, ...], where: str, warnings: list[str]
) -> tuple[float, ...]:
    """Return finite numbers, as many as the default; it if the attribute is missing or, with a warning, invalid."""
    if element is None or name not in element.attrib:
        return default
    try:
        return required_numbers(element, name, len(default), where, warnings)
    except InvalidAttributeError as error:
        used = " ".join(f"{value:g}" for value in default)
        warnings.append(f"{where}: {error}, {used} {'is' if len(default) == 1 else 'are'} used")
        return default


def required_numbers(element: Element, name: str, count: int, where: str, warnings: list[str]) -> tuple[float, ...]:
    """Return the first ``count`` numbers of an attribute, which are finite; raises InvalidAttributeError.

    Commas are read as spaces. Commas and surplus numbers add a warning.
    """
    if name not in element.attrib:
        raise InvalidAttributeError(f"<{element.tag}> has no {name}")
    text = element.attrib[name]
    values = finite_numbers(text)
    shown = f"{name}={text[:60]!r} of <{element.tag}>"
    if len(values) < count:
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        raise InvalidAttributeError(f"{shown} must be {expected}")
    if len(values) > count:
        warnings.append(f"{where}: {shown} has {len(values)} numbers, the first {count} are used")
    elif "," in text:
        warnings.append(f"{where}: {shown} has commas, which are read as spaces")
    return values[:count]


def finite_numbers(text: str) -> tuple[float, ...]:
    """Return the numbers of a text, separated by white space or commas; none if one of them is not a finite number."""
    try:
        values = tuple(float(number) for number in text.replace(",", " ").split())
    except ValueError:
        return ()
    return values if all(map(math.isfinite, values)) else ()


def pose_of_origin(element: Element, where: str, warnings: list[str]) -> NDArray[np.float64]:
    """Return the (4, 4) pose of ``<origin xyz rpy>``, metres and radians; the identity if there is none.

    The attribute ``quat_xyzw`` of URDF 1.1 comes before ``rpy``.
    """
    child = element.find("origin")
    if child is None:
        return np.eye(4)
    rpy = numbers(child, "rpy", (0.0, 0.0, 0.0), where, warnings)
    xyz = numbers(child, "xyz", (0.0, 0.0, 0.0), where, warnings)
    if "quat_xyzw" not in child.attrib:
        return pose_of_rpy(xyz, rpy)
    if "rpy" in child.attrib:
        warnings.append(f"{where}: <origin> has rpy and quat_xyzw, which is used")
    x, y, z, w = numbers(child, "quat_xyzw", (0.0, 0.0, 0.0, 1.0), where, warnings)
    return from_pose(xyz, (w, x, y, z))


def pose_of_rpy(xyz: Sequence[float], rpy: Sequence[float]) -> NDArray[np.float64]:
    """Return a (4, 4) pose with R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy).tolist(), np.cos(rpy).tolist()
    X = np.eye(4)
    X[:3, :3] = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    X[:3, 3] = xyz
    return X


def children_as_attributes(element: Element) -> Element:
    """Return an SDF element in URDF's form: the texts of its child elements become attributes."""
    texts = {child.tag: (child.text or "").strip() for child in element if not len(child)}
    return ElementTree.Element(element.tag, {**texts, **element.attrib})


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
    """Return an attribute as sRGB and opacity, 0 to 1. Without an opacity, or with surplus numbers, it is 1."""
    values: tuple[float, ...] = finite_numbers(element.get(name, ""))
    if len(values) == 3 or len(values) > 4:
        shown = f"{name}={element.get(name, '')[:60]!r} has {len(values)} numbers"
        warnings.append(f"{where}: {shown}: the first 3 are used, with the opacity 1")
        values = (*values[:3], 1.0)
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
