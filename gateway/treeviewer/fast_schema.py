"""What well-behaved clients send most, as types: msgspec reads and checks it in one go, ten times faster than we could.

Whatever does not fit (other geometries, oddities, mistakes) makes the decoder fail, and the lenient reader takes over,
which knows all oddities and gives reasons. So nothing here decides what is right, only what is fast.
"""

from __future__ import annotations

from typing import Annotated, Any, Final

import msgspec

from gateway.scene.geometry import Box, Capsule, Cylinder, Ellipsoid, Part, Shape, Sphere
from gateway.scene.transforms import IDENTITY, from_pose
from gateway.scene.tree import Path, Pose
from gateway.treeviewer import fields
from gateway.treeviewer.config import Limits
from gateway.treeviewer.geometry import material

_Size = Annotated[float, msgspec.Meta(ge=0.0, le=fields.FARTHEST)]
_Place = Annotated[float, msgspec.Meta(ge=-fields.FARTHEST, le=fields.FARTHEST)]
_Unit = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
_WHITE: Final = (1.0, 1.0, 1.0, 1.0)


class Transform(msgspec.Struct, gc=False):
    """A transform of settransform; any number goes."""

    translation: tuple[float, float, float] | None = fields.ZERO_TRANSLATION
    quaternion: tuple[float, float, float, float] | None = fields.IDENTITY_QUATERNION

    def pose(self) -> Pose:
        t, q = self.translation or fields.ZERO_TRANSLATION, self.quaternion or fields.IDENTITY_QUATERNION
        return t + q


class _Placement(msgspec.Struct, gc=False):
    """A geometry's own transform; it goes into vertices, so it must be finite."""

    translation: tuple[_Place, _Place, _Place] = fields.ZERO_TRANSLATION
    quaternion: tuple[_Place, _Place, _Place, _Place] = fields.IDENTITY_QUATERNION


class _Solid(msgspec.Struct, gc=False, tag_field="type"):
    """What all geometries have in common."""

    color: tuple[_Unit, _Unit, _Unit, _Unit] = _WHITE
    transform: _Placement | None = None

    def shape(self) -> Shape:
        """What it stands for; every type says it."""
        raise NotImplementedError


class _Box(_Solid, tag="box", kw_only=True):
    lengths: tuple[_Size, _Size, _Size]

    def shape(self) -> Shape:
        return Box(self.lengths)


class _Sphere(_Solid, tag="sphere", kw_only=True):
    radius: _Size

    def shape(self) -> Shape:
        return Sphere(self.radius)


class _Ellipsoid(_Solid, tag="ellipsoid", kw_only=True):
    radii: tuple[_Size, _Size, _Size]

    def shape(self) -> Shape:
        return Ellipsoid(self.radii)


class _Cylinder(_Solid, tag="cylinder", kw_only=True):
    radius: _Size
    length: _Size

    def shape(self) -> Shape:
        return Cylinder(self.radius, self.length)


class _Capsule(_Solid, tag="capsule", kw_only=True):
    radius: _Size
    length: _Size

    def shape(self) -> Shape:
        return Capsule(self.radius, self.length)


_AnySolid = _Box | _Sphere | _Ellipsoid | _Cylinder | _Capsule


class Message(msgspec.Struct, gc=False):
    """What all messages have in common; the lists are typed by ``message_types``."""

    delete: Any = None
    load: Any = msgspec.UNSET
    draw: Any = msgspec.UNSET


def message_types(limits: Limits) -> tuple[type, type, type]:
    """Messages with ``setgeometry`` and ``settransform`` typed, and the commands of both; paths are held to limits."""
    name = Annotated[str, msgspec.Meta(max_length=limits.element_chars)]
    number = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
    path = Annotated[tuple[name | number, ...], msgspec.Meta(max_length=limits.path_elements)]
    solids = Annotated[list[_AnySolid], msgspec.Meta(max_length=limits.parts_per_path)]
    set_geometry = msgspec.defstruct(
        "SetGeometry",
        [("path", path), ("geometry", _AnySolid | None, None), ("geometries", solids | None, None)],
        gc=False,
    )
    set_transform = msgspec.defstruct("SetTransform", [("path", path), ("transform", Transform)], gc=False)
    empty = dict[str, Any]
    message = msgspec.defstruct(
        "TypedMessage",
        [
            ("setgeometry", list[set_geometry] | empty | None, None),  # type: ignore[valid-type]  # made above
            ("settransform", list[set_transform] | empty | None, None),  # type: ignore[valid-type]  # made above
        ],
        bases=(Message,),
        gc=False,
    )
    return message, set_geometry, set_transform


def parts_of(command: Any) -> tuple[Part, ...] | None:
    """The parts of a typed setgeometry command; None: it has neither ``geometry`` nor ``geometries``."""
    if command.geometry is not None:
        return (_part(command.geometry),)
    if command.geometries is not None:
        return tuple([_part(solid) for solid in command.geometries])
    return None


def transforms_of(commands: list[Any]) -> list[tuple[Path, Pose]]:
    """Typed settransform commands."""
    return [(command.path, command.transform.pose()) for command in commands]


def _part(solid: _Solid) -> Part:
    place = solid.transform
    X = IDENTITY
    if place is not None and (
        place.translation != fields.ZERO_TRANSLATION or place.quaternion != fields.IDENTITY_QUATERNION
    ):
        X = from_pose(place.translation, place.quaternion)
    return Part(solid.shape(), material(solid.color), X, _KINDS[type(solid)])


_KINDS: Final[dict[type[_Solid], str]] = {
    kind: str(kind.__struct_config__.tag) for kind in (_Box, _Sphere, _Ellipsoid, _Cylinder, _Capsule)
}
