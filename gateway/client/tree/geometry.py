"""Geometry that clients publish: metres, radians, sRGB colours; NumPy arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gateway.client.tree.colors import check_range, rgba
from gateway.client.tree.wire import empty_with_header

ROTATION_TOLERANCE: Final = 1e-4
"""Maximum deviation of a matrix from a rotation; float32 rounding gives 1e-7, calibrated transforms more."""
MAX_CHANNEL_COLUMNS: Final = 16


@dataclass(frozen=True, slots=True)
class Transform:
    """Rotation (quaternion w, x, y, z of any length but zero), then translation, from the child to its parent."""

    translation: Sequence[float] = (0.0, 0.0, 0.0)
    quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0)

    @classmethod
    def of(cls, value: Transform | ArrayLike) -> Transform:
        """Return a transform from three numbers (a translation) or a (4, 4) rigid matrix.

        Raises:
            ValueError: the value is none of these.
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
        return cls(tuple(matrix[:3, 3].tolist()), _quaternion(R))

    def body(self) -> dict[str, Any]:
        """Return the protocol's object."""
        return {
            "translation": _numbers("translation", self.translation, 3),
            "quaternion": _numbers("quaternion", self.quaternion, 4),
        }


def _quaternion(R: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return (w, x, y, z) of a rotation matrix, by its largest component (Shepperd 1978)."""
    trace = float(np.trace(R))
    diagonal = np.array([trace, R[0, 0], R[1, 1], R[2, 2]])
    largest = int(np.argmax(diagonal))
    q = np.empty(4)
    q[largest] = math.sqrt(max(0.0, 1.0 + 2.0 * diagonal[largest] - trace)) if largest else math.sqrt(1.0 + trace)
    if largest == 0:
        q[1:] = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / q[0]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q[0] = (R[k, j] - R[j, k]) / q[largest]
        q[1 + j] = (R[j, i] + R[i, j]) / q[largest]
        q[1 + k] = (R[k, i] + R[i, k]) / q[largest]
    w, x, y, z = (q / np.linalg.norm(q)).tolist()
    return w, x, y, z


def _numbers(name: str, values: ArrayLike, *counts: int) -> list[float]:
    """Return a list of floats; raise ValueError if their number is none of ``counts``."""
    array = np.asarray(values, np.float64)
    if array.ndim != 1 or len(array) not in counts:
        wanted = " or ".join(map(str, counts))
        raise ValueError(f"{name} must have {wanted} numbers, not shape {array.shape}")
    numbers: list[float] = array.tolist()
    return numbers


def _rows(name: str, values: ArrayLike, *columns: int, dtype: type[np.generic] = np.float32) -> NDArray[Any]:
    """Return a copy, (N, columns) of ``dtype``, or (N,) if columns is 1."""
    array = np.ascontiguousarray(values)
    if array.size == 0:
        return np.empty((0, columns[0]) if columns[0] > 1 else (0,), dtype)
    width = array.shape[1] if array.ndim == 2 else 1
    if array.ndim != (1 if columns == (1,) else 2) or width not in columns:
        wanted = "numbers" if columns == (1,) else f"rows of {' or '.join(map(str, columns))}"
        raise ValueError(f"{name} must have {wanted}, not shape {array.shape}")
    integers = dtype in (np.int64, np.uint32)
    if array.dtype.kind not in ("iub" if integers else "fiub"):
        raise ValueError(f"{name} must have {'integers' if integers else 'numbers'}, not {array.dtype}")
    copy = empty_with_header(array.shape, dtype)  # recorded, so independent of the caller's array
    copy[...] = array
    return copy


@dataclass(frozen=True, slots=True, kw_only=True)
class Geometry:
    """Fields of all geometries."""

    kind: ClassVar[str]
    """Name of the type in the protocol."""
    color: ArrayLike = (1.0, 1.0, 1.0, 1.0)
    """RGB or RGBA from 0 to 1, a uint8 array (0 to 255), a CSS name (``"orange"``), or ``"#ff8000"``."""
    transform: Transform | ArrayLike | None = None
    """Transform to the path's frame; None: identity."""

    def body(self) -> dict[str, Any]:
        """Return the protocol's object, with NumPy arrays.

        Raises:
            ValueError: a field is invalid.
        """
        body: dict[str, Any] = {"type": self.kind, "color": rgba(self.color)}
        if self.transform is not None:
            body["transform"] = Transform.of(self.transform).body()
        return body | self._fields()

    def _fields(self) -> dict[str, Any]:
        """Return the fields of this type."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Box(Geometry):
    """A box centred on the origin, lengths in metres."""

    kind = "box"
    lengths: Sequence[float]

    def _fields(self) -> dict[str, Any]:
        return {"lengths": _numbers("lengths", self.lengths, 3)}


@dataclass(frozen=True, slots=True)
class Sphere(Geometry):
    kind = "sphere"
    radius: float

    def _fields(self) -> dict[str, Any]:
        return {"radius": float(self.radius)}


@dataclass(frozen=True, slots=True)
class Ellipsoid(Geometry):
    kind = "ellipsoid"
    radii: Sequence[float]

    def _fields(self) -> dict[str, Any]:
        return {"radii": _numbers("radii", self.radii, 3)}


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
    """A cylinder along z, centred on the origin, with a hemisphere at each end."""

    kind = "capsule"


@dataclass(frozen=True, slots=True)
class Triad(Geometry):
    """Axes of this length: x red, y green, z blue."""

    kind = "triad"
    scale: float = 1.0
    tube: bool = False

    def _fields(self) -> dict[str, Any]:
        return {"scale": float(self.scale), "tube": bool(self.tube)}


@dataclass(frozen=True, slots=True)
class Line(Geometry):
    """Points (N, 3) joined by a tube, or by a hairline where ``radius`` is 0."""

    kind = "line"
    points: ArrayLike
    radius: float = 0.01
    closed: bool = False
    start_head: bool = False
    end_head: bool = False
    head_radius: float = 0.05
    head_length: float | None = None

    def _fields(self) -> dict[str, Any]:
        length = {} if self.head_length is None else {"head_length": float(self.head_length)}
        return {
            "points": _rows("points", self.points, 3),
            "radius": float(self.radius),
            "closed": bool(self.closed),
            "start_head": bool(self.start_head),
            "end_head": bool(self.end_head),
            "head_radius": float(self.head_radius),
            **length,
        }


@dataclass(frozen=True, slots=True)
class Mesh(Geometry):
    """Vertices (N, 3) and faces (M, 3), indices of vertices."""

    kind = "mesh_data"
    vertices: ArrayLike
    faces: ArrayLike

    def _fields(self) -> dict[str, Any]:
        is_uint32 = np.asarray(self.faces).dtype == np.uint32  # other types are checked before the conversion
        vertices = _rows("vertices", self.vertices, 3)
        faces = _rows("faces", self.faces, 3, dtype=np.uint32 if is_uint32 else np.int64)
        if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
            raise ValueError(f"faces refer to vertex {faces.min()} to {faces.max()}, there are {len(vertices)}")
        return {"vertices": vertices, "faces": faces.astype(np.uint32, copy=False)}


@dataclass(frozen=True, slots=True)
class MeshFile(Geometry):
    """A file on the viewer's machine, below a folder that its operator opened, or ``package://``."""

    kind = "mesh_file"
    filename: str
    scale: float | Sequence[float] = 1.0

    def _fields(self) -> dict[str, Any]:
        scale = [float(self.scale)] * 3 if isinstance(self.scale, (int, float)) else self.scale
        return {"filename": str(self.filename), "scale": _numbers("scale", scale, 3)}


@dataclass(frozen=True, slots=True)
class PointCloud(Geometry):
    """Points (N, 3); ``rgb`` (N, 3 or 4) beats ``intensity`` (N). Both are floating point 0 to 1 or uint8 0 to 255."""

    kind = "pointcloud"
    points: ArrayLike
    rgb: ArrayLike | None = None
    intensity: ArrayLike | None = None
    channels: Mapping[str, ArrayLike] = field(default_factory=dict)
    """Further channels, (N) or (N, k), k up to 16."""

    def _fields(self) -> dict[str, Any]:
        points = _rows("points", self.points, 3)
        return {"points": points, **_channels(len(points), self.rgb, self.intensity, self.channels)}


@dataclass(frozen=True, slots=True)
class PlanarLidar(Geometry):
    """Ranges (N) at angles ``angle_start + i * angle_step`` about z from x; channels as in ``PointCloud``."""

    kind = "planar_lidar"
    ranges: ArrayLike
    angle_start: float
    angle_step: float
    rgb: ArrayLike | None = None
    intensity: ArrayLike | None = None
    channels: Mapping[str, ArrayLike] = field(default_factory=dict)

    def _fields(self) -> dict[str, Any]:
        ranges = _rows("ranges", self.ranges, 1)
        return {
            "ranges": ranges,
            "angle_start": float(self.angle_start),
            "angle_step": float(self.angle_step),
            **_channels(len(ranges), self.rgb, self.intensity, self.channels),
        }


def _channels(
    count: int, rgb: ArrayLike | None, intensity: ArrayLike | None, others: Mapping[str, ArrayLike]
) -> dict[str, Any]:
    channels: dict[str, NDArray[Any]] = {}
    for name, values, columns in (("rgb", rgb, (3, 4)), ("intensity", intensity, (1,))):
        if values is not None:
            is_uint8 = np.asarray(values).dtype == np.uint8
            channels[name] = _rows(name, values, *columns, dtype=np.uint8 if is_uint8 else np.float32)
    for name, values in others.items():
        flat = np.ndim(values) == 1
        channels[name] = _rows(name, values, *((1,) if flat else tuple(range(1, MAX_CHANNEL_COLUMNS + 1))))
    for name, array in channels.items():
        if len(array) != count:
            raise ValueError(f"{name} has {len(array)} values for {count} points")
        if name in ("rgb", "intensity"):
            check_range(name, array)
    return {"channels": channels} if channels else {}
