"""Content of a mesh file: what a parser's child process sends to the program, and how it is made of arrays."""

import codecs
import contextlib
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from scenegate.transforms import origin_amid


class MeshOptions(msgspec.Struct, frozen=True):
    """Options of a parser: limits of the content, with the names of ``GltfLimits``, and what is read of COLLADA."""

    max_vertices: int
    max_elements: int
    max_instances: int
    max_drawn_elements: int
    max_node_depth: int
    use_up_axis: bool = True
    """True: a COLLADA file's up axis is rotated to Z. False: the file is taken as Z up."""
    submesh: str = ""
    """Name of the node of a COLLADA file whose geometry is read; empty: all geometry."""


class Shape(msgspec.Struct):
    """Vertices with one material: triangles, or points."""

    positions: bytes
    """(N, 3) float32 from ``origin``, finite for triangles."""
    triangles: bytes | None
    """(M, 3) uint32, each below N; None: it is a point cloud."""
    normals: bytes | None = None
    """(N, 3) float32 of unit length, or zero; None: the file has none."""
    uv: bytes | None = None
    """(N, 2) float32; (0, 0) is the image's top left corner."""
    colors: bytes | None = None
    """(N, 4) uint8, sRGB and opacity."""
    color: tuple[float, float, float, float] | None = None
    """Diffuse colour, sRGB and opacity, not clipped; None: the file has no material."""
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Emitted colour, sRGB, not clipped."""
    image: int | None = None
    """Index of the texture in ``MeshData.images``."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Point of the file, near the shape if it is far from the file's own origin."""


class MeshData(msgspec.Struct):
    """Shapes and their instances."""

    shapes: list[Shape] = msgspec.field(default_factory=list)
    images: list[tuple[str, bytes]] = msgspec.field(default_factory=list)
    """Name of a texture in the mesh file, and its PNG, JPEG or WebP file: not decoded, and perhaps damaged."""
    instances: list[tuple[int, bytes]] = msgspec.field(default_factory=list)
    """Index of a shape, and its (4, 4) float64 transform, which includes the unit and up axis of a COLLADA file."""
    warnings: list[str] = msgspec.field(default_factory=list)
    """Sentences about content that was left out or repaired."""


class DecodedAttribute(msgspec.Struct):
    """An attribute of a decompressed Draco mesh."""

    unique_id: int
    dtype: str
    """Name of the NumPy data type."""
    components: int
    data: bytes
    """Values, (number of vertices, components)."""


class DecodedMesh(msgspec.Struct):
    """A decompressed Draco mesh."""

    triangles: bytes
    """(M, 3) uint32, vertex indices."""
    attributes: list[DecodedAttribute]


_TRIANGLES_AT_ONCE = 1 << 18
"""Triangles that are compared with their normals at once, for the memory that this takes."""


class MeshFaultError(ValueError):
    """Raised by parsers: a file cannot be used."""


def as_utf8(data: bytes) -> bytes:
    """Return text in UTF-16 with a byte order mark, as PowerShell writes it, as UTF-8; other data as they are."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        with contextlib.suppress(UnicodeDecodeError):
            return data.decode("utf-16").encode()
    return data


def srgb_bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours as bytes. Floats are from 0 to 1, or as integers from 0 to 255 or 65535: the largest one tells."""
    if values.dtype == np.uint8:
        return values
    numbers = np.nan_to_num(values.astype(np.float64))
    largest = numbers.max(initial=0.0)
    full = 1.0 if values.dtype.kind == "f" and largest < 2.0 else 255.0 if largest <= 255.0 else 65535.0
    return np.rint(np.clip(numbers / full, 0.0, 1.0) * 255.0).astype(np.uint8)


def check_limits(vertices: int, triangles: int, options: MeshOptions) -> None:
    """Raise MeshFaultError for too many vertices or triangles."""
    if vertices > options.max_vertices or triangles > options.max_elements:
        raise MeshFaultError(f"it has more than {options.max_vertices} vertices or {options.max_elements} triangles")


def checked_triangles(faces: NDArray[np.int64], vertex_count: int, warnings: list[str]) -> NDArray[np.int64]:
    """Return the rows whose first three values are below ``vertex_count``; a sentence tells of others."""
    corners = faces[:, :3]
    if not corners.size or (corners.min() >= 0 and corners.max() < vertex_count):
        return faces
    worst = int(corners.min()) if corners.min() < 0 else int(corners.max())
    is_valid = ((corners >= 0) & (corners < vertex_count)).all(axis=1)
    count = len(faces) - np.count_nonzero(is_valid)
    warnings.append(
        f"{count} of {len(faces)} triangles refer to vertices that do not exist ({worst} of {vertex_count})"
    )
    return faces[is_valid]


def shape_of(
    positions: ArrayLike,
    triangles: NDArray[np.int64] | None,
    warnings: list[str],
    *,
    normals: ArrayLike | None = None,
    uv: ArrayLike | None = None,
    colors: NDArray[np.uint8] | None = None,
    color: tuple[float, float, float, float] | None = None,
    image: int | None = None,
) -> Shape | None:
    """Return a shape; None if it draws nothing. (0, 0) of ``uv``, kept without an image, too, is bottom left.

    A sentence is appended if vertices or texture coordinates are not finite in float32. Triangles of such vertices are
    left out.
    """
    with np.errstate(over="ignore"):
        points = np.ascontiguousarray(positions, np.float32)
        origin = origin_amid(np.asarray(positions))
        if any(origin):
            points = np.ascontiguousarray(positions - np.array(origin), np.float32)
    if triangles is None:
        return Shape(points.tobytes(), None, colors=None if colors is None else colors.tobytes(), origin=origin)
    finite = np.asarray(np.isfinite(points).all(axis=1))
    if not finite.all():
        is_drawn = finite[triangles].all(axis=1)
        if not is_drawn.all():
            count = len(triangles) - np.count_nonzero(is_drawn)
            warnings.append(f"{count} of {len(triangles)} triangles with vertices that are not finite are left out")
        triangles = triangles[is_drawn]
        points[~finite] = 0.0
    if not len(triangles):
        return None
    units = None if normals is None else _unit_rows(np.asarray(normals, np.float64))
    if units is not None:
        triangles = _wound_as_normals(triangles, points, units)
    shape = Shape(points.tobytes(), np.ascontiguousarray(triangles, np.uint32).tobytes(), color=color, origin=origin)
    if units is not None:
        shape.normals = units.tobytes()
    if colors is not None:
        shape.colors = np.ascontiguousarray(colors, np.uint8).tobytes()
    if uv is not None and np.shape(uv) == (len(points), 2):
        with np.errstate(over="ignore"):
            flipped = np.array(uv, np.float32)
        invalid = ~np.isfinite(flipped)
        if invalid.any():
            count = np.count_nonzero(invalid.any(axis=1))
            warnings.append(f"{count} of {len(points)} texture coordinates are not finite, they are read as 0")
            flipped[invalid] = 0.0
        flipped[:, 1] = 1.0 - flipped[:, 1]
        shape.uv, shape.image = flipped.tobytes(), image
    return shape


def _wound_as_normals(
    triangles: NDArray[np.int64], points: NDArray[np.float32], normals: NDArray[np.float32]
) -> NDArray[np.int64]:
    """Return the triangles, of which those are turned over that the sum of their corners' normals opposes.

    Files of robots have them, up to a third of their triangles. From where its normals point, such a triangle shows its
    back, for which normals are reversed: it would be black where the light is beside the camera.
    """
    x, y, z = np.ascontiguousarray(points.T)
    nx, ny, nz = np.ascontiguousarray(normals.T)
    opposed = np.zeros(len(triangles), np.bool_)
    for start in range(0, len(triangles), _TRIANGLES_AT_ONCE):
        i, j, k = np.ascontiguousarray(triangles[start : start + _TRIANGLES_AT_ONCE].T)
        with np.errstate(all="ignore"):
            ax, ay, az, bx, by, bz = x[j] - x[i], y[j] - y[i], z[j] - z[i], x[k] - x[i], y[k] - y[i], z[k] - z[i]
            along = (ay * bz - az * by) * (nx[i] + nx[j] + nx[k])
            along += (az * bx - ax * bz) * (ny[i] + ny[j] + ny[k])
            along += (ax * by - ay * bx) * (nz[i] + nz[j] + nz[k])
        opposed[start : start + _TRIANGLES_AT_ONCE] = along < 0
    return np.where(opposed[:, None], triangles[:, [0, 2, 1]], triangles)


def _unit_rows(vectors: NDArray[np.float64]) -> NDArray[np.float32]:
    with np.errstate(all="ignore"):
        units = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.ascontiguousarray(np.nan_to_num(units, posinf=0.0, neginf=0.0), np.float32)
