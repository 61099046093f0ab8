"""Read the geometries of setgeometry commands as parts of the scene. ``request_reader`` calls ``read_parts``.

The classes of ``scenegate.messages`` define types and fields. A solid is a shape of the scene as it is; functions of
``array_geometry``, ``image_geometry`` and ``mesh_file_geometry`` make parts of the others.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec

from gateway.adapters.treeviewer import array_geometry, fields, image_geometry, mesh_file_geometry
from gateway.adapters.treeviewer.context import ReadContext
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.materials import WHITE, material
from gateway.scene.tree.transforms import IDENTITY, translation
from scenegate.messages import geometry as messages
from scenegate.messages import image_geometry as image_messages
from scenegate.messages.field_kinds import CommandError, NothingToDraw, read_color, show
from scenegate.messages.geometry import Geometry, Solid, fields_of, read_fields
from scenegate.messages.mesh_file import MeshFile


def read_parts(command: Mapping[str, Any], context: ReadContext) -> tuple[Part, ...]:
    """Return the parts of a command. ``geometry`` overrides ``geometries``, as in Director. Raises CommandError."""
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
    """Return the parts of one geometry; none if nothing can be drawn. ``name`` stands for it in error texts."""
    if not isinstance(params, dict):
        raise CommandError(f"{name} must be an object, not {show(params)}")
    kind = params.get("type")
    if not isinstance(kind, str) or kind not in _TYPES:
        raise CommandError(f"{name}.type is missing" if kind is None else f"{name}.type {show(kind)} is not supported")
    geometry, make_parts = _TYPES[kind]
    fields.check_names(params, _NAMES[kind], name, context.warnings)
    context.origin = (0.0, 0.0, 0.0)
    try:
        color = params.get("color")
        rgba = WHITE if color is None else read_color(color, "color", context)
        X_node_geometry = fields.local_transform(params, context.warnings)
        values = read_fields(geometry, params, context)
        if make_parts is None:
            solid: Any = geometry(**values)
            return (Part(solid, material(rgba), X_node_geometry, kind),)
        parts = make_parts(rgba, context, **values)
    except NothingToDraw as nothing:
        context.warnings.append(f"{name}: {nothing}")
        return ()
    except CommandError as error:
        raise CommandError(f"{name}.{error}") from None
    if any(context.origin):
        X_node_geometry = X_node_geometry @ translation(*context.origin)
    is_identity = X_node_geometry is IDENTITY
    return tuple(
        msgspec.structs.replace(
            part, kind=kind, X_node_part=part.X_node_part if is_identity else X_node_geometry @ part.X_node_part
        )
        for part in parts
    )


_TYPES: Final[Mapping[str, tuple[type[Geometry], Callable[..., tuple[Part, ...]] | None]]] = {
    **{solid.kind: (solid, None) for solid in Solid.__subclasses__()},
    "line": (messages.Line, array_geometry.line),
    "mesh_data": (messages.PlainMesh, array_geometry.mesh_data),
    "mesh": (messages.MeshGeometry, image_geometry.mesh),
    "pointcloud": (messages.PointCloud, array_geometry.pointcloud),
    "planar_lidar": (messages.PlanarLidar, array_geometry.planar_lidar),
    "mesh_file": (MeshFile, mesh_file_geometry.mesh_file),
    "image": (image_messages.ImagePlane, image_geometry.image),
    "heightmap": (image_messages.Heightmap, image_geometry.heightmap),
    "text": (image_messages.Text, image_geometry.text),
    "camera_frustum": (image_messages.CameraFrustum, image_geometry.camera_frustum),
}
"""Class of each type and, unless it is a solid, the function that returns its parts in the geometry's frame.

The function's arguments are the colour, the context, and the class's fields by name.
"""
_NAMES: Final = {
    kind: frozenset(("type", "color", "transform", *(field.name for field in fields_of(geometry))))
    for kind, (geometry, _) in _TYPES.items()
}
"""Names of the fields of each type."""
