"""Read the geometries of links, and deformable bodies, as parts of the scene."""

import math
from collections.abc import Callable, Iterable
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.drakeviewer.config import Limits
from gateway.adapters.drakeviewer.link_paths import split_name
from gateway.adapters.drakeviewer.meshes import memory_mesh, surface_of
from gateway.adapters.drakeviewer.wire import Geometry, GeometryType, Link, MessageError
from gateway.files.assets.mesh_files import MeshFileError, MeshFiles
from gateway.files.assets.mesh_formats import PLAIN_MATERIAL
from gateway.scene.tree.geometry import Part, Shape
from gateway.scene.tree.materials import material
from gateway.scene.tree.nodes import Path
from gateway.scene.tree.transforms import from_pose
from renderers.drawlist import Material
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere


def read_geometries(
    geometries: Iterable[Geometry], files: MeshFiles, limits: Limits, warnings: list[str]
) -> tuple[Part, ...]:
    """Return the parts of a link's geometries, in its frame. Each that is not shown completely adds a warning."""
    parts: list[Part] = []
    for geometry in geometries:
        try:
            parts += _parts_of(geometry, files, limits, warnings)
        except (MessageError, MeshFileError) as error:
            warnings.append(str(error))
    return tuple(parts)


def read_deformables(link: Link, family: Path, limits: Limits, warnings: list[str]) -> dict[Path, tuple[Part, ...]]:
    """Return the bodies of a message, its geometries, by path in the live tree; without drawable triangles, no parts.

    A warning is added for each that is not shown completely. Raises MessageError if a name is beyond a limit.
    """
    bodies: dict[Path, tuple[Part, ...]] = {}
    _, link_name = link.key
    parent = (*family, *split_name(link_name, limits))
    for geometry in link.geometries:
        name_bytes = len(geometry.text.encode())
        if name_bytes > limits.name_bytes:  # string_data may be as long as a mesh in JSON
            raise MessageError(
                f"the name of a deformable body has {name_bytes} bytes, the limit is {limits.name_bytes}"
            )
        path = (*parent, *split_name(geometry.text, limits))
        parts_before = bodies.get(path, ())  # of a body with the same name
        try:
            bodies[path] = parts_before + _parts_of_numbers(geometry, limits, warnings)
        except MessageError as error:
            bodies[path] = parts_before
            warnings.append(str(error))
    return bodies


def _parts_of(geometry: Geometry, files: MeshFiles, limits: Limits, warnings: list[str]) -> tuple[Part, ...]:
    if geometry.type == GeometryType.MESH:
        if geometry.text:
            return _parts_of_file(geometry, files, warnings)
        return _parts_of_numbers(geometry, limits, warnings)
    if geometry.type not in _SHAPES:
        raise MessageError(f"geometry type {geometry.type} is unknown")
    kind, size_count, shape_of = _SHAPES[geometry.type]
    sizes = geometry.floats.tolist()
    if len(sizes) != size_count:
        raise MessageError(f"a {kind} has {len(sizes)} numbers instead of {size_count}")
    if not all(0.0 <= size < math.inf for size in sizes):
        raise MessageError(f"a {kind} has the sizes {sizes}: they must be finite and from 0 on")
    return (Part(shape_of(sizes), _material_of(geometry), _pose_of(geometry), kind),)


def _parts_of_numbers(geometry: Geometry, limits: Limits, warnings: list[str]) -> tuple[Part, ...]:
    """Return the mesh that a geometry's ``floats`` are; nothing without drawable triangles."""
    X_link_geometry = _pose_of(geometry)
    surface = surface_of(geometry.floats, limits, warnings)
    return () if surface is None else (Part(surface, _material_of(geometry), X_link_geometry, "mesh_data"),)


def _parts_of_file(geometry: Geometry, files: MeshFiles, warnings: list[str]) -> tuple[Part, ...]:
    """Return the parts of a mesh file, or of one in JSON. Those without materials get the colour, as in Drake."""
    X_link_geometry = _pose_of(geometry)
    scale = _scale_of(geometry.floats.tolist())
    if geometry.text.startswith("{"):
        parts = memory_mesh(geometry.text, scale, files, warnings)
    else:
        parts = files.load(geometry.text, scale, warnings)
    default_material = _material_of(geometry)
    return tuple(
        msgspec.structs.replace(
            part,
            material=default_material if part.material is PLAIN_MATERIAL else part.material,
            X_node_part=X_link_geometry @ part.X_node_part,
        )
        for part in parts
    )


def _material_of(geometry: Geometry) -> Material:
    """Return the material of a geometry's colour, sRGB and alpha, clipped to 0 .. 1; 0 for NaN."""
    r, g, b, alpha = (0.0 if math.isnan(value) else min(max(value, 0.0), 1.0) for value in geometry.color)
    return material((r, g, b, alpha))


def _pose_of(geometry: Geometry) -> NDArray[np.float64]:
    """Return X_link_geometry. Raises MessageError if it is not finite."""
    if not all(map(math.isfinite, (*geometry.position, *geometry.quaternion))):
        raise MessageError("the pose of a geometry is not finite")
    return from_pose(geometry.position, geometry.quaternion)


def _scale_of(floats: list[float]) -> tuple[float, float, float]:
    """Return the scale of a mesh file along x, y, z. Drake sends three numbers; one holds for all, none means 1."""
    if not all(map(math.isfinite, floats)):
        raise MessageError("the scale of a mesh file is not finite")
    match floats:
        case []:
            return 1.0, 1.0, 1.0
        case [scale]:
            return scale, scale, scale
        case [x, y, z]:
            return x, y, z
    raise MessageError(f"a mesh file has {len(floats)} scale numbers instead of 0, 1 or 3")


_SHAPES: Final[dict[int, tuple[str, int, Callable[[list[float]], Shape]]]] = {
    GeometryType.BOX: ("box", 3, lambda sizes: Box((sizes[0], sizes[1], sizes[2]))),
    GeometryType.SPHERE: ("sphere", 1, lambda sizes: Sphere(sizes[0])),
    GeometryType.CYLINDER: ("cylinder", 2, lambda sizes: Cylinder(sizes[0], sizes[1])),
    GeometryType.CAPSULE: ("capsule", 2, lambda sizes: Capsule(sizes[0], sizes[1])),
    GeometryType.ELLIPSOID: ("ellipsoid", 3, lambda sizes: Ellipsoid((sizes[0], sizes[1], sizes[2]))),
}
"""Name, number of ``float_data`` and constructor of each shape."""
