"""Read the geometries of setgeometry commands as parts of the scene. ``request_reader`` calls ``read_parts``.

Director has eleven types of geometry. Shapes that consist of arrays are read by ``array_geometry``. The other types are
additions of Scenegate, read by ``image_geometry``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.scene.geometry import Box, Capsule, Cylinder, Ellipsoid, Part, PointCloud, Shape, Sphere, Triad
from gateway.scene.materials import POINT_SIZE, Color, material
from gateway.scene.transforms import IDENTITY
from gateway.treeviewer import array_geometry, fields, image_geometry, mesh_file_geometry
from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.fields import CommandError, NothingToDraw, show

MIN_TRIAD_SCALE: Final = 1e-6
"""Minimum length of a triad's axes, in metres."""

Params = Mapping[str, Any]
"""Fields of a decoded JSON object."""


def read_parts(command: Params, context: ReadContext) -> tuple[Part, ...]:
    """Return the parts of a setgeometry command. ``geometry`` overrides ``geometries``, as in Director.

    Raises:
        CommandError: a field is missing or invalid.
    """
    single = command.get("geometry")
    if single is not None:
        return read_geometry(single, context, "geometry")
    several = command.get("geometries")
    if several is None:
        raise CommandError("geometries is missing")
    if isinstance(several, dict):
        several = [several] if several else []
    if not isinstance(several, list):
        raise CommandError(f"geometries must be a list, not {show(several)}")
    if len(several) > context.limits.parts_per_path:
        raise CommandError(f"geometries has {len(several)} entries, the limit is {context.limits.parts_per_path}")
    parts: list[Part] = []
    for index, geometry in enumerate(several):
        parts.extend(read_geometry(geometry, context, f"geometries[{index}]" if len(several) > 1 else "geometry"))
    return tuple(parts)


def read_geometry(params: Any, context: ReadContext, name: str = "geometry") -> tuple[Part, ...]:
    """Return the parts of one geometry: several for a mesh file, none if nothing can be drawn, otherwise one.

    Args:
        params: the geometry as decoded.
        context: receives warnings.
        name: name of the geometry in the command, for error texts.
    """
    if not isinstance(params, dict):
        raise CommandError(f"{name} must be an object, not {show(params)}")
    kind = params.get("type")
    if not isinstance(kind, str) or (kind not in _SHAPES and kind not in _PARTS):
        raise CommandError(f"{name}.type is missing" if kind is None else f"{name}.type {show(kind)} is not supported")
    try:
        rgba = fields.color(params, context.warnings)
        X_node_geometry = fields.local_transform(params)
        if kind in _PARTS:
            return _placed(_PARTS[kind](params, rgba, context), kind, X_node_geometry)
        shape = _SHAPES[kind](params, context)
        sizes = _sizes(kind, params)
    except NothingToDraw as nothing:
        context.warnings.append(f"{name}: {nothing}")
        return ()
    except CommandError as error:
        raise CommandError(f"{name}.{error}") from None
    if shape is None:
        return ()
    if isinstance(shape, PointCloud) and ("rgb" in shape.channels or "intensity" in shape.channels):
        rgba = (1.0, 1.0, 1.0, rgba[3])
    return (Part(shape, material(rgba, *sizes), X_node_geometry, kind),)


def _placed(parts: tuple[Part, ...], kind: str, X_node_geometry: NDArray[np.float64]) -> tuple[Part, ...]:
    """Return parts in the frame of a geometry as parts of its path."""
    is_identity = X_node_geometry is IDENTITY
    return tuple(
        msgspec.structs.replace(
            part, kind=kind, X_node_part=part.X_node_part if is_identity else X_node_geometry @ part.X_node_part
        )
        for part in parts
    )


def _sizes(kind: str, params: Params) -> tuple[float, ...]:
    """Return the arguments ``point_size`` and ``line_width`` of ``material``; none for other types than these two."""
    if kind in ("pointcloud", "planar_lidar"):
        return (fields.pixels(params, "point_size", POINT_SIZE),) if "point_size" in params else ()
    return (POINT_SIZE, fields.pixels(params, "line_width", 1.0)) if kind == "line" and "line_width" in params else ()


def _box(params: Params, context: ReadContext) -> Shape:
    return Box(fields.lengths_xyz(params, "lengths", context.warnings))


def _sphere(params: Params, context: ReadContext) -> Shape:
    return Sphere(fields.radius(params, context.warnings))


def _ellipsoid(params: Params, context: ReadContext) -> Shape:
    return Ellipsoid(fields.lengths_xyz(params, "radii", context.warnings))


def _cylinder(params: Params, context: ReadContext) -> Shape:
    return Cylinder(fields.radius(params, context.warnings), fields.length(params, context.warnings))


def _capsule(params: Params, context: ReadContext) -> Shape:
    return Capsule(fields.radius(params, context.warnings), fields.length(params, context.warnings))


def _triad(params: Params, context: ReadContext) -> Shape:
    value = params.get("scale")
    scale = 1.0 if value is None else fields.drawable(fields.number(value, "scale"), "scale")
    if abs(scale) < MIN_TRIAD_SCALE:
        raise NothingToDraw(f"scale is {scale:g}, so nothing is drawn")
    return Triad(scale, bool(params.get("tube")))


_SHAPES: Final[dict[str, Callable[[Params, ReadContext], Shape | None]]] = {
    "box": _box,
    "sphere": _sphere,
    "ellipsoid": _ellipsoid,
    "cylinder": _cylinder,
    "capsule": _capsule,
    "triad": _triad,
    "line": array_geometry.line,
    "mesh_data": array_geometry.mesh_data,
    "pointcloud": array_geometry.pointcloud,
    "planar_lidar": array_geometry.planar_lidar,
}
"""Readers of geometries that become one shape in the command's colour."""

_PARTS: Final[dict[str, Callable[[Params, Color, ReadContext], tuple[Part, ...]]]] = {
    "mesh_file": mesh_file_geometry.mesh_file,
    "mesh": image_geometry.mesh,
    "image": image_geometry.image,
    "heightmap": image_geometry.heightmap,
    "text": image_geometry.text,
    "camera_frustum": image_geometry.camera_frustum,
}
"""Readers of geometries with materials of their own. Kind and transform of the parts are set by ``read_geometry``."""
