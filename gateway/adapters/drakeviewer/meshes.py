"""Triangle meshes in Drake's messages: as numbers (``float_data``), or as files in JSON (``InMemoryMesh``)."""

from typing import Annotated, Any, Final

import msgspec
import numpy as np
import pybase64
from numpy.typing import NDArray

from gateway.adapters.drakeviewer.config import Limits
from gateway.adapters.drakeviewer.wire import MessageError
from gateway.files.assets.mesh_files import MeshFileError, MeshFiles, quoted
from gateway.scene.draw.crease_normals import smooth_mesh
from gateway.scene.tree.geometry import Part, Surface
from renderers.drawlist import Mesh

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
