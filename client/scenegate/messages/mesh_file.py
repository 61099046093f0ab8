"""Mesh files, which the viewer opens, or which are sent with the files that they refer to."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal
from urllib.parse import unquote

import msgspec

from scenegate.messages.field_kinds import UNCONVERTED, ColorOnUse, FileName, Scale
from scenegate.messages.geometry import Geometry
from scenegate.regular_files import read_regular

MESH_SUFFIXES: Final = (".dae", ".glb", ".gltf", ".obj", ".ply", ".stl", ".vtk")
"""Formats of mesh files that Scenegate reads."""
MAX_FILES: Final = 1000
"""Maximum number of files that a mesh file refers to; further ones are not sent."""
_MATERIAL_FILE: Final = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_MATERIAL_IMAGE: Final = re.compile(rb"^[ \t]*(?:map_\w+|bump|disp|decal|norm|refl)[ \t]+([^\r\n]+)", re.MULTILINE)
_COLLADA_IMAGE: Final = re.compile(rb"<init_from>\s*(?:<ref>\s*)?([^<]+)<")
_PLY_IMAGE: Final = re.compile(rb"^comment[ \t]+(?i:TextureFile)[ \t]+([^\r\n]+)", re.MULTILINE)
_MAX_WORDS: Final = 32
"""Maximum number of words of a line at which a name is looked for."""
_MAX_PLY_HEADER_BYTES: Final = 1 << 16
_GLB_HEADER_BYTES: Final = 20
"""Bytes before the JSON of a GLB file."""
_GLB_JSON_SIZE: Final = slice(12, 16)
"""Bytes with the size of the JSON, in that header."""


class MeshFile(Geometry, frozen=True):
    """Mesh in a file that the viewer reads.

    ``data`` and the fields after it, which need it, are for Scenegate; other viewers look for ``filename``.

    Attributes:
        filename: Path on the viewer's machine, below a folder that the viewer's settings allow, or a ``package://``
            URL.
        scale: Scale factor, or one each for x, y, z.
        data: Content of the file, whose format is the suffix of ``filename``; None: the viewer opens the file.
        files: Content of the files that ``data`` refers to, by name as in ``data``: materials, buffers, images.
        up: ``z``: coordinates are used as they are in the file; None: as its format and content define the up axis.
        default_color: Colour of meshes without a material of their own, in any form of ``color``; None: the viewer's.
        default_texture: PNG or JPEG file for meshes with texture coordinates, but without a material of their own.
    """

    kind = "mesh_file"
    filename: FileName
    scale: Scale = 1.0
    data: Annotated[bytes, UNCONVERTED] | None = None
    files: Annotated[Mapping[str, bytes], UNCONVERTED] = msgspec.field(default_factory=dict)
    up: Annotated[Literal["z"], UNCONVERTED] | None = None
    default_color: ColorOnUse | None = None
    default_texture: Annotated[bytes, UNCONVERTED] | None = None

    @classmethod
    def read(cls, path: str | os.PathLike[str], **options: Any) -> MeshFile:
        """Return a geometry with the content of a file on this machine, and of the files that it refers to.

        Args:
            path: Mesh file.
            options: Other fields, such as ``scale`` and ``color``.

        Raises:
            ValueError: the format is not known.
            OSError: the file cannot be read.
        """
        source = Path(path)
        suffix = source.suffix.lower()
        if suffix not in MESH_SUFFIXES:
            raise ValueError(f"{path} is not a mesh file of a known format ({', '.join(MESH_SUFFIXES)})")
        data = read_regular(source)

        def read_referenced(name: str) -> bytes:
            path = referenced_path(source, name)
            if not path.is_file():  # named by its path on another machine, it may lie beside the mesh file
                path = source.parent / spellings(name)[-1].rpartition("/")[2]
            return read_regular(path)

        files = referenced_files(data, suffix, read_referenced)
        return cls(source.name, data=data, files=files, **options)

    def _fields(self) -> dict[str, Any]:
        """Return the fields; without ``data`` those that every viewer has."""
        fields = Geometry._fields(self)
        if self.data is None:
            if not (self.up is self.default_color is self.default_texture is None):
                raise ValueError("up, default_color and default_texture need data, the content of the mesh file")
            return {name: fields[name] for name in ("filename", "scale")}
        return fields | {"files": dict(self.files)}


def spellings(name: str) -> list[str]:
    """Return the names that a file may have: the name itself, slashes for its backslashes, its URL escapes decoded."""
    slashes = name.replace("\\", "/")
    return list(dict.fromkeys((name, slashes, unquote(slashes))))


def referenced_path(mesh: Path, name: str) -> Path:
    """Return the path of a file that a mesh file refers to, which need not exist.

    The name is relative to the mesh file, in any of ``spellings``. As in Gazebo, images of a model may also lie in its
    folder ``materials/textures``, beside the folder of its meshes.
    """
    paths = [mesh.parent / spelling for spelling in spellings(name)]
    textures = mesh.parent / ".." / "materials" / "textures"
    paths += [textures / path.name for path in paths]
    return next((path for path in paths if path.is_file()), paths[0])


def referenced_files(data: bytes, suffix: str, read: Callable[[str], bytes]) -> dict[str, bytes]:
    """Return the files that a mesh file refers to, by name as in it. Files that cannot be read are left out.

    ``read`` returns the bytes of a file by its name; it may raise OSError or ValueError.
    """
    files_by_name: dict[str, bytes] = {}
    names = list(_referenced_names(data, suffix))  # a stack: material files add the names of their images
    while names and len(files_by_name) < MAX_FILES:
        name = names.pop()
        if name in files_by_name:
            continue
        try:
            files_by_name[name] = read(name)
        except (OSError, ValueError):
            continue
        if suffix == ".obj" and name.lower().endswith(".mtl"):
            names += _matched_names(_MATERIAL_IMAGE, files_by_name[name])
    return files_by_name


def _referenced_names(data: bytes, suffix: str) -> Iterator[str]:
    if suffix == ".obj":
        yield from _matched_names(_MATERIAL_FILE, data)
    elif suffix == ".ply":
        yield from _matched_names(_PLY_IMAGE, data[:_MAX_PLY_HEADER_BYTES].partition(b"end_header")[0])
    elif suffix == ".dae":
        yield from _matched_names(_COLLADA_IMAGE, data)
    elif suffix in (".gltf", ".glb"):
        json_bytes = data
        if suffix == ".glb":
            json_size = int.from_bytes(data[_GLB_JSON_SIZE], "little")
            json_bytes = data[_GLB_HEADER_BYTES : _GLB_HEADER_BYTES + json_size]
        try:
            document = json.loads(json_bytes)
            entries = [*document.get("buffers", ()), *document.get("images", ())]
            uris = [entry.get("uri") for entry in entries]
        except (ValueError, AttributeError, TypeError, RecursionError):
            return  # the viewer says what is wrong with it
        yield from (uri for uri in uris if isinstance(uri, str) and not uri.startswith("data:"))


def _matched_names(pattern: re.Pattern[bytes], data: bytes) -> Iterator[str]:
    """Yield what may be names in the rest of the line: names may have spaces, and options may stand before them."""
    for match in pattern.finditer(data):
        line = match[1].strip().decode("utf-8", "replace")
        words = list(re.finditer(r"\S+", line))[:_MAX_WORDS]
        yield from dict.fromkeys((*(line[word.start() :] for word in words), *(word[0] for word in words)))
