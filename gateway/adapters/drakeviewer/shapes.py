"""Read the geometries of links, and deformable bodies, as parts of the scene.

Meshes come as numbers (``float_data``), or as files in JSON (``InMemoryMesh``).
"""

import math
from collections.abc import Callable, Iterable
from typing import Annotated, Any, Final

import msgspec
import numpy as np
import pybase64
from numpy.typing import NDArray

from gateway.adapters.drakeviewer.config import Limits
from gateway.adapters.drakeviewer.link_paths import split_name
from gateway.adapters.drakeviewer.wire import Geometry, GeometryType, Link, MessageError
from gateway.files.assets.mesh_files import MeshFileError, MeshFiles, quoted
from gateway.files.assets.mesh_formats import PLAIN_MATERIAL
from gateway.scene.draw.crease_normals import smooth_mesh
from gateway.scene.tree.geometry import Part, Shape, Surface
from gateway.scene.tree.materials import material
from gateway.scene.tree.nodes import Path
from gateway.scene.tree.transforms import from_pose
from renderers.drawlist import Material, Mesh
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere


def read_geometries(
    geometries: Iterable[Geometry], files: MeshFiles, limits: Limits, warnings: list[str]
) -> tuple[Part, ...]:
    """Return the parts of a link's geometries, in its frame. Each that is not shown completely adds a warning."""
    parts: list[Part] = []
    for geometry in geometries:
        try:
            parts += _parts_of(geometry, files, limits, warnings)
        except (MessageError, MeshFileError) as error:
            warnings.append(str(error))
    return tuple(parts)


def read_deformables(link: Link, family: Path, limits: Limits, warnings: list[str]) -> dict[Path, tuple[Part, ...]]:
    """Return the bodies of a message, its geometries, by path in the live tree; without drawable triangles, no parts.

    A warning is added for each that is not shown completely. Raises MessageError if a name is beyond a limit.
    """
    bodies: dict[Path, tuple[Part, ...]] = {}
    _, link_name = link.key
    parent = (*family, *split_name(link_name, limits))
    for geometry in link.geometries:
        name_bytes = len(geometry.text.encode())
        if name_bytes > limits.name_bytes:  # string_data may be as long as a mesh in JSON
            raise MessageError(
                f"the name of a deformable body has {name_bytes} bytes, the limit is {limits.name_bytes}"
            )
        path = (*parent, *split_name(geometry.text, limits))
        parts_before = bodies.get(path, ())  # of a body with the same name
        try:
            bodies[path] = parts_before + _parts_of_numbers(geometry, limits, warnings)
        except MessageError as error:
            bodies[path] = parts_before
            warnings.append(str(error))
    return bodies


def _parts_of(geometry: Geometry, files: MeshFiles, limits: Limits, warnings: list[str]) -> tuple[Part, ...]:
    if geometry.type == GeometryType.MESH:
        if geometry.text:
            return _parts_of_file(geometry, files, warnings)
        return _parts_of_numbers(geometry, limits, warnings)
    if geometry.type not in _SHAPES:
        raise MessageError(f"geometry type {geometry.type} is unknown")
    kind, size_count, shape_of = _SHAPES[geometry.type]
    sizes = geometry.floats.tolist()
    if len(sizes) != size_count:
        raise MessageError(f"a {kind} has {len(sizes)} numbers instead of {size_count}")
    if not all(0.0 <= size < math.inf for size in sizes):
        raise MessageError(f"a {kind} has the sizes {sizes}: they must be finite and from 0 on")
    return (Part(shape_of(sizes), _material_of(geometry), _pose_of(geometry), kind),)


def _parts_of_numbers(geometry: Geometry, limits: Limits, warnings: list[str]) -> tuple[Part, ...]:
    """Return the mesh that a geometry's ``floats`` are; nothing without drawable triangles."""
    X_link_geometry = _pose_of(geometry)
    surface = surface_of(geometry.floats, limits, warnings)
    return () if surface is None else (Part(surface, _material_of(geometry), X_link_geometry, "mesh_data"),)


def _parts_of_file(geometry: Geometry, files: MeshFiles, warnings: list[str]) -> tuple[Part, ...]:
    """Return the parts of a mesh file, or of one in JSON. Those without materials get the colour, as in Drake."""
    X_link_geometry = _pose_of(geometry)
    scale = _scale_of(geometry.floats.tolist())
    if geometry.text.startswith("{"):
        parts = memory_mesh(geometry.text, scale, files, warnings)
    else:
        parts = files.load(geometry.text, scale, warnings)
    default_material = _material_of(geometry)
    return tuple(
        msgspec.structs.replace(
            part,
            material=default_material if part.material is PLAIN_MATERIAL else part.material,
            X_node_part=X_link_geometry @ part.X_node_part,
        )
        for part in parts
    )


def _material_of(geometry: Geometry) -> Material:
    """Return the material of a geometry's colour, sRGB and alpha, clipped to 0 .. 1; 0 for NaN."""
    r, g, b, alpha = (0.0 if math.isnan(value) else min(max(value, 0.0), 1.0) for value in geometry.color)
    return material((r, g, b, alpha))


def _pose_of(geometry: Geometry) -> NDArray[np.float64]:
    """Return X_link_geometry. Raises MessageError if it is not finite."""
    if not all(map(math.isfinite, (*geometry.position, *geometry.quaternion))):
        raise MessageError("the pose of a geometry is not finite")
    return from_pose(geometry.position, geometry.quaternion)


def _scale_of(floats: list[float]) -> tuple[float, float, float]:
    """Return the scale of a mesh file along x, y, z. Drake sends three numbers; one holds for all, none means 1."""
    if not all(map(math.isfinite, floats)):
        raise MessageError("the scale of a mesh file is not finite")
    match floats:
        case []:
            return 1.0, 1.0, 1.0
        case [scale]:
            return scale, scale, scale
        case [x, y, z]:
            return x, y, z
    raise MessageError(f"a mesh file has {len(floats)} scale numbers instead of 0, 1 or 3")


_SHAPES: Final[dict[int, tuple[str, int, Callable[[list[float]], Shape]]]] = {
    GeometryType.BOX: ("box", 3, lambda sizes: Box((sizes[0], sizes[1], sizes[2]))),
    GeometryType.SPHERE: ("sphere", 1, lambda sizes: Sphere(sizes[0])),
    GeometryType.CYLINDER: ("cylinder", 2, lambda sizes: Cylinder(sizes[0], sizes[1])),
    GeometryType.CAPSULE: ("capsule", 2, lambda sizes: Capsule(sizes[0], sizes[1])),
    GeometryType.ELLIPSOID: ("ellipsoid", 3, lambda sizes: Ellipsoid((sizes[0], sizes[1], sizes[2]))),
}
"""Name, number of ``float_data`` and constructor of each shape."""


MAX_NAME_CHARS: Final = 4096
"""Maximum length of the name of a mesh in memory, which the browser shows."""


def surface_of(numbers: NDArray[np.float32], limits: Limits, warnings: list[str]) -> Surface | None:
    """Return the mesh in a geometry's ``float_data``: V, T, coordinates of V vertices, indices of T triangles.

    None without drawable triangles. Raises MessageError if the numbers are not a mesh, or beyond a limit.
    """
    vertex_count, triangle_count = _count(numbers, 0), _count(numbers, 1)
    if vertex_count > limits.vertices or triangle_count > limits.triangles:
        raise MessageError(
            f"a mesh has {vertex_count} vertices and {triangle_count} triangles, "
            f"the limits are {limits.vertices} and {limits.triangles}"
        )
    end = 2 + 3 * vertex_count
    if len(numbers) != end + 3 * triangle_count:
        raise MessageError(
            f"a mesh of {vertex_count} vertices and {triangle_count} triangles has {len(numbers)} numbers"
        )
    positions = numbers[2:end].reshape(vertex_count, 3).copy()
    with np.errstate(invalid="ignore"):
        indices = numbers[end:].reshape(triangle_count, 3).astype(np.int64)
    triangles = drawable_triangles(positions, indices, warnings)
    return Surface(Mesh(*smooth_mesh(positions, triangles))) if len(triangles) else None


def drawable_triangles(
    positions: NDArray[np.float32], indices: NDArray[np.integer], warnings: list[str]
) -> NDArray[np.uint32]:
    """Return the triangles whose vertices are finite, (M, 3) uint32. The other vertices become 0, with a warning.

    Raises MessageError if an index is not below the number of vertices.
    """
    if indices.size and not (indices.min() >= 0 and indices.max() < len(positions)):
        raise MessageError(f"a triangle has the vertices {indices.min()} to {indices.max()} of {len(positions)}")
    triangles = indices.astype(np.uint32)
    finite = np.asarray(np.isfinite(positions).all(axis=1))
    if not finite.all():
        triangles = triangles[finite[triangles].all(axis=1)]
        positions[~finite] = 0.0
        warnings.append(f"{int((~finite).sum())} vertices are not finite; their triangles are not drawn")
    return np.ascontiguousarray(triangles)


def _count(numbers: NDArray[np.float32], index: int) -> int:
    """Return a number as a count. Raises MessageError if it is missing, negative or not whole."""
    value = float(numbers[index]) if len(numbers) > index else -1.0
    if not (value >= 0.0 and value.is_integer()):
        raise MessageError(f"a mesh starts with {value:g}, which is not a number of vertices or triangles")
    return int(value)


class FileSource(msgspec.Struct):
    """A file: its path on the sender's machine, or its contents."""

    path: str | None = None
    contents: str | None = None
    """Base64."""
    extension: str = ""
    """Extension of the file's name with its dot."""
    filename_hint: Annotated[str, msgspec.Meta(max_length=MAX_NAME_CHARS)] = ""
    """File name for error messages."""

    def data(self, files: MeshFiles) -> bytes:
        """Return the file's bytes. Raises MeshFileError if it cannot be read, MessageError if it is not base64."""
        if self.path is not None:
            return files.read(self.path)
        try:
            return pybase64.b64decode(self.contents or "", validate=True)  # 27 MB in 8 ms, base64 keeps the GIL for 80
        except ValueError as error:  # binascii.Error, or characters that are not ASCII
            raise MessageError(f"the mesh in memory {quoted(self.filename_hint)} is not base64: {error}") from None


class InMemoryMesh(msgspec.Struct):
    """A mesh file, and the files that it refers to by their names."""

    mesh_file: FileSource
    supporting_files: dict[str, FileSource] = msgspec.field(default_factory=dict)


class MeshText(msgspec.Struct):
    """The JSON object in ``string_data``."""

    in_memory_mesh: InMemoryMesh


_decoder: Any = msgspec.json.Decoder(MeshText)


def memory_mesh(
    text: str, scale: tuple[float, float, float], files: MeshFiles, warnings: list[str]
) -> tuple[Part, ...]:
    """Return the parts of a mesh in JSON, the ``string_data`` of a geometry, scaled along x, y, z.

    Raises MessageError if the JSON is not a mesh, MeshFileError if the mesh cannot be parsed.
    """
    try:
        mesh: InMemoryMesh = _decoder.decode(text).in_memory_mesh
    except (msgspec.DecodeError, RecursionError) as error:
        raise MessageError(f"the mesh in memory cannot be read: {error}") from None
    source = mesh.mesh_file

    def resolve(name: str) -> bytes:
        supporting = mesh.supporting_files.get(name)
        if supporting is None:
            raise MeshFileError(f"{quoted(name)} is not in the message", missing=True)
        return supporting.data(files)

    name = source.filename_hint or f"mesh{source.extension}"
    return files.parse(source.data(files), source.extension.lstrip(".").lower(), resolve, name, scale, warnings)
