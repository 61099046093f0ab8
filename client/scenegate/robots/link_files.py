"""Reads the mesh and image files that the links of a URDF or SDF robot name. What cannot be read is a warning."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import ClassVar, Final, Generic, TypeVar

from scenegate.messages.mesh_file import MESH_SUFFIXES
from scenegate.regular_files import reason_of
from scenegate.robots.errors import RobotFileError
from scenegate.robots.files import RobotFiles
from scenegate.robots.link_model import Link, LinkGeometry, LinkMaterial, MeshReference

PartType = TypeVar("PartType")
MeshType = TypeVar("MeshType")
ImageType = TypeVar("ImageType")

DEFAULT_RGBA: Final = (0.9, 0.9, 0.9, 1.0)
"""Colour of geometry without a material, as in Drake."""
_LFS_POINTER: Final = b"version https://git-lfs"
"""Start of the file that stands for another one until ``git lfs pull``."""


Content = TypeVar("Content")
Key = TypeVar("Key")


class LinkFiles(ABC, Generic[PartType, MeshType, ImageType]):
    """Base class that finds and reads files, each name once. Subclasses parse them, and make parts of geometry."""

    read_errors: ClassVar[tuple[type[Exception], ...]] = (RobotFileError, OSError)
    """Errors of files that cannot be read."""

    def __init__(self, files: RobotFiles, warnings: list[str]) -> None:
        self._files = files
        self._warnings = warnings
        self._meshes: dict[tuple[str, str], MeshType | str] = {}
        """Meshes, or the reason why one cannot be read, by file name or URL, and submesh."""
        self._images: dict[str, ImageType | str] = {}
        """Images in the same way."""

    def parts_of(self, links: Iterable[Link]) -> tuple[tuple[PartType, ...], ...]:
        """Return the geometry of each link, in the link's frame."""
        return tuple(
            tuple(part for geometry in link.geometries for part in self._parts(link.name, geometry)) for link in links
        )

    @abstractmethod
    def _parts(self, link: str, geometry: LinkGeometry) -> Iterable[PartType]:
        """Return a geometry of a link; nothing, with a warning, if its mesh cannot be read."""

    @abstractmethod
    def _read_mesh(self, link: str, mesh: MeshReference, path: Path, data: bytes) -> MeshType:
        """Return the mesh in a file with the given content, which a link names first; raises ``read_errors``."""

    @abstractmethod
    def _read_image(self, data: bytes) -> ImageType:
        """Return the image in a file with the given content; raises ``read_errors``."""

    def _mesh_or_warning(self, link: str, mesh: MeshReference) -> MeshType | None:
        """Return a mesh; None, with a warning, if it cannot be read."""
        name = mesh.filename

        def read() -> MeshType:
            if Path(name).suffix.lower() not in MESH_SUFFIXES:
                raise RobotFileError(f"it is not one of the formats {', '.join(each[1:] for each in MESH_SUFFIXES)}")
            return self._read_mesh(link, mesh, *self._read(name))

        warning = f"link {link!r}: the mesh {name} is not shown"
        return self._content_or_warning(self._meshes, (name, mesh.submesh), read, warning)

    def _texture_or_warning(self, link: str, material: LinkMaterial | None) -> ImageType | None:
        """Return the texture of a material; None if it has none or, with a warning, if it cannot be read."""
        if material is None or material.texture is None:
            return None
        name = material.texture
        warning = f"link {link!r}: the texture {name} of its material is not shown"
        return self._content_or_warning(self._images, name, lambda: self._read_image(self._read(name)[1]), warning)

    def _content_or_warning(
        self, cache: dict[Key, Content | str], key: Key, read: Callable[[], Content], warning: str
    ) -> Content | None:
        """Return what a file has, which is read once; None, with a warning and the reason, if it cannot be read."""
        if key not in cache:
            try:
                cache[key] = read()
            except self.read_errors as error:
                cache[key] = reason_of(error)
        content = cache[key]
        if isinstance(content, str):
            self._warnings.append(f"{warning}: {content}")
            return None
        return content

    def _read(self, name: str) -> tuple[Path, bytes]:
        """Return the path and the content of a file; raises OSError or RobotFileError."""
        path = self._files.find(name)
        data = self._files.read(path)
        if data.startswith(_LFS_POINTER):
            raise RobotFileError("it is a pointer of Git LFS, not the file: run git lfs pull")
        return path, data


def color_of(material: LinkMaterial | None) -> tuple[float, float, float, float]:
    """Return the colour of geometry with a material, sRGB and opacity."""
    return DEFAULT_RGBA if material is None or material.rgba is None else material.rgba
