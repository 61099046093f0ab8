"""msgspec types of the most frequent commands. msgspec checks commands against them while it decodes.

Decoding fails for all other data: other geometries, irregular forms and errors. ``request_reader`` then reads the
request field by field. A type here may therefore be stricter than the protocol, but not more lenient.
"""

from __future__ import annotations

import sys
from typing import Annotated, Any, Final

import msgspec

from gateway.scene.geometry import Box, Capsule, Cylinder, Ellipsoid, Part, Shape, Sphere
from gateway.scene.materials import WHITE, material
from gateway.scene.transforms import IDENTITY, from_pose
from gateway.scene.tree import Pose
from gateway.treeviewer import fields
from gateway.treeviewer.config import Limits

_Finite = Annotated[float, msgspec.Meta(ge=-sys.float_info.max, le=sys.float_info.max)]
_Length = Annotated[float, msgspec.Meta(ge=0.0, le=fields.MAX_DISTANCE)]
_Coordinate = Annotated[float, msgspec.Meta(ge=-fields.MAX_DISTANCE, le=fields.MAX_DISTANCE)]
_Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class Transform(msgspec.Struct, gc=False):
    """Transform of a settransform command: from the path's frame to its parent's."""

    translation: tuple[_Finite, _Finite, _Finite] | None = fields.ZERO_TRANSLATION
    quaternion: tuple[_Finite, _Finite, _Finite, _Finite] | None = fields.IDENTITY_QUATERNION

    def pose(self) -> Pose:
        """Return x, y, z of the translation and w, x, y, z of the quaternion."""
        return (self.translation or fields.ZERO_TRANSLATION) + (self.quaternion or fields.IDENTITY_QUATERNION)


class _LocalTransform(msgspec.Struct, gc=False):
    """Transform from a geometry's frame to the frame of its path."""

    translation: tuple[_Coordinate, _Coordinate, _Coordinate] = fields.ZERO_TRANSLATION
    quaternion: tuple[_Coordinate, _Coordinate, _Coordinate, _Coordinate] = fields.IDENTITY_QUATERNION


class _Solid(msgspec.Struct, gc=False, tag_field="type"):
    """Base of the geometries here. The field ``type`` of the JSON object selects the subclass."""

    color: tuple[_Fraction, _Fraction, _Fraction, _Fraction] = WHITE
    transform: _LocalTransform | None = None

    def shape(self) -> Shape:
        """Return the geometry as a shape of the scene."""
        raise NotImplementedError


class _Box(_Solid, tag="box", kw_only=True):
    lengths: tuple[_Length, _Length, _Length]

    def shape(self) -> Shape:
        return Box(self.lengths)


class _Sphere(_Solid, tag="sphere", kw_only=True):
    radius: _Length

    def shape(self) -> Shape:
        return Sphere(self.radius)


class _Ellipsoid(_Solid, tag="ellipsoid", kw_only=True):
    radii: tuple[_Length, _Length, _Length]

    def shape(self) -> Shape:
        return Ellipsoid(self.radii)


class _Cylinder(_Solid, tag="cylinder", kw_only=True):
    radius: _Length
    length: _Length

    def shape(self) -> Shape:
        return Cylinder(self.radius, self.length)


class _Capsule(_Solid, tag="capsule", kw_only=True):
    radius: _Length
    length: _Length

    def shape(self) -> Shape:
        return Capsule(self.radius, self.length)


_AnySolid = _Box | _Sphere | _Ellipsoid | _Cylinder | _Capsule


class _MessageBase(msgspec.Struct, gc=False):
    """Fields of a request that do not depend on limits."""

    delete: Any = None
    load: Any = msgspec.UNSET
    """Director's older name of ``setgeometry``."""
    draw: Any = msgspec.UNSET
    """Director's older name of ``settransform``."""
    setproperty: Any = None
    setview: Any = None
    setclicks: Any = None
    setcontrols: Any = None
    setvalues: Any = None


def message_type(limits: Limits) -> type:
    """Return the type of a request whose paths and geometries respect the limits."""
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
    single_command = dict[str, Any]  # {} or one command in place of a list
    return msgspec.defstruct(
        "Message",
        [
            ("setgeometry", list[set_geometry] | single_command | None, None),  # type: ignore[valid-type]  # made above
            ("settransform", list[set_transform] | single_command | None, None),  # type: ignore[valid-type]  # made above
        ],
        bases=(_MessageBase,),
        gc=False,
    )


def parts_of(command: Any) -> tuple[Part, ...] | None:
    """Return the parts of a setgeometry command, or None if it has neither ``geometry`` nor ``geometries``."""
    if command.geometry is not None:
        return (_part(command.geometry),)
    if command.geometries is not None:
        return tuple([_part(solid) for solid in command.geometries])
    return None


def _part(solid: _Solid) -> Part:
    """Return a geometry as a part of the scene."""
    local = solid.transform
    X_node_part = IDENTITY
    if local is not None and (
        local.translation != fields.ZERO_TRANSLATION or local.quaternion != fields.IDENTITY_QUATERNION
    ):
        X_node_part = from_pose(local.translation, local.quaternion)
    return Part(solid.shape(), material(solid.color), X_node_part, _TYPE_NAMES[type(solid)])


_TYPE_NAMES: Final[dict[type[_Solid], str]] = {
    solid: str(solid.__struct_config__.tag) for solid in (_Box, _Sphere, _Ellipsoid, _Cylinder, _Capsule)
}
