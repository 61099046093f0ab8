"""Converts the geometry of a URDF or SDF robot to geometry of the tree viewer's protocol."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal

import msgspec
import numpy as np

from scenegate.messages.geometry import Geometry, Mesh, Transform
from scenegate.messages.mesh_file import MESH_SUFFIXES, MeshFile, referenced_files
from scenegate.robots.errors import RobotFileError
from scenegate.robots.files import RobotFiles
from scenegate.robots.link_model import Cone, Link, LinkGeometry, MeshReference

DEFAULT_RGBA: Final = (0.9, 0.9, 0.9, 1.0)
"""Colour of geometry without a material, as in Drake."""
LFS_POINTER: Final = b"version https://git-lfs"
"""Start of the file that stands for a mesh until ``git lfs pull``."""
_CONE_SEGMENTS: Final = 48


class LinkGeometries:
    """Converts geometry. A mesh file that several geometries use is read once, and sent as it is."""

    def __init__(self, files: RobotFiles, warnings: list[str], gltf_up: Literal["y", "z"]) -> None:
        """
        Args:
            warnings: Warnings are appended to this list. A mesh that cannot be read is left out.
            gltf_up: Up axis of glTF meshes. Those that Drake wrote are Z up in any case.
        """
        self._files = files
        self._warnings = warnings
        self._gltf_up = gltf_up
        self._meshes: dict[Path, tuple[bytes, dict[str, bytes]]] = {}
        """Content of mesh files, and of the files that they refer to."""
        self._textures: dict[str, bytes | str] = {}
        """Content of image files, or the reason why one cannot be read, by file name or URL."""

    def geometries_of(self, links: tuple[Link, ...]) -> tuple[tuple[Geometry, ...], ...]:
        """Return the geometries of each link, in the link's frame."""
        return tuple(
            tuple(each for geometry in link.geometries for each in self._one(link, geometry)) for link in links
        )

    def _one(self, link: Link, geometry: LinkGeometry) -> Iterator[Geometry]:
        shape, material = geometry.shape, geometry.material
        color = DEFAULT_RGBA if material is None or material.rgba is None else material.rgba
        transform = Transform.of(geometry.X_link_geometry)
        texture = None if material is None or material.texture is None else self._texture(link, material.texture)
        if isinstance(shape, MeshReference):
            try:
                data, others = self._mesh(shape.filename)
            except (RobotFileError, OSError) as error:
                reason = error.strerror if isinstance(error, OSError) else error
                self._warnings.append(f"link {link.name!r}: the mesh {shape.filename} is not shown: {reason}")
                return
            is_gltf = shape.filename.lower().endswith((".gltf", ".glb"))
            yield MeshFile(
                shape.filename,
                shape.scale,
                data=data,
                files=others,
                up=None if is_gltf and self._gltf_up == "y" else "z",
                default_color=color,
                default_texture=texture,
                transform=transform,
            )
            return
        if texture is not None:
            self._warnings.append(f"link {link.name!r}: its material's texture is not shown, only on meshes")
        if isinstance(shape, Cone):
            yield _cone(shape, color, transform)
        else:
            yield msgspec.structs.replace(shape, color=color, transform=transform)

    def _texture(self, link: Link, name: str) -> bytes | None:
        """Return an image file; None, with a warning, if it cannot be read."""
        if name not in self._textures:
            try:
                self._textures[name] = self._files.read(self._files.find(name))
            except (RobotFileError, OSError) as error:
                self._textures[name] = str(error.strerror if isinstance(error, OSError) else error)
        texture = self._textures[name]
        if isinstance(texture, bytes):
            return texture
        self._warnings.append(f"link {link.name!r}: the texture {name} of its material is not shown: {texture}")
        return None

    def _mesh(self, name: str) -> tuple[bytes, dict[str, bytes]]:
        """Return a mesh file and those that it refers to; raises OSError or RobotFileError."""
        suffix = Path(name).suffix.lower()
        if suffix not in MESH_SUFFIXES:
            raise RobotFileError(f"it is not one of the formats {', '.join(each[1:] for each in MESH_SUFFIXES)}")
        path = self._files.find(name)
        if path not in self._meshes:
            data = self._files.read(path)
            if data.startswith(LFS_POINTER):
                raise RobotFileError("it is a pointer of Git LFS, not the mesh: run git lfs pull")
            self._meshes[path] = (
                data,
                referenced_files(data, suffix, lambda other: self._files.read_beside(path, other)),
            )
        return self._meshes[path]


def _cone(cone: Cone, color: tuple[float, float, float, float], transform: Transform) -> Mesh:
    """Return a cone: its tip is at length / 2, its base at -length / 2, as in FCL."""
    angles = np.linspace(0.0, 2.0 * np.pi, _CONE_SEGMENTS, endpoint=False)
    height, radius = 0.5 * cone.length, cone.radius
    rim = np.column_stack((radius * np.cos(angles), radius * np.sin(angles), np.full(len(angles), -height)))
    vertices = np.concatenate((rim, [(0.0, 0.0, height), (0.0, 0.0, -height)]))
    this, after = np.arange(_CONE_SEGMENTS), np.roll(np.arange(_CONE_SEGMENTS), -1)
    tip, centre = np.full(_CONE_SEGMENTS, _CONE_SEGMENTS), np.full(_CONE_SEGMENTS, _CONE_SEGMENTS + 1)
    faces = np.concatenate((np.column_stack((this, after, tip)), np.column_stack((after, this, centre))))
    return Mesh(vertices, faces, color=color, transform=transform)
