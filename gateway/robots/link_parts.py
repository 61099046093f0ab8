"""Reads the meshes of a URDF or SDF robot, and converts its geometry to parts of the scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from gateway.assets.mesh_formats import (
    FORMATS,
    MeshFormatError,
    diffuse_material,
    parse_mesh,
    with_default_materials,
)
from gateway.assets.scene_file import Up
from gateway.gltf import GltfError
from gateway.robots.limits import RobotLimits
from gateway.scene.geometry import Part, Surface
from gateway.scene.materials import mean_color
from gateway.scene.transforms import scaling, translation
from renderers import primitives
from renderers.drawlist import Image, ImageError, Material, Texture
from renderers.images import image_from_bytes
from scenegate.robots.errors import RobotFileError
from scenegate.robots.files import RobotFiles
from scenegate.robots.link_geometry import DEFAULT_RGBA, LFS_POINTER
from scenegate.robots.link_model import Cone, Link, LinkGeometry, LinkMaterial, MeshReference


class LinkParts:
    """Converts geometry to parts. A mesh file that several geometries use is read once."""

    def __init__(self, files: RobotFiles, limits: RobotLimits, warnings: list[str], gltf_up: Literal["y", "z"]) -> None:
        """
        Args:
            warnings: Warnings are appended to this list. A mesh that cannot be read is left out.
            gltf_up: Up axis of glTF meshes. Those that Drake wrote are Z up in any case.
        """
        self._gltf_up: Up = "auto" if gltf_up == "y" else "z"
        self._files = files
        self._limits = limits
        self._meshes: dict[Path, tuple[Part, ...]] = {}
        self._textures: dict[str, tuple[Image, tuple[float, float, float]] | str] = {}
        """Image and mean colour of each texture, or the reason why it cannot be read, by file name or URL."""
        self._warnings = warnings

    def parts_of_links(self, links: tuple[Link, ...]) -> tuple[tuple[Part, ...], ...]:
        """Return the parts of each link, in the link's frame."""
        return tuple(
            tuple(part for geometry in link.geometries for part in self._parts(link.name, geometry)) for link in links
        )

    def _parts(self, link: str, geometry: LinkGeometry) -> list[Part]:
        shape, X = geometry.shape, geometry.X_link_geometry
        material, textured = self._materials(link, geometry.material)
        if isinstance(shape, Cone):
            X_cone = translation(0.0, 0.0, 0.5 * shape.length) @ scaling(shape.radius, shape.radius, shape.length)
            return [Part(Surface(primitives.cone()), material, X @ X_cone)]
        if not isinstance(shape, MeshReference):
            return [Part(shape, material, X)]
        try:
            parts = self._mesh(link, shape.filename)
        except (RobotFileError, MeshFormatError, GltfError, OSError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            self._warnings.append(f"link {link!r}: the mesh {shape.filename} is not shown: {reason}")
            return []
        X = X @ scaling(*shape.scale)
        return [
            msgspec.structs.replace(part, X_node_part=X @ part.X_node_part)
            for part in with_default_materials(parts, material, textured)
        ]

    def _materials(self, link: str, material: LinkMaterial | None) -> tuple[Material, Material]:
        """Return two materials: for geometry without texture coordinates, and for geometry with them.

        The first has the texture's mean colour. A texture that cannot be read adds a warning.
        """
        rgba = np.array(DEFAULT_RGBA if material is None or material.rgba is None else material.rgba)
        plain = diffuse_material(rgba, None)
        if material is None or material.texture is None:
            return plain, plain
        name = material.texture
        texture = self._textures.get(name)
        if texture is None:
            texture = self._textures[name] = self._texture(name)
        if isinstance(texture, str):
            self._warnings.append(f"link {link!r}: the texture {name} of its material is not shown: {texture}")
            return plain, plain
        image, mean = texture
        textured = diffuse_material(rgba, Texture(image, name=name))
        return replace(textured, base_color=(*mean, rgba[3]), base_color_texture=None), textured

    def _texture(self, name: str) -> tuple[Image, tuple[float, float, float]] | str:
        """Read an image file. Return the image and its mean colour, or the reason why it cannot be read."""
        try:
            data = self._files.read(self._files.find(name))
            image = image_from_bytes(data, max_pixels=self._limits.mesh.max_image_pixels)
            image.decode()
            return image, mean_color(image)
        except (RobotFileError, ImageError) as error:
            return str(error)
        except OSError as error:
            return str(error.strerror)

    def _mesh(self, link: str, name: str) -> tuple[Part, ...]:
        """Return the parts of a mesh file; raises OSError, RobotFileError, MeshFormatError or GltfError."""
        extension = Path(name).suffix[1:].lower()
        if extension not in FORMATS:
            raise RobotFileError(f"it is not one of the formats {', '.join(sorted(FORMATS))}")
        path = self._files.find(name)
        if path not in self._meshes:
            data = self._files.read(path)
            if data.startswith(LFS_POINTER):
                raise RobotFileError("it is a pointer of Git LFS, not the mesh: run git lfs pull")
            warnings: list[str] = []
            self._meshes[path] = parse_mesh(
                data,
                extension,
                lambda other: self._files.read_beside(path, other),
                self._limits.mesh,
                warnings,
                collada_up_axis=False,
                gltf_up=self._gltf_up,
            )
            self._warnings += [f"link {link!r}, {name}: {text}" for text in warnings]
        return self._meshes[path]
