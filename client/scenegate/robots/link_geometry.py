"""Converts the geometry of a URDF or SDF robot to geometry of the tree viewer's protocol."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, Literal

import msgspec
import numpy as np

from scenegate.messages.geometry import Geometry, MeshGeometry, Transform
from scenegate.messages.mesh_file import MeshFile, referenced_files
from scenegate.robots.link_files import LinkFiles, color_of
from scenegate.robots.link_model import Cone, Link, LinkGeometry, MeshReference
from scenegate.robots.robot_files import RobotFiles

_CONE_SEGMENTS: Final = 48


class LinkGeometries:
    """Converts geometry. Mesh and image files are sent as they are, with the files that meshes refer to."""

    def __init__(self, files: RobotFiles, warnings: list[str], gltf_up: Literal["y", "z"]) -> None:
        """``gltf_up``: up axis of glTF meshes. Those that Drake merged are Z up in any case."""
        self._files = files
        self._link_files = LinkFiles(files, warnings)
        self._warnings = warnings
        self._gltf_up = gltf_up

    def of_links(self, links: Iterable[Link]) -> tuple[tuple[Geometry, ...], ...]:
        """Return the geometry of each link. What cannot be read is left out with a warning."""
        return tuple(tuple(each for part in link.geometries for each in self._of(link.name, part)) for link in links)

    def _of(self, link: str, geometry: LinkGeometry) -> Iterator[Geometry]:
        shape, color, transform = geometry.shape, color_of(geometry.material), Transform.of(geometry.X_link_geometry)
        texture = self._link_files.texture(link, geometry.material, lambda path, data: data)
        if isinstance(shape, MeshReference):
            content = self._link_files.mesh(link, shape, lambda path, data: self._content(link, shape, path, data))
            if content is None:
                return
            if shape.center:
                self._warnings.append(f"link {link!r}, {shape.filename}: <center> is ignored, the mesh is not moved")
            is_gltf = shape.filename.lower().endswith((".gltf", ".glb"))
            yield MeshFile(
                shape.filename,
                shape.scale,
                data=content[0],
                files=content[1],
                up=None if is_gltf and self._gltf_up == "y" else "z",
                default_color=color,
                default_texture=texture,
                transform=transform,
            )
            return
        if texture is not None:
            self._warnings.append(f"link {link!r}: its material's texture is not shown, only on meshes")
        if isinstance(shape, Cone):
            yield _cone(shape, color, transform)
        else:
            yield msgspec.structs.replace(shape, color=color, transform=transform)

    def _content(self, link: str, mesh: MeshReference, path: Path, data: bytes) -> tuple[bytes, dict[str, bytes]]:
        if mesh.submesh:
            self._warnings.append(f"link {link!r}, {mesh.filename}: <submesh> is ignored, the whole mesh is shown")
        suffix = Path(mesh.filename).suffix.lower()
        return data, referenced_files(data, suffix, lambda other: self._files.read_beside(path, other))


def _cone(cone: Cone, color: tuple[float, float, float, float], transform: Transform) -> MeshGeometry:
    """Return a cone: its tip is at length / 2, its base at -length / 2, as in FCL."""
    angles = np.linspace(0.0, 2.0 * np.pi, _CONE_SEGMENTS, endpoint=False)
    height, radius = 0.5 * cone.length, cone.radius
    rim = np.column_stack((radius * np.cos(angles), radius * np.sin(angles), np.full(len(angles), -height)))
    vertices = np.concatenate((rim, [(0.0, 0.0, height), (0.0, 0.0, -height)]))
    this, after = np.arange(_CONE_SEGMENTS), np.roll(np.arange(_CONE_SEGMENTS), -1)
    tip, centre = np.full(_CONE_SEGMENTS, _CONE_SEGMENTS), np.full(_CONE_SEGMENTS, _CONE_SEGMENTS + 1)
    faces = np.concatenate((np.column_stack((this, after, tip)), np.column_stack((after, this, centre))))
    return MeshGeometry(vertices, faces, color=color, transform=transform)
