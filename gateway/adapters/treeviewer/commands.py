"""Read the commands of a decoded request: ``COMMANDS`` says how each one is read.

Lists of transforms and solids without irregularities are typed objects, which msgspec checks while it decodes them.
Their types may be stricter than the protocol, but not more lenient. All other commands are plain values. Other viewers
ignore the commands that Director does not have; a response lists those of its request.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Union

import msgspec
import numpy as np

from gateway.adapters.treeviewer import fields
from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.context import ReadContext
from gateway.adapters.treeviewer.fields import IDENTITY_QUATERNION, ZERO_TRANSLATION, matrix_of
from gateway.adapters.treeviewer.geometry_reader import read_parts
from gateway.adapters.treeviewer.number_arrays import ArrayError
from gateway.adapters.treeviewer.requests import ControlChange, Finding, Request
from gateway.scene.draw.cameras import LookAtCamera
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.materials import WHITE, material
from gateway.scene.tree.nodes import Path, Pose
from gateway.scene.tree.transforms import IDENTITY
from scenegate.messages.controls import MAX_SAMPLES, MAX_SERIES, AnyControl
from scenegate.messages.field_kinds import MAX_DISTANCE, CommandError, number, numbers, show
from scenegate.messages.geometry import Solid, fields_of
from scenegate.warning_text import strict_refusal

_Coordinate = Annotated[float, msgspec.Meta(ge=-MAX_DISTANCE, le=MAX_DISTANCE)]
_Fraction = Annotated[float, msgspec.Meta(ge=0, le=1)]


class _Transform(msgspec.Struct, gc=False, forbid_unknown_fields=True):
    """Transform from a path's frame to its parent's, or from a geometry's frame to its path's."""

    translation: tuple[_Coordinate, _Coordinate, _Coordinate] = ZERO_TRANSLATION
    quaternion: tuple[_Coordinate, _Coordinate, _Coordinate, _Coordinate] = IDENTITY_QUATERNION


class _SolidMessage(msgspec.Struct, gc=False, kw_only=True, tag_field="type"):
    """Base of the types of solids."""

    color: tuple[_Fraction, _Fraction, _Fraction, _Fraction] = WHITE
    transform: _Transform | None = None


def _solid_type(solid: type[Solid]) -> type[msgspec.Struct]:
    fields: Any = [
        (field.name, field.kind.regular) if field.required else (field.name, field.kind.regular, field.default)
        for field in fields_of(solid)
    ]
    return msgspec.defstruct(
        solid.kind, fields, bases=(_SolidMessage,), gc=False, kw_only=True, tag=solid.kind, forbid_unknown_fields=True
    )


_SOLIDS: Final[Mapping[type[msgspec.Struct], tuple[type[Solid], tuple[str, ...]]]] = {
    _solid_type(solid): (solid, tuple(field.name for field in fields_of(solid))) for solid in Solid.__subclasses__()
}
"""Class of the scene, and its fields, of each type of solid."""


def list_types(limits: Limits) -> dict[str, Any]:
    """Return the types of lists of regular commands within the limits, by name of the command."""
    name = Annotated[str, msgspec.Meta(max_length=limits.element_chars)]
    number = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
    path = Annotated[tuple[name | number, ...], msgspec.Meta(max_length=limits.path_elements)]
    solid: Any = Union[tuple(_SOLIDS)]  # noqa: UP007 - a computed union
    solids = Annotated[list[solid], msgspec.Meta(max_length=limits.parts_per_path)]
    fields: Any = [("path", path), ("geometry", solid | None, None), ("geometries", solids | None, None)]
    options: Any = {"gc": False, "forbid_unknown_fields": True}
    set_geometry: Any = msgspec.defstruct("SetGeometry", fields, **options)
    set_transform: Any = msgspec.defstruct("SetTransform", [("path", path), ("transform", _Transform)], **options)
    return {"setgeometry": list[set_geometry], "settransform": list[set_transform]}


def parts_of(command: Any) -> tuple[Part, ...]:
    """Return the parts of a regular setgeometry command."""
    if command.geometry is not None:
        return (_part(command.geometry),)
    if command.geometries is None:
        raise CommandError("geometries is missing")
    return tuple(map(_part, command.geometries))


def _part(message: _SolidMessage) -> Part:
    solid, names = _SOLIDS[type(message)]
    transform = message.transform
    X_node_part = IDENTITY if transform is None else matrix_of(transform.translation + transform.quaternion)
    return Part(solid(*[getattr(message, name) for name in names]), material(message.color), X_node_part, solid.kind)


_SAMPLE_COLUMNS: Final = tuple(range(2, 2 + MAX_SERIES))


def read_commands(name: str, value: Any, request: Request, context: ReadContext) -> None:
    """Add the commands of one name to the request, and their failures and warnings.

    ``value`` is the decoded list; of a ``single`` command, the command. ``{}`` counts as an empty list, and null
    commands are skipped. An object with a path counts as a list of one command: an example in the protocol's document
    is one.
    """
    command = COMMANDS[name]
    if command.needs_thread:
        context.require_thread()
    failures_before = len(request.failures)
    results: list[Any] = []
    if command.single or (isinstance(value, dict) and "path" in value):
        value = [value]
    elif value == {}:
        value = []
    if not isinstance(value, list):
        request.fail(Finding(name, 0, f"{name} must be a list of commands, not {show(value)}"), context.limits)
    elif command.is_limited and len(value) > (limit := context.limits.controls):
        request.fail(Finding(name, 0, f"{name} has {len(value)} elements, the limit is {limit}"), context.limits)
    elif value and isinstance(value[0], msgspec.Struct):
        _read_regular(name, value, results, request, context)
    else:
        _read_each(name, value, results, request, context)
    if not command.is_atomic:
        getattr(request, command.results).extend(results)
    elif len(request.failures) == failures_before:
        setattr(request, command.results, results[0] if command.single else results)


def _read_regular(name: str, elements: list[Any], results: list[Any], request: Request, context: ReadContext) -> None:
    """Append the results of typed commands: msgspec has checked paths and limits, and nothing was tolerated."""
    read = COMMANDS[name].read_regular
    assert read is not None
    for index, element in enumerate(elements):
        try:
            results.append((element.path, read(element)))
        except CommandError as error:
            request.fail(Finding(name, index, str(error), element.path), context.limits)


def _read_each(name: str, elements: list[Any], results: list[Any], request: Request, context: ReadContext) -> None:
    """Append the results of commands that are plain values."""
    command = COMMANDS[name]
    for index, element in enumerate(elements):
        if element is None:
            continue
        path = None
        try:
            if not isinstance(element, dict):
                raise CommandError(f"{name if command.single else 'a command'} must be an object, not {show(element)}")
            if not command.single:
                path = fields.path(element, context)
            if command.fields:
                fields.check_names(element, command.fields, "the command", context.warnings)
            result = command.read(index, path or (), element, context)
            if context.strict and (refusal := strict_refusal(context.warnings)):
                raise CommandError(refusal)
        except CommandError as error:
            request.fail(Finding(name, index, str(error), path), context.limits)
        else:
            results.append(result)
        request.warnings.extend(Finding(name, index, text, path) for text in context.warnings)
        context.warnings.clear()


def _read_path(_index: int, path: Path, _element: Mapping[str, Any], _context: ReadContext) -> Path:
    """Read ``delete`` or ``setclicks``, which have no other fields."""
    return path


def _read_geometry(
    _index: int, path: Path, element: Mapping[str, Any], context: ReadContext
) -> tuple[Path, tuple[Part, ...]]:
    return path, read_parts(element, context)


def _read_transform(_index: int, path: Path, element: Mapping[str, Any], context: ReadContext) -> tuple[Path, Pose]:
    if "transform" not in element:
        raise CommandError("transform is missing")
    pose = fields.pose(element["transform"], context.warnings)
    if not all(map(math.isfinite, pose)):
        context.warnings.append("transform is not finite, so nothing below it is drawn")
    return path, pose


def _read_property(
    _index: int, path: Path, element: Mapping[str, Any], _context: ReadContext
) -> tuple[Path, bool | None, float | None]:
    visible, opacity = element.get("visible"), element.get("opacity")
    if visible is None and opacity is None:
        raise CommandError("visible and opacity are missing")
    if visible is not None and not isinstance(visible, bool):
        raise CommandError(f"visible must be true or false, not {show(visible)}")
    if opacity is not None:
        opacity = number(opacity, "opacity")
        if not 0.0 <= opacity <= 1.0:
            raise CommandError(f"opacity must be from 0 to 1, not {show(opacity)}")
    return path, visible, opacity


def _read_view(_index: int, _path: Path, element: Mapping[str, Any], _context: ReadContext) -> dict[str, Any]:
    """Return the fields of the page's view that change."""
    changes: dict[str, Any] = {}
    for name, read in (("background", _background), ("grid", _grid), ("home", _home)):
        if name in element:
            changes[name] = None if element[name] is None else read(element[name])
    return changes


def _background(value: Any) -> tuple[float, ...]:
    """Return red, green and blue, sRGB from 0 to 1."""
    color = numbers(value, "background", 3)
    if not all(0.0 <= channel <= 1.0 for channel in color):
        raise CommandError(f"background must have numbers from 0 to 1, not {show(value)}")
    return color


def _grid(value: Any) -> bool:
    if not isinstance(value, bool):
        raise CommandError(f"grid must be true, false or null, not {show(value)}")
    return value


def _home(value: Any) -> LookAtCamera:
    """Return the camera of the page's home view: eye and target in metres, and the direction up, by default +z."""
    if not isinstance(value, dict):
        raise CommandError(f"home must be an object with eye, target and up, not {show(value)}")
    vectors: list[tuple[float, float, float]] = []
    for name, default in (("eye", None), ("target", None), ("up", [0.0, 0.0, 1.0])):
        sent = value.get(name)
        x, y, z = numbers(default if sent is None else sent, f"home.{name}", 3)
        if not max(abs(x), abs(y), abs(z)) <= MAX_DISTANCE:
            raise CommandError(f"home.{name} must have numbers up to {MAX_DISTANCE:g}, not {show(sent)}")
        vectors.append((x, y, z))
    eye, target, up = vectors
    line_of_sight = np.subtract(target, eye)
    distance = float(np.linalg.norm(line_of_sight))
    if not distance > 0.0:
        raise CommandError("home.eye and home.target are the same point")
    up_across_sight = float(np.linalg.norm(np.cross(line_of_sight, up))) / distance  # length of this part of ``up``
    if not up_across_sight > 1e-6 * float(np.linalg.norm(up)):
        raise CommandError("home.up must not be zero nor along the line of sight")
    return LookAtCamera(eye, target, up)


def _read_control(_index: int, path: Path, element: Mapping[str, Any], context: ReadContext) -> AnyControl:
    values = {**element, "path": path}
    if "node" in values:
        values["node"] = fields.path({"path": values["node"]}, context)
    try:
        control: AnyControl = msgspec.convert(values, AnyControl)
    except UnicodeEncodeError:
        raise CommandError("a control has a text that is not Unicode") from None
    except msgspec.ValidationError as error:
        # msgspec: Expected `float`, got `str` - at `$.min`
        reason, __, place = str(error).partition(" - at `$.")
        name = place.rstrip("`")
        clause = f"{name} is {show(values.get(name))}: {reason}" if name in values else str(error)
        raise CommandError(clause) from None
    return control


def _read_value(index: int, path: Path, element: Mapping[str, Any], context: ReadContext) -> ControlChange:
    if ("value" in element) == ("samples" in element):
        raise CommandError("a command has either a value or samples")
    if "value" in element:
        return ControlChange(index, path, element["value"], None)
    try:
        samples = context.arrays.doubles(element["samples"], _SAMPLE_COLUMNS, MAX_SAMPLES)
    except ArrayError as error:
        raise CommandError(f"samples {error}") from None
    return ControlChange(index, path, None, samples)


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """How the commands of one name are read."""

    results: str
    """Field of ``Request`` with what was read."""
    read: Callable[[int, Path, Mapping[str, Any], ReadContext], Any]
    """Returns the result of one command: index in its list, path, fields, context. Raises CommandError."""
    fields: frozenset[str] = frozenset()
    """Names of the fields; others are warned of. Empty: ``read`` checks them."""
    read_regular: Callable[[Any], Any] | None = None
    """Returns what follows the path in the result of a typed command; None: such commands are never typed."""
    older_name: str = ""
    """Director's older name. As in Director, it overrides the newer one."""
    is_newer: bool = True
    """True: Director does not have the command."""
    is_atomic: bool = False
    """True: the result replaces the field, and one invalid command in the list fails all."""
    single: bool = False
    """True: there is one such command, an object without a path, and no list."""
    is_limited: bool = False
    """True: the list has at most ``Limits.controls`` commands."""
    needs_thread: bool = False
    """True: the event loop reads no such command."""


def _fields(*names: str) -> frozenset[str]:
    return frozenset(("path", *names))


COMMANDS: Final[Mapping[str, Command]] = {
    "delete": Command(results="deletes", read=_read_path, fields=_fields(), is_newer=False),
    "setgeometry": Command(
        results="geometries",
        read=_read_geometry,
        fields=_fields("geometry", "geometries"),
        read_regular=parts_of,
        older_name="load",
        is_newer=False,
    ),
    "settransform": Command(
        results="transforms",
        read=_read_transform,
        fields=_fields("transform"),
        read_regular=lambda element: element.transform.translation + element.transform.quaternion,
        older_name="draw",
        is_newer=False,
    ),
    "setproperty": Command(results="properties", read=_read_property, fields=_fields("visible", "opacity")),
    "setview": Command(
        results="view", read=_read_view, fields=frozenset(("background", "grid", "home")), is_atomic=True, single=True
    ),
    "setclicks": Command(results="click_paths", read=_read_path, fields=_fields(), is_atomic=True),
    # 1000 controls take 12 ms
    "setcontrols": Command(results="controls", read=_read_control, is_atomic=True, is_limited=True, needs_thread=True),
    "setvalues": Command(
        results="control_changes", read=_read_value, fields=_fields("value", "samples"), is_limited=True
    ),
}
"""All commands by name, in the order of execution."""
