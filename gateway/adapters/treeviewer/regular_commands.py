"""msgspec types of lists of regular commands, which msgspec checks while it decodes them.

They have transforms and solids without irregularities. Decoding fails for all other lists, and ``request_reader`` then
reads them command by command. A type here may be stricter than the protocol, but not more lenient.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Final, Union

import msgspec

from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.fields import IDENTITY_QUATERNION, ZERO_TRANSLATION, matrix_of
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.materials import WHITE, material
from gateway.scene.tree.transforms import IDENTITY
from scenegate.messages.field_kinds import MAX_DISTANCE, CommandError
from scenegate.messages.geometry import Solid, fields_of

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
