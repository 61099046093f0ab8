"""Reads the mesh and image files of a URDF or SDF robot, each once. What cannot be read is a warning."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import ClassVar, Final, Generic, TypeVar

from scenegate.messages.mesh_file import MESH_SUFFIXES
from scenegate.regular_files import reason_of
from scenegate.robots.errors import RobotFileError
from scenegate.robots.files import RobotFiles
from scenegate.robots.link_model import LinkMaterial, MeshReference

MeshType = TypeVar("MeshType")
ImageType = TypeVar("ImageType")

DEFAULT_RGBA: Final = (0.9, 0.9, 0.9, 1.0)
"""Colour of geometry without a material, as in Drake."""
_LFS_POINTER: Final = b"version https://git-lfs"
"""Start of the file that stands for a mesh until ``git lfs pull``."""


class LinkFiles(Generic[MeshType, ImageType]):
    """Base of the converters of geometry, which say what a mesh and an image is."""

    faults: ClassVar[tuple[type[Exception], ...]] = (RobotFileError, OSError)
    """Errors of files that cannot be read."""

    def __init__(self, files: RobotFiles, warnings: list[str]) -> None:
        self._files = files
        self._warnings = warnings
        self._meshes: dict[tuple[Path, str], MeshType] = {}
        """Meshes by file and submesh."""
        self._images: dict[str, ImageType | str] = {}
        """Images, or the reason why one cannot be read, by file name or URL."""

    @abstractmethod
    def _read_mesh(self, link: str, mesh: MeshReference, path: Path, data: bytes) -> MeshType:
        """Return the mesh in a file with the given content, which a link names; raises ``faults``."""

    @abstractmethod
    def _read_image(self, data: bytes) -> ImageType:
        """Return the image in a file with the given content; raises ``faults``."""

    def _mesh(self, link: str, mesh: MeshReference) -> MeshType | None:
        """Return a mesh; None, with a warning, if it cannot be read."""
        name = mesh.filename
        try:
            if Path(name).suffix.lower() not in MESH_SUFFIXES:
                raise RobotFileError(f"it is not one of the formats {', '.join(each[1:] for each in MESH_SUFFIXES)}")
            path = self._files.find(name)
            key = path, mesh.submesh
            if key not in self._meshes:
                data = self._files.read(path)
                if data.startswith(_LFS_POINTER):
                    raise RobotFileError("it is a pointer of Git LFS, not the mesh: run git lfs pull")
                self._meshes[key] = self._read_mesh(link, mesh, path, data)
            return self._meshes[key]
        except self.faults as error:
            self._warnings.append(f"link {link!r}: the mesh {name} is not shown: {reason_of(error)}")
            return None

    def _image(self, link: str, material: LinkMaterial | None) -> ImageType | None:
        """Return the texture of a material; None if it has none or, with a warning, if it cannot be read."""
        if material is None or material.texture is None:
            return None
        name = material.texture
        if name not in self._images:
            try:
                self._images[name] = self._read_image(self._files.read(self._files.find(name)))
            except self.faults as error:
                self._images[name] = reason_of(error)
        image = self._images[name]
        if isinstance(image, str):
            self._warnings.append(f"link {link!r}: the texture {name} of its material is not shown: {image}")
            return None
        return image


def color_of(material: LinkMaterial | None) -> tuple[float, float, float, float]:
    """Return the colour of geometry with a material, sRGB and opacity."""
    return DEFAULT_RGBA if material is None or material.rgba is None else material.rgba
