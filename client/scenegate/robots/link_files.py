"""Reads the mesh and image files that the links of a URDF or SDF robot name. What cannot be read is a warning."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

from scenegate.messages.mesh_file import MESH_SUFFIXES
from scenegate.regular_files import reason_of
from scenegate.robots.link_model import LinkMaterial, MeshReference
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.robot_files import RobotFiles

Content = TypeVar("Content")

DEFAULT_RGBA: Final = (0.9, 0.9, 0.9, 1.0)
"""Colour of geometry without a material, as in Drake."""


class LinkFiles:
    """Finds, reads and parses files, each name once."""

    def __init__(self, files: RobotFiles, warnings: list[str], parse_errors: tuple[type[Exception], ...] = ()) -> None:
        """``parse_errors``: those of ``parse`` and ``decode`` for bad files, besides RobotFileError and OSError."""
        self._files = files
        self._warnings = warnings
        self._errors: tuple[type[Exception], ...] = (RobotFileError, OSError, *parse_errors)
        self._contents: dict[tuple[str, ...], Any] = {}
        """Contents, or the reason why a file cannot be read, by name or URL; for meshes also by submesh."""

    def mesh(self, link: str, mesh: MeshReference, parse: Callable[[Path, bytes], Content]) -> Content | None:
        """Return the result of ``parse`` for the path and bytes of a mesh file; None, with a warning, on failure."""
        warning = f"link {link!r}: the mesh {mesh.filename} is not shown"
        if Path(mesh.filename).suffix.lower() not in MESH_SUFFIXES:
            formats = ", ".join(suffix[1:] for suffix in MESH_SUFFIXES)
            self._warnings.append(f"{warning}: it is not one of the formats {formats}")
            return None
        return self._content((mesh.filename, mesh.submesh), parse, warning)

    def texture(
        self, link: str, material: LinkMaterial | None, decode: Callable[[Path, bytes], Content]
    ) -> Content | None:
        """Return the texture of a material as ``decode`` does; None if it has none or, with a warning, on failure."""
        if material is None or material.texture is None:
            return None
        warning = f"link {link!r}: the texture {material.texture} of its material is not shown"
        return self._content((material.texture,), decode, warning)

    def _content(self, key: tuple[str, ...], parse: Callable[[Path, bytes], Content], warning: str) -> Content | None:
        if key not in self._contents:
            try:
                path = self._files.find(key[0])
                data = self._files.read(path)
                self._contents[key] = parse(path, data)
            except self._errors as error:
                self._contents[key] = reason_of(error)
        content: Content | str = self._contents[key]
        if isinstance(content, str):
            self._warnings.append(f"{warning}: {content}")
            return None
        return content


def color_of(material: LinkMaterial | None) -> tuple[float, float, float, float]:
    """Return the colour of geometry with a material, sRGB and opacity."""
    return DEFAULT_RGBA if material is None or material.rgba is None else material.rgba
