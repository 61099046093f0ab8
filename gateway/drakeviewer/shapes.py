"""Read the geometries of links, and deformable bodies, as parts of the scene."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from gateway.assets.mesh_files import MeshFileError, MeshFiles
from gateway.assets.mesh_formats import PLAIN_MATERIAL
from gateway.drakeviewer.config import Limits
from gateway.drakeviewer.link_paths import split_name
from gateway.drakeviewer.meshes import memory_mesh, surface_of
from gateway.drakeviewer.messages import Geometry, GeometryType, Link, MessageError
from gateway.scene.geometry import Part, Shape
from gateway.scene.materials import Color, material
from gateway.scene.transforms import from_pose
from gateway.scene.tree import Path
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere


def read_geometries(
    geometries: Iterable[Geometry], files: MeshFiles, limits: Limits, warnings: list[str]
) -> tuple[Part, ...]:
    """Return the parts of a link's geometries, in the link's frame.

    Args:
        warnings: list to which the reason is added if a geometry cannot be shown. That geometry is left out.
    """
    parts: list[Part] = []
    for geometry in geometries:
        try:
            parts += _parts_of(geometry, files, limits, warnings)
        except (MessageError, MeshFileError) as error:
            warnings.append(str(error))
    return tuple(parts)


def read_deformables(link: Link, family: Path, limits: Limits, warnings: list[str]) -> dict[Path, tuple[Part, ...]]:
    """Return the bodies of a message by path in the live tree. A body without drawable triangles has no parts.

    Args:
        link: the message; each of its geometries is a body.
        family: path of the family of the channel.
        warnings: list to which the reason is added if a mesh is damaged or beyond a limit. That body has no parts.

    Raises:
        MessageError: A name is beyond a limit.
    """
    bodies: dict[Path, tuple[Part, ...]] = {}
    parent = (*family, *split_name(link.key[1], limits))
    for geometry in link.geometries:
        if len(geometry.text) > limits.name_bytes:  # string_data may be as long as a mesh in JSON
            raise MessageError(
                f"the name of a deformable body has {len(geometry.text)} characters, the limit is {limits.name_bytes}"
            )
        path = (*parent, *split_name(geometry.text, limits))
        parts = bodies.setdefault(path, ())
        try:
            surface = surface_of(geometry.floats, limits)
        except MessageError as error:
            warnings.append(str(error))
            continue
        if surface is not None:
            bodies[path] = (*parts, _part(geometry, surface, "mesh_data"))
    return bodies


def _color_of(geometry: Geometry) -> Color:
    """Return a geometry's colour, sRGB and alpha, clipped to 0 .. 1; 0 for NaN."""
    r, g, b, alpha = (min(max(value, 0.0), 1.0) if value == value else 0.0 for value in geometry.color)
    return r, g, b, alpha


def _parts_of(geometry: Geometry, files: MeshFiles, limits: Limits, warnings: list[str]) -> tuple[Part, ...]:
    if not all(map(math.isfinite, (*geometry.position, *geometry.quaternion))):
        raise MessageError("the pose of a geometry is not finite")
    if geometry.type == GeometryType.MESH and geometry.text:
        return _mesh_file(geometry, files, warnings)
    if geometry.type == GeometryType.MESH:
        surface = surface_of(geometry.floats, limits)
        return () if surface is None else (_part(geometry, surface, "mesh_data"),)
    if geometry.type not in _SHAPES:
        raise MessageError(f"geometry type {geometry.type} is unknown")
    kind, count, shape_of = _SHAPES[geometry.type]
    sizes = geometry.floats.tolist()
    if len(sizes) != count:
        raise MessageError(f"a {kind} has {len(sizes)} numbers instead of {count}")
    if not all(0.0 <= size < math.inf for size in sizes):
        raise MessageError(f"a {kind} has the sizes {sizes}: they must be finite and from 0 on")
    return (_part(geometry, shape_of(sizes), kind),)


def _part(geometry: Geometry, shape: Shape, kind: str) -> Part:
    X_link_geometry = from_pose(geometry.position, geometry.quaternion)
    return Part(shape, material(_color_of(geometry)), X_link_geometry, kind)


def _mesh_file(geometry: Geometry, files: MeshFiles, warnings: list[str]) -> tuple[Part, ...]:
    """Load a mesh file, or a mesh in JSON. The geometry's colour is for meshes without materials, as in Drake."""
    scale = _scale_of(geometry.floats.tolist())
    if geometry.text.startswith("{"):
        loaded = memory_mesh(geometry.text, scale, files, warnings)
    else:
        loaded = files.load(geometry.text, scale, warnings)
    X_link_geometry = from_pose(geometry.position, geometry.quaternion)
    own_material = material(_color_of(geometry))
    return tuple(
        msgspec.structs.replace(
            part,
            material=own_material if part.material is PLAIN_MATERIAL else part.material,
            X_node_part=X_link_geometry @ part.X_node_part,
        )
        for part in loaded
    )


def _scale_of(numbers: list[float]) -> tuple[float, float, float]:
    """Return the scale of a mesh file along x, y, z. Drake sends three numbers; one holds for all, none means 1."""
    match numbers:
        case []:
            return 1.0, 1.0, 1.0
        case [scale]:
            return scale, scale, scale
        case [x, y, z]:
            return x, y, z
    raise MessageError(f"a mesh file has {len(numbers)} scale numbers instead of 0, 1 or 3")


_SHAPES: Final[dict[int, tuple[str, int, Callable[[list[float]], Shape]]]] = {
    GeometryType.BOX: ("box", 3, lambda n: Box((n[0], n[1], n[2]))),
    GeometryType.SPHERE: ("sphere", 1, lambda n: Sphere(n[0])),
    GeometryType.CYLINDER: ("cylinder", 2, lambda n: Cylinder(n[0], n[1])),
    GeometryType.CAPSULE: ("capsule", 2, lambda n: Capsule(n[0], n[1])),
    GeometryType.ELLIPSOID: ("ellipsoid", 3, lambda n: Ellipsoid((n[0], n[1], n[2]))),
}
"""Name, number of ``float_data`` and constructor of each shape."""
