"""Geometry that clients publish with ``viewer``. Lengths are in metres, angles in radians, colours in sRGB."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scenegate.messages.colors import ImageLike, as_uint8_or_floats, check_range, color_rows, image_field, rgba
from scenegate.messages.wire import empty_with_header
from scenegate.transforms import quaternions_of

ROTATION_TOLERANCE: Final = 1e-4
"""Maximum deviation of an element of R R^T from the identity. float32 rounding causes 1e-7, calibration more."""
MAX_CHANNEL_COLUMNS: Final = 16
"""Maximum number of values per point in one channel of a point cloud."""


@dataclass(frozen=True, slots=True)
class Transform:
    """Rigid transform from a child's frame to its parent's: rotation, then translation."""

    translation: Sequence[float] = (0.0, 0.0, 0.0)
    """x, y, z in metres."""
    quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0)
    """Rotation as w, x, y, z, of any length. All zeros: no rotation."""

    @classmethod
    def of(cls, value: Transform | ArrayLike) -> Transform:
        """Return a transform from a transform, a translation (3,) or a rigid matrix (4, 4).

        Raises:
            ValueError: the value is not one of these.
        """
        if isinstance(value, Transform):
            return value
        matrix = np.asarray(value, np.float64)
        if matrix.shape == (3,):
            return cls(tuple(matrix.tolist()))
        if matrix.shape != (4, 4):
            raise ValueError(f"a transform is 3 numbers or a 4x4 matrix, not of shape {matrix.shape}")
        R = matrix[:3, :3]
        if not np.allclose(R @ R.T, np.eye(3), atol=ROTATION_TOLERANCE) or np.linalg.det(R) < 0:
            raise ValueError("the matrix must be a rotation and a translation, without scale, shear or mirroring")
        return cls(tuple(matrix[:3, 3].tolist()), tuple(quaternions_of(R[None])[0].tolist()))

    def body(self) -> dict[str, Any]:
        """Return the transform as the protocol's JSON object."""
        return {
            "translation": number_list("translation", self.translation, 3),
            "quaternion": number_list("quaternion", self.quaternion, 4),
        }


def number_list(name: str, values: ArrayLike, *counts: int) -> list[float]:
    """Return a field's values as floats. Raises ValueError if their number is not one of ``counts``."""
    array = np.asarray(values, np.float64)
    if array.ndim != 1 or len(array) not in counts:
        wanted = " or ".join(map(str, counts))
        raise ValueError(f"{name} must have {wanted} numbers, not shape {array.shape}")
    numbers: list[float] = array.tolist()
    return numbers


def number_rows(name: str, values: ArrayLike, *columns: int, dtype: type[np.generic] = np.float32) -> NDArray[Any]:
    """Return a copy of a field's values: (N, one of ``columns``), or (N,) if ``columns`` is 1.

    Raises:
        ValueError: the values have another shape, or are not numbers (integers for an integer ``dtype``).
    """
    array = np.ascontiguousarray(values)
    if array.size == 0:
        return np.empty((0, columns[0]) if columns[0] > 1 else (0,), dtype)
    width = array.shape[1] if array.ndim == 2 else 1
    if array.ndim != (1 if columns == (1,) else 2) or width not in columns:
        wanted = "numbers" if columns == (1,) else f"rows of {' or '.join(map(str, columns))}"
        raise ValueError(f"{name} must have {wanted}, not shape {array.shape}")
    needs_integers = dtype in (np.int64, np.uint32)
    if array.dtype.kind not in ("iub" if needs_integers else "fiub"):
        raise ValueError(f"{name} must have {'integers' if needs_integers else 'numbers'}, not {array.dtype}")
    copy = empty_with_header(array.shape, dtype)  # PublishedTree keeps it, so the caller's array may change
    copy[...] = array
    return copy


@dataclass(frozen=True, slots=True, kw_only=True)
class Geometry:
    """Base class of geometries, with the fields that all of them have."""

    kind: ClassVar[str]
    """``type`` in the protocol."""
    color: ArrayLike = (1.0, 1.0, 1.0, 1.0)
    """RGB or RGBA from 0 to 1, a uint8 array (0 to 255), a CSS name (``"orange"``), or ``"#ff8000"``."""
    transform: Transform | ArrayLike | None = None
    """Transform from the geometry's frame to the frame of its path; None: identity."""

    def __post_init__(self) -> None:
        """Check the fields, so that an error points at the line that has them.

        Raises:
            ValueError: a field is invalid.
        """
        self.body()

    def body(self) -> dict[str, Any]:
        """Return the protocol's JSON object, with NumPy arrays in place of long lists.

        Raises:
            ValueError: a field is invalid, because an array of the caller has changed.
        """
        body: dict[str, Any] = {"type": self.kind, "color": rgba(self.color)}
        if self.transform is not None:
            body["transform"] = Transform.of(self.transform).body()
        return body | self._fields()

    def _fields(self) -> dict[str, Any]:
        """Return the protocol's fields of this type of geometry."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Box(Geometry):
    """A box centred on the origin."""

    kind = "box"
    lengths: Sequence[float]
    """Edge lengths along x, y, z."""

    def _fields(self) -> dict[str, Any]:
        return {"lengths": number_list("lengths", self.lengths, 3)}


@dataclass(frozen=True, slots=True)
class Sphere(Geometry):
    """A sphere centred on the origin."""

    kind = "sphere"
    radius: float

    def _fields(self) -> dict[str, Any]:
        return {"radius": float(self.radius)}


@dataclass(frozen=True, slots=True)
class Ellipsoid(Geometry):
    """An ellipsoid centred on the origin."""

    kind = "ellipsoid"
    radii: Sequence[float]
    """Half axes along x, y, z."""

    def _fields(self) -> dict[str, Any]:
        return {"radii": number_list("radii", self.radii, 3)}


@dataclass(frozen=True, slots=True)
class Cylinder(Geometry):
    """A cylinder along z, centred on the origin."""

    kind = "cylinder"
    radius: float
    length: float

    def _fields(self) -> dict[str, Any]:
        return {"radius": float(self.radius), "length": float(self.length)}


@dataclass(frozen=True, slots=True)
class Capsule(Cylinder):
    """A cylinder along z, centred on the origin, with a hemisphere at each end. ``length`` is without hemispheres."""

    kind = "capsule"


@dataclass(frozen=True, slots=True)
class Triad(Geometry):
    """Coordinate axes: x red, y green, z blue."""

    kind = "triad"
    scale: float = 1.0
    """Length of the axes."""
    tube: bool = False
    """True: draw tubes in place of hairlines."""

    def _fields(self) -> dict[str, Any]:
        return {"scale": float(self.scale), "tube": bool(self.tube)}


@dataclass(frozen=True, slots=True)
class Line(Geometry):
    """Straight segments from point to point, with optional arrow heads."""

    kind = "line"
    points: ArrayLike
    """(N, 3)."""
    radius: float | None = None
    """Radius of the tube; 0: a hairline; None: 0.01, or 0 if there is a ``line_width``."""
    closed: bool = False
    """True: join the last point to the first."""
    start_head: bool = False
    """True: draw an arrow head at the first point."""
    end_head: bool = False
    """True: draw an arrow head at the last point."""
    head_radius: float = 0.05
    head_length: float | None = None
    """Length of the arrow heads; None: the viewer's default."""
    line_width: float | None = None
    """Width of a hairline in pixels, 1 to 256; None: 1. Other viewers ignore it."""

    def _fields(self) -> dict[str, Any]:
        line_width = {} if self.line_width is None else {"line_width": float(self.line_width)}
        head_length = {} if self.head_length is None else {"head_length": float(self.head_length)}
        return {
            "points": number_rows("points", self.points, 3),
            "radius": (0.01 if self.line_width is None else 0.0) if self.radius is None else float(self.radius),
            "closed": bool(self.closed),
            "start_head": bool(self.start_head),
            "end_head": bool(self.end_head),
            "head_radius": float(self.head_radius),
            **head_length,
            **line_width,
        }


@dataclass(frozen=True, slots=True)
class Mesh(Geometry):
    """Triangle mesh, in one colour, with colours of its vertices, or with an image.

    A viewer that is not Scenegate refuses meshes with ``colors`` or an ``image``, and shows all others.
    """

    kind = "mesh_data"
    vertices: ArrayLike
    """Positions, (N, 3)."""
    faces: ArrayLike
    """Triangles, (M, 3) indices of vertices."""
    colors: ArrayLike | None = None
    """Colours of the vertices, (N, 3) or (N, 4): floats from 0 to 1, or integers from 0 to 255. They multiply
    ``color``."""
    uv: ArrayLike | None = None
    """Texture coordinates, (N, 2), ignored without ``image``. (0, 0) is the image's top left corner, (1, 1) its bottom
    right one; use ``1 - v`` for coordinates from OBJ files."""
    image: ImageLike | None = None
    """Texture, which multiplies ``color``: a PNG or JPEG file as bytes, its path, or pixels as in ``ImagePlane``."""

    def body(self) -> dict[str, Any]:
        body = Geometry.body(self)
        return body | {"type": "mesh"} if "colors" in body or "image" in body else body

    def _fields(self) -> dict[str, Any]:
        is_uint32 = np.asarray(self.faces).dtype == np.uint32  # negative indices of other types must not wrap
        vertices = number_rows("vertices", self.vertices, 3)
        faces = number_rows("faces", self.faces, 3, dtype=np.uint32 if is_uint32 else np.int64)
        if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
            raise ValueError(f"faces refer to vertex {faces.min()} to {faces.max()}, there are {len(vertices)}")
        fields: dict[str, Any] = {"vertices": vertices, "faces": faces.astype(np.uint32, copy=False)}
        if self.colors is not None:
            fields["colors"] = color_rows("colors", self.colors, len(vertices))
        if self.image is not None:
            if self.uv is None:
                raise ValueError("a mesh with an image needs uv")
            fields |= {"uv": number_rows("uv", self.uv, 2), "image": image_field(self.image)}
            if len(fields["uv"]) != len(vertices):
                raise ValueError(f"uv has {len(fields['uv'])} rows for {len(vertices)} vertices")
        return fields


@dataclass(frozen=True, slots=True)
class PointCloud(Geometry):
    """Points with optional colours and other values."""

    kind = "pointcloud"
    points: ArrayLike
    """Positions, (N, 3)."""
    rgb: ArrayLike | None = None
    """Colours, (N, 3) or (N, 4): floats from 0 to 1, or integers from 0 to 255. They take precedence over
    ``intensity``."""
    intensity: ArrayLike | None = None
    """Grey values, (N,): floats from 0 to 1, or uint8."""
    channels: Mapping[str, ArrayLike] = field(default_factory=dict)
    """Other values by name, (N,) or (N, k) with k up to 16."""
    point_size: float | None = None
    """Width of the points in pixels, 1 to 256; None: 2. Other viewers ignore it."""

    def _fields(self) -> dict[str, Any]:
        points = number_rows("points", self.points, 3)
        return {
            "points": points,
            **_channels(len(points), self.rgb, self.intensity, self.channels),
            **_point_size(self.point_size),
        }


@dataclass(frozen=True, slots=True)
class PlanarLidar(Geometry):
    """Scan of a lidar that turns about z. ``rgb``, ``intensity``, ``channels`` and ``point_size`` are as in
    ``PointCloud``."""

    kind = "planar_lidar"
    ranges: ArrayLike
    """Distances, (N,). Range i is measured at the angle ``angle_start + i * angle_step``, from x towards y."""
    angle_start: float
    angle_step: float
    rgb: ArrayLike | None = None
    intensity: ArrayLike | None = None
    channels: Mapping[str, ArrayLike] = field(default_factory=dict)
    point_size: float | None = None

    def _fields(self) -> dict[str, Any]:
        ranges = number_rows("ranges", self.ranges, 1)
        return {
            "ranges": ranges,
            "angle_start": float(self.angle_start),
            "angle_step": float(self.angle_step),
            **_channels(len(ranges), self.rgb, self.intensity, self.channels),
            **_point_size(self.point_size),
        }


def _point_size(value: float | None) -> dict[str, Any]:
    return {} if value is None else {"point_size": float(value)}


def _channels(
    count: int, rgb: ArrayLike | None, intensity: ArrayLike | None, others: Mapping[str, ArrayLike]
) -> dict[str, Any]:
    """Return the protocol's field ``channels`` for ``count`` points; no field if there are no channels."""
    channels: dict[str, NDArray[Any]] = {}
    for name, values, columns in (("rgb", rgb, (3, 4)), ("intensity", intensity, (1,))):
        if values is not None:
            values = as_uint8_or_floats(values) if name == "rgb" else np.asarray(values)
            is_uint8 = values.dtype == np.uint8
            channels[name] = number_rows(name, values, *columns, dtype=np.uint8 if is_uint8 else np.float32)
    for name, values in others.items():
        allowed_columns = (1,) if np.ndim(values) == 1 else tuple(range(1, MAX_CHANNEL_COLUMNS + 1))
        channels[name] = number_rows(name, values, *allowed_columns)
    for name, array in channels.items():
        if len(array) != count:
            raise ValueError(f"{name} has {len(array)} values for {count} points")
        if name in ("rgb", "intensity"):
            check_range(name, array)
    return {"channels": channels} if channels else {}
