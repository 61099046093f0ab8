"""Reads the meshes of a URDF robot, and converts its geometry to parts of the scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from gateway.assets.mesh_formats import (
    FORMATS,
    PLAIN_MATERIAL,
    EmptyMeshError,
    MeshFormatError,
    diffuse_material,
    parse_mesh,
)
from gateway.gltf import GltfError
from gateway.robots.errors import RobotFileError
from gateway.robots.files import RobotFiles
from gateway.robots.limits import RobotLimits
from gateway.robots.urdf_model import UrdfGeometry, UrdfMaterial, UrdfMesh
from gateway.scene.geometry import Part, Surface
from gateway.scene.materials import mean_color
from gateway.scene.transforms import scaling
from renderers.drawlist import Image, ImageError, Material
from renderers.images import image_from_bytes

DEFAULT_RGBA: Final = (0.9, 0.9, 0.9, 1.0)
"""Colour of geometry without a material, as in Drake."""
_LFS_POINTER: Final = b"version https://git-lfs"


class UrdfParts:
    """Converts geometry to parts. A mesh file that several geometries use is read once."""

    def __init__(self, files: RobotFiles, limits: RobotLimits) -> None:
        self._files = files
        self._limits = limits
        self._meshes: dict[Path, tuple[Part, ...]] = {}
        self._textures: dict[str, tuple[Image, tuple[float, float, float]] | str] = {}
        """Image and mean colour of each texture, or the reason why it cannot be read, by file name or URL."""
        self.warnings: dict[str, None] = {}
        """Sentences about content that is not shown, as keys: an ordered set."""

    def parts_of(self, link: str, geometries: tuple[UrdfGeometry, ...]) -> tuple[Part, ...]:
        """Return the parts of a link, in the link's frame.

        Args:
            link: Name of the link, for errors.
            geometries: Its visual or collision geometries.

        Raises:
            RobotFileError: A mesh file is missing or cannot be read.
        """
        return tuple(part for geometry in geometries for part in self._parts(link, geometry))

    def _parts(self, link: str, geometry: UrdfGeometry) -> list[Part]:
        shape, X = geometry.shape, geometry.X_link_geometry
        material, textured = self._materials(link, geometry.material)
        if not isinstance(shape, UrdfMesh):
            return [Part(shape, material, X)]
        try:
            parts = self._mesh(shape.filename)
        except EmptyMeshError as error:
            self.warnings[f"link {link!r}: {shape.filename} is not shown: {error}"] = None
            return []
        except (RobotFileError, MeshFormatError, GltfError) as error:
            name = "" if shape.filename in str(error) else f"{shape.filename}: "
            raise RobotFileError(f"link {link!r}: {name}{error}") from None
        except OSError as error:
            raise RobotFileError(f"link {link!r}: {shape.filename} cannot be read: {error.strerror}") from None
        X = X @ scaling(*shape.scale)

        def material_of(part: Part) -> Material:
            if _has_material(part):
                return part.material
            return textured if _has_uv(part) else material

        return [
            msgspec.structs.replace(part, X_node_part=X @ part.X_node_part, material=material_of(part))
            for part in parts
        ]

    def _materials(self, link: str, material: UrdfMaterial | None) -> tuple[Material, Material]:
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
            self.warnings[f"link {link!r}: the texture {name} of its material is not shown: {texture}"] = None
            return plain, plain
        image, mean = texture
        textured = diffuse_material(rgba, image)
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

    def _mesh(self, name: str) -> tuple[Part, ...]:
        """Return the parts of a mesh file; raises OSError, RobotFileError, MeshFormatError or GltfError."""
        extension = Path(name).suffix[1:].lower()
        if extension not in FORMATS:
            raise RobotFileError(f"{name} is not one of the formats {', '.join(sorted(FORMATS))}")
        path = self._files.find(name)
        if path not in self._meshes:
            data = self._files.read(path)
            if data.startswith(_LFS_POINTER):
                raise RobotFileError(f"{name} is a pointer of Git LFS, not the mesh: run git lfs pull")
            self._meshes[path] = parse_mesh(
                data,
                extension,
                lambda other: self._files.read_beside(path, other),
                self._limits.mesh,
                collada_up_axis=False,
            )
        return self._meshes[path]


def _has_material(part: Part) -> bool:
    """Return True if the mesh file has a material or colours, which then override the robot file's, as in RViz."""
    colored = isinstance(part.shape, Surface) and part.shape.mesh.colors is not None
    return part.material != PLAIN_MATERIAL or colored


def _has_uv(part: Part) -> bool:
    return isinstance(part.shape, Surface) and part.shape.mesh.uv0 is not None
