"""Read a link's geometries as parts of the scene."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.assets.mesh_files import MeshFileError, MeshFiles
from gateway.assets.mesh_formats import PLAIN_MATERIAL
from gateway.drakeviewer.config import Limits
from gateway.drakeviewer.float_meshes import surface_of
from gateway.drakeviewer.json_meshes import memory_mesh
from gateway.drakeviewer.messages import Geometry, GeometryType, MessageError
from gateway.scene.geometry import Part, Shape
from gateway.scene.materials import Color, material
from gateway.scene.transforms import from_pose
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


def color_of(geometry: Geometry) -> Color:
    """Return a geometry's colour, sRGB and alpha, clipped to 0 .. 1; 0 for NaN."""
    r, g, b, alpha = (min(max(value, 0.0), 1.0) if value == value else 0.0 for value in geometry.color)
    return r, g, b, alpha


def transform_of(geometry: Geometry) -> NDArray[np.float64]:
    """Return X_link_geometry, (4, 4) float64."""
    return from_pose(geometry.position, geometry.quaternion)


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
    return Part(shape, material(color_of(geometry)), transform_of(geometry), kind)


def _mesh_file(geometry: Geometry, files: MeshFiles, warnings: list[str]) -> tuple[Part, ...]:
    """Load a mesh file, or a mesh in JSON. The geometry's colour is for meshes without materials, as in Drake."""
    scale = _scale_of(geometry.floats.tolist())
    if geometry.text.startswith("{"):
        loaded = memory_mesh(geometry.text, scale, files, warnings)
    else:
        loaded = files.load(geometry.text, scale, warnings)
    X_link_geometry = transform_of(geometry)
    own_material = material(color_of(geometry))
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
