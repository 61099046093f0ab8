"""Geometry of the tree viewer's protocol. Lengths are in metres, angles in radians, colours in sRGB.

One class defines a type: clients create it, its fields' kinds encode and decode it, and a solid is also the shape that
the viewer's scene draws and stores.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from inspect import cleandoc
from typing import Any, ClassVar, Final, NamedTuple, get_args

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from scenegate.messages.arguments import as_array, describe
from scenegate.messages.colors import WHITE, check_color_count, check_range, color_rows, rgba
from scenegate.messages.field_kinds import (
    AxisLength,
    Channels,
    CommandError,
    Faces,
    FieldKind,
    FieldReader,
    Flag,
    Image,
    Length,
    Lengths,
    Number,
    Pixels,
    Points,
    Radius,
    Ranges,
    Size,
    TextureCoordinates,
    VertexColors,
    Vertices,
    copied_rows,
    number_list,
    number_rows,
)
from scenegate.transforms import Vector, from_pose, origin_amid, quaternions_of

ROTATION_TOLERANCE: Final = 1e-4
"""Maximum deviation of an element of R R^T or of the last row. float32 rounding causes 1e-7, calibration more."""
_ATTRIBUTES: Final = "\n\nAttributes:\n"
"""Heading of the fields in docstrings."""


@dataclass(frozen=True, slots=True)
class Transform:
    """Rigid transform from a child's frame to its parent's: rotation, then translation.

    Attributes:
        translation: x, y, z in metres.
        quaternion: Rotation as w, x, y, z, of any length but 0.
    """

    translation: Vector = (0.0, 0.0, 0.0)
    quaternion: Vector = (1.0, 0.0, 0.0, 0.0)

    @classmethod
    def of(cls, value: Transform | ArrayLike) -> Transform:
        """Return a transform from a transform, a translation (3,), a pose (7,) or a rigid matrix (4, 4).

        A pose is x, y, z, and the quaternion w, x, y, z.

        Raises:
            ValueError: the value is not one of these.
        """
        if isinstance(value, Transform):
            return value
        wanted = "a transform is a Transform, 3 or 7 numbers or a 4x4 matrix"
        matrix = as_array(value, wanted, np.float64)
        if matrix.shape == (3,):
            return cls(tuple(matrix.tolist()))
        if matrix.shape == (7,):
            return cls(tuple(matrix[:3].tolist()), tuple(matrix[3:].tolist()))
        if matrix.shape != (4, 4):
            raise ValueError(f"{wanted}, not {describe(np.asarray(value))}")
        R = matrix[:3, :3]
        if not np.allclose(R @ R.T, np.eye(3), atol=ROTATION_TOLERANCE) or np.linalg.det(R) < 0:
            raise ValueError("the matrix must be a rotation and a translation, without scale, shear or mirroring")
        if not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), atol=ROTATION_TOLERANCE):
            row = matrix[3].tolist()
            raise ValueError(f"the last row of the matrix must be 0, 0, 0, 1, not {row}; is it transposed?")
        return cls(tuple(matrix[:3, 3].tolist()), tuple(quaternions_of(R[None])[0].tolist()))

    def body(self) -> dict[str, Any]:
        """Return the transform as the protocol's JSON object.

        Raises:
            ValueError: a number is missing or not a number, or the quaternion is zero.
        """
        translation = number_list("translation", self.translation, 3)
        quaternion = number_list("quaternion", self.quaternion, 4)
        if not any(quaternion):
            raise ValueError("quaternion has only zeros; no rotation is (1, 0, 0, 0)")
        return {"translation": translation, "quaternion": quaternion}


class Field(NamedTuple):
    """A field of a geometry's class."""

    name: str
    kind: FieldKind
    required: bool
    default: Any
    """Value of an absent field; None if it has a factory."""


class Geometry(msgspec.Struct, frozen=True, kw_only=True, gc=False, omit_defaults=True):
    """Base class of geometries, with the fields that all of them have.

    Attributes:
        color: RGB or RGBA from 0 to 1, a uint8 array (0 to 255), a CSS name (``"orange"``), or ``"#ff8000"``.
        transform: Transform from the geometry's frame to the frame of its path; None: identity.
    """

    kind: ClassVar[str]
    """``type`` in the protocol."""
    color: ArrayLike = WHITE
    transform: Transform | ArrayLike | None = None

    def __init_subclass__(cls) -> None:
        """Add the inherited fields to the docstring: ``help`` and editors show it at the constructor."""
        doc, _, fields = cleandoc(cls.__doc__ or "").partition(_ATTRIBUTES)
        _, _, inherited = cleandoc(cls.__base__.__doc__ or "").partition(_ATTRIBUTES)
        cls.__doc__ = doc + _ATTRIBUTES + "\n".join(filter(None, (fields, inherited)))

    def __post_init__(self) -> None:
        """Check the fields, so that an error points at the line that has them. Raises ValueError."""
        self.body()

    def body(self) -> dict[str, Any]:
        """Return the protocol's JSON object, with NumPy arrays in place of long lists.

        Raises:
            ValueError: a field is invalid, because an array of the caller has changed.
        """
        body: dict[str, Any] = {"type": self.kind, "color": rgba(self.color)}
        transform = None if self.transform is None else Transform.of(self.transform)
        fields = self._fields()
        for name in ("points", "vertices"):
            if (positions := fields.get(name)) is None:
                continue
            origin = origin_amid(positions)
            if any(origin):
                positions = positions - origin
                transform = transform or Transform()
                x, y, z, _ = from_pose(transform.translation, transform.quaternion) @ (*origin, 1.0)
                transform = Transform((x, y, z), transform.quaternion)
            fields[name] = copied_rows(positions)
        if transform is not None:
            body["transform"] = transform.body()
        return body | fields

    def _fields(self) -> dict[str, Any]:
        """Return the protocol's fields of this type of geometry."""
        return {
            field.name: field.kind.write(field.name, value)
            for field in fields_of(type(self))
            if (value := getattr(self, field.name)) is not None or field.required
        }


@cache
def fields_of(geometry: type[Geometry]) -> tuple[Field, ...]:
    """Return the fields of a class that have a kind, but not those of ``Geometry``."""
    found = []
    for field in msgspec.structs.fields(geometry):
        for hint in (field.type, *get_args(field.type)):
            kinds = [each for each in getattr(hint, "__metadata__", ()) if isinstance(each, FieldKind)]
            if kinds:
                default = None if field.default is msgspec.NODEFAULT else field.default
                found.append(Field(field.name, kinds[0], field.required, default))
                break
    return tuple(found)


def read_fields(geometry: type[Geometry], values: Mapping[str, Any], reader: FieldReader) -> dict[str, Any]:
    """Return the fields of ``fields_of`` from a decoded JSON object. null counts as absent.

    Raises CommandError if a field is missing or invalid, NothingToDraw if it has a value that cannot be drawn.
    """
    fields = {}
    for name, kind, required, default in fields_of(geometry):
        value = values.get(name)
        if value is not None:
            fields[name] = kind.read(value, name, reader)
        elif required:
            raise CommandError(f"{name} is missing")
        else:
            fields[name] = default
    return fields


class Solid(Geometry, frozen=True):
    """Base class of shapes that consist of a few numbers. They are compared by value.

    A scene has its own materials and transforms: there, ``color`` and ``transform`` have their defaults.
    """

    def __post_init__(self) -> None:
        for name, kind, _, _ in fields_of(type(self)):
            msgspec.structs.force_setattr(self, name, kind.write(name, getattr(self, name)))
        if self.color is not WHITE or self.transform is not None:
            self.body()


class Box(Solid, frozen=True):
    """A box centred on the origin.

    Attributes:
        lengths: Edge lengths along x, y, z.
    """

    kind = "box"
    lengths: Lengths


class Sphere(Solid, frozen=True):
    """A sphere centred on the origin."""

    kind = "sphere"
    radius: Radius


class Ellipsoid(Solid, frozen=True):
    """An ellipsoid centred on the origin.

    Attributes:
        radii: Half axes along x, y, z.
    """

    kind = "ellipsoid"
    radii: Lengths


class Cylinder(Solid, frozen=True):
    """A closed cylinder along z, centred on the origin."""

    kind = "cylinder"
    radius: Radius
    length: Length


class Capsule(Solid, frozen=True):
    """A cylinder along z, centred on the origin, with a hemisphere at each end. ``length`` is without hemispheres."""

    kind = "capsule"
    radius: Radius
    length: Length


class Triad(Solid, frozen=True):
    """Coordinate axes: x red, y green, z blue.

    Attributes:
        scale: Length of the axes.
        tube: True: draw tubes of 2 mm radius in place of hairlines.
    """

    kind = "triad"
    scale: AxisLength = 1.0
    tube: Flag = False


class Line(Geometry, frozen=True):
    """Straight segments from point to point, with optional arrow heads.

    Attributes:
        points: (N, 3).
        radius: Radius of the tube; 0: a hairline; None: 0.01, or 0 if there is a ``line_width``.
        closed: True: join the last point to the first.
        start_head: True: draw an arrow head at the first point.
        end_head: True: draw an arrow head at the last point.
        head_length: Length of the arrow heads; None: the viewer's default.
        line_width: Width of a hairline in pixels, 1 to 256; None: 1. Other viewers ignore it.
    """

    kind = "line"
    points: Points
    radius: Number | None = None
    closed: Flag = False
    start_head: Flag = False
    end_head: Flag = False
    head_radius: Size = 0.05
    head_length: Size | None = None
    line_width: Pixels | None = None

    def _fields(self) -> dict[str, Any]:
        return {"radius": 0.01 if self.line_width is None else 0.0} | Geometry._fields(self)


class PlainMesh(Geometry, frozen=True):
    """Triangle mesh in one colour, which every viewer shows.

    Attributes:
        vertices: Positions, (N, 3).
        faces: Triangles, (M, 3) indices of vertices.
    """

    kind = "mesh_data"
    vertices: Vertices
    faces: Faces


class MeshGeometry(PlainMesh, frozen=True):
    """Triangle mesh, in one colour, with colours of its vertices, or with an image.

    A viewer that is not Scenegate refuses meshes with ``colors`` or an ``image``, and shows all others.

    Attributes:
        colors: Colours of the vertices, (N, 3) or (N, 4): floats from 0 to 1, or integers from 0 to 255, sent as bytes.
            They multiply ``color``.
        uv: Texture coordinates, (N, 2), ignored without ``image``. (0, 0) is the image's top left corner, (1, 1) its
            bottom right one; use ``1 - v`` for coordinates from OBJ files.
        image: Texture, which multiplies ``color``: a PNG or JPEG file as bytes, its path, or pixels as in
            ``ImagePlane``.
    """

    colors: VertexColors | None = None
    uv: TextureCoordinates | None = None
    image: Image | None = None

    def body(self) -> dict[str, Any]:
        body = Geometry.body(self)
        return body | {"type": "mesh"} if "colors" in body or "image" in body else body

    def _fields(self) -> dict[str, Any]:
        fields = Geometry._fields(self)
        count, faces = len(fields["vertices"]), fields["faces"]
        if len(faces) and not (faces.min() >= 0 and faces.max() < count):
            raise ValueError(f"faces refer to vertex {faces.min()} to {faces.max()}, there are {count}")
        fields["faces"] = faces.astype(np.uint32, copy=False)
        if "colors" in fields:
            check_color_count(fields["colors"], count)
        if self.image is None:
            fields.pop("uv", None)
        elif self.uv is None:
            raise ValueError("a mesh with an image needs uv")
        elif len(fields["uv"]) != count:
            raise ValueError(f"uv has {len(fields['uv'])} rows for {count} vertices")
        return fields


def _intensity_rows(name: str, values: ArrayLike) -> NDArray[Any]:
    """Return grey values as (N,) uint8 or float32. Raises ValueError, with ``name``, for another shape."""
    array = as_array(values, f"{name} must have numbers")
    return number_rows(name, array, 1, dtype=np.uint8 if array.dtype == np.uint8 else np.float32)


class _Cloud(Geometry, frozen=True):
    """Base class of points with channels. The protocol has ``rgb`` and ``intensity`` among the ``channels``."""

    def _fields(self) -> dict[str, Any]:
        fields = Geometry._fields(self)
        count = len(next(iter(fields.values())))
        channels: dict[str, NDArray[Any]] = {}
        for field, name, rows_of in (("colors", "rgb", color_rows), ("intensity", "intensity", _intensity_rows)):
            values = getattr(self, field)
            if values is not None:
                channels[name] = rows_of(field, values)
        channels |= fields.pop("channels")
        for name, array in channels.items():
            if len(array) != count:
                field = {"rgb": "colors", "intensity": "intensity"}.get(name, f"channels[{name!r}]")
                raise ValueError(f"{field} has {len(array)} values for {count} points")
            if name in ("rgb", "intensity"):
                check_range("colors" if name == "rgb" else name, array)
        return fields | ({"channels": channels} if channels else {})


class PointCloud(_Cloud, frozen=True):
    """Points with optional colours and other values.

    Attributes:
        points: Positions, (N, 3).
        colors: Colours, (N, 3) or (N, 4): floats from 0 to 1, or integers from 0 to 255, sent as bytes. They take
            precedence over ``intensity``.
        intensity: Grey values, (N,): floats from 0 to 1, or uint8.
        channels: Other values by name, (N,) or (N, k) with k up to 16.
        point_size: Width of the points in pixels, 1 to 256; None: 2. Other viewers ignore it.
    """

    kind = "pointcloud"
    points: Points
    colors: ArrayLike | None = None
    intensity: ArrayLike | None = None
    channels: Channels = msgspec.field(default_factory=dict)
    point_size: Pixels | None = None


class PlanarLidar(_Cloud, frozen=True):
    """Scan of a lidar that turns about z. ``colors``, ``intensity``, ``channels`` and ``point_size`` are as in
    ``PointCloud``.

    Attributes:
        ranges: Distances, (N,). Range i is measured at the angle ``angle_start + i * angle_step``, from x towards y.
        angle_start: Angle of the first range, radians.
        angle_step: Angle from a range to the next one, radians.
    """

    kind = "planar_lidar"
    ranges: Ranges
    angle_start: Number
    angle_step: Number
    colors: ArrayLike | None = None
    intensity: ArrayLike | None = None
    channels: Channels = msgspec.field(default_factory=dict)
    point_size: Pixels | None = None
