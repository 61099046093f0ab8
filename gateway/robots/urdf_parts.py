"""Reads the meshes of a URDF robot, and converts its geometry to parts of the scene."""

from __future__ import annotations

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
from gateway.scene.transforms import scaling

DEFAULT_RGBA: Final = (0.9, 0.9, 0.9, 1.0)
"""Colour of geometry without a material, as in Drake."""
_LFS_POINTER: Final = b"version https://git-lfs"


class UrdfParts:
    """Converts geometry to parts. A mesh file that is used several times is read once."""

    def __init__(self, files: RobotFiles, limits: RobotLimits) -> None:
        self._files = files
        self._limits = limits
        self._meshes: dict[Path, tuple[Part, ...]] = {}
        self.warnings: dict[str, None] = {}
        """Sentences about content that is not shown: an ordered set."""

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
        material, shape = geometry.material, geometry.shape
        if material is not None and material.texture is not None:
            self.warnings[f"link {link!r}: the texture {material.texture} of its material is not shown"] = None
        X = geometry.X_link_geometry
        if not isinstance(shape, UrdfMesh):
            return [Part(shape, diffuse_material(_rgba(material), None), X)]
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
        return [
            msgspec.structs.replace(
                part,
                X_node_part=X @ part.X_node_part,
                material=diffuse_material(_rgba(material), None) if _has_no_material(part) else part.material,
            )
            for part in parts
        ]

    def _mesh(self, name: str) -> tuple[Part, ...]:
        """Return the parts of a mesh file; raises OSError, RobotFileError, MeshFormatError or GltfError."""
        extension = Path(name).suffix[1:].lower()
        if extension not in FORMATS:
            raise RobotFileError(f"{name} is none of the formats {', '.join(sorted(FORMATS))}")
        path = self._files.find(name)
        if path not in self._meshes:
            data = self._files.read(path)
            if data.startswith(_LFS_POINTER):
                raise RobotFileError(f"{name} is a pointer of Git LFS, not the mesh: run git lfs pull")
            self._meshes[path] = parse_mesh(
                data,
                extension,
                lambda other: self._files.resolve_beside(path, other),
                self._limits.mesh,
                collada_up_axis=False,
            )
        return self._meshes[path]


def _has_no_material(part: Part) -> bool:
    """Return True for parts of a mesh file without colours. They get the colour of the robot file, as in RViz."""
    colored = isinstance(part.shape, Surface) and part.shape.mesh.colors is not None
    return part.material == PLAIN_MATERIAL and not colored


def _rgba(material: UrdfMaterial | None) -> np.ndarray:
    """Return the colour of a material or the default one, (4,) sRGB and opacity."""
    return np.array(DEFAULT_RGBA if material is None or material.rgba is None else material.rgba)
