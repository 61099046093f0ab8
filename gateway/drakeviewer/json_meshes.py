"""Mesh files inside a message (Drake's ``InMemoryMesh``): JSON with contents in base64."""

from __future__ import annotations

from typing import Annotated, Any, Final

import msgspec
import pybase64

from gateway.assets.mesh_files import MeshFileError, MeshFiles, quoted
from gateway.drakeviewer.messages import MessageError
from gateway.scene.geometry import Part

MAX_NAME_CHARS: Final = 4096
"""Maximum length of the name of a mesh in memory, which the browser shows."""


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
        """Return the file's bytes.

        Raises:
            MeshFileError: The file is not below a folder that is open to clients, or cannot be read.
            MessageError: The contents are not base64.
        """
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
    """Return the parts of a mesh in JSON, scaled along x, y, z.

    Args:
        text: ``string_data`` of the geometry.
        files: Parses the mesh, and reads the supporting files that are given by name.
        warnings: Sentences about content that is not shown are appended to this list.

    Raises:
        MessageError: The JSON is not a mesh.
        MeshFileError: The mesh cannot be parsed.
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
