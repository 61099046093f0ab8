"""Reads the meshes of a URDF or SDF robot, and converts its geometry to parts of the scene."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.assets.mesh_formats import (
    MeshFormatError,
    decodable_texture,
    diffuse_material,
    parse_mesh,
    with_default_materials,
)
from gateway.files.gltf import GltfError, Up
from gateway.files.robots.robot import RobotLimits
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.materials import mean_color
from gateway.scene.tree.transforms import scaling, translation
from renderers import primitives
from renderers.drawlist import Image, ImageError, Material, Mesh, Texture
from renderers.images import image_from_bytes
from scenegate.messages.geometry import Box
from scenegate.robots.link_model import Cone, Link, LinkGeometry, LinkMaterial, MeshReference
from scenegate.robots.robot_files import LinkFiles, RobotFiles, color_of
from scenegate.robots.textured_box import textured_box


class LinkParts:
    """Converts geometry to parts."""

    def __init__(self, files: RobotFiles, limits: RobotLimits, warnings: list[str], gltf_up: Literal["y", "z"]) -> None:
        """``gltf_up``: up axis of glTF meshes. Those that Drake merged are Z up in any case."""
        self._files = files
        self._link_files = LinkFiles(files, warnings, (MeshFormatError, GltfError, ImageError))
        self._warnings = warnings
        self._gltf_up: Up = "auto" if gltf_up == "y" else "z"
        self._limits = limits

    def of_links(self, links: Iterable[Link]) -> tuple[tuple[Part, ...], ...]:
        """Return the parts of each link, in the link's frame. What cannot be read is left out with a warning."""
        return tuple(tuple(part for each in link.geometries for part in self._parts(link.name, each)) for link in links)

    def _parts(self, link: str, geometry: LinkGeometry) -> list[Part]:
        shape, X = geometry.shape, geometry.X_link_geometry
        material, textured = self._materials(link, geometry.material)
        if isinstance(shape, Cone):
            X_cone = translation(0.0, 0.0, 0.5 * shape.length) @ scaling(shape.radius, shape.radius, shape.length)
            return [Part(Surface(primitives.cone()), material, X @ X_cone)]
        if isinstance(shape, Box) and textured.base_color_texture is not None:
            box = textured_box(0.5 * np.array(shape.lengths))
            return [Part(Surface(Mesh(box.positions, box.triangles, box.normals, uv0=box.uv)), textured, X)]
        if not isinstance(shape, MeshReference):
            return [Part(shape, material, X)]
        X = X @ scaling(*shape.scale)
        parts = self._link_files.mesh(link, shape, lambda path, data: self._read_mesh(link, shape, path, data)) or ()
        if shape.center and parts:
            X = X @ translation(*-_centre(parts))
        parts = with_default_materials(parts, material, textured)
        return [msgspec.structs.replace(part, X_node_part=X @ part.X_node_part) for part in parts]

    def _materials(self, link: str, material: LinkMaterial | None) -> tuple[Material, Material]:
        """Return two materials: of the texture's mean colour, for geometry without texture coordinates; for others."""
        rgba = np.array(color_of(material))
        texture = self._link_files.texture(link, material, self._read_image)
        if material is None or texture is None:
            plain = diffuse_material(rgba, None)
            return plain, plain
        image, mean = texture
        textured = diffuse_material(rgba, Texture(image, name=material.texture or ""))
        return replace(textured, base_color=(*mean, rgba[3]), base_color_texture=None), textured

    def _read_mesh(self, link: str, mesh: MeshReference, path: Path, data: bytes) -> tuple[Part, ...]:
        warnings: list[str] = []
        extension = Path(mesh.filename).suffix[1:].lower()
        if mesh.submesh and extension not in ("dae", "obj"):
            warnings.append("<submesh> is ignored, the whole mesh is shown")
        parts = parse_mesh(
            data,
            extension,
            lambda other: self._files.read_beside(path, other),
            self._limits.mesh,
            warnings,
            collada_up_axis=False,
            gltf_up=self._gltf_up,
            submesh=mesh.submesh,
        )
        self._warnings += [f"link {link!r}, {mesh.filename}: {text}" for text in warnings]
        return parts

    def _read_image(self, path: Path, data: bytes) -> tuple[Image, tuple[float, float, float]]:
        """Return an image and its mean colour."""
        image = image_from_bytes(decodable_texture(data), max_pixels=self._limits.mesh.max_image_pixels)
        image.decode()
        return image, mean_color(image)


def _centre(parts: tuple[Part, ...]) -> NDArray[np.float64]:
    """Return the centre of the bounds of a mesh's parts, (3,)."""
    points = [
        part.shape.mesh.positions @ part.X_node_part[:3, :3].T + part.X_node_part[:3, 3]
        for part in parts
        if isinstance(part.shape, Surface)
    ]
    bounds = np.concatenate([*points, np.zeros((0, 3))])
    return 0.5 * (bounds.min(axis=0) + bounds.max(axis=0)) if len(bounds) else np.zeros(3)
