"""The protocol's geometry descriptions as parts of the scene: eleven types, their fields, defaults and oddities."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.scene.crease_normals import smooth_mesh
from gateway.scene.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Line,
    Part,
    PointCloud,
    Shape,
    Sphere,
    Surface,
    Triad,
)
from gateway.scene.transforms import IDENTITY
from gateway.treeviewer import fields, json_kernels
from gateway.treeviewer.arrays import ArrayError, PackedArray
from gateway.treeviewer.config import Limits
from gateway.treeviewer.fields import CommandError, NothingToDraw, show
from gateway.treeviewer.number_arrays import Numbers
from renderers.color import linear_from_srgb
from renderers.drawlist import AlphaMode, Material, Mesh

Color = tuple[float, float, float, float]
POINT_SIZE: Final = 2.0
"""Pixels, as Director draws points."""
LEAST_TRIAD_SCALE: Final = 1e-6


class MeshLoader(Protocol):
    """Opens what ``mesh_file`` names (``gateway.assets.mesh_files.MeshFiles``)."""

    def load(self, filename: str, scale: tuple[float, float, float]) -> tuple[Part, ...]:
        """The file's parts. Raises ValueError with a sentence; its ``missing`` is true when there is no such file."""
        ...


@dataclass(slots=True)
class Context:
    """What geometry needs to know besides its own fields."""

    limits: Limits = field(default_factory=Limits)
    numbers: Numbers = field(default_factory=Numbers)
    meshes: MeshLoader | None = None
    warnings: list[str] = field(default_factory=list)
    """Sentences about what was tolerated in the geometry at hand."""
    first: int = 0
    """Index of the first command at hand in the whole request."""


def parts_of(command: Mapping[str, Any], context: Context) -> tuple[Part, ...]:
    """What a setgeometry command puts at its path; ``geometry`` wins over ``geometries`` as in Director.

    Raises:
        CommandError: with the reason.
    """
    single = command.get("geometry")
    if single is not None:
        return part_of(single, context, "geometry")
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
        parts.extend(part_of(geometry, context, f"geometries[{index}]" if len(several) > 1 else "geometry"))
    return tuple(parts)


def part_of(params: Any, context: Context, name: str = "geometry") -> tuple[Part, ...]:
    """One geometry: usually one part, none if there is nothing to draw, several for a file of several meshes."""
    if not isinstance(params, dict):
        raise CommandError(f"{name} must be an object, not {show(params)}")
    kind = params.get("type")
    if not isinstance(kind, str) or (kind not in _MAKERS and kind != "mesh_file"):
        raise CommandError(f"{name}.type is missing" if kind is None else f"{name}.type {show(kind)} is not supported")
    try:
        rgba = fields.color(params, context.warnings)
        X = fields.placement(params)
        if kind == "mesh_file":
            return _mesh_file(params, rgba, X, context)
        shape = _MAKERS[kind](params, context)
    except NothingToDraw as nothing:
        context.warnings.append(f"{name}: {nothing}")
        return ()
    except CommandError as error:
        raise CommandError(f"{name}.{error}") from None
    if shape is None:
        return ()
    if isinstance(shape, PointCloud) and ("rgb" in shape.channels or "intensity" in shape.channels):
        rgba = (1.0, 1.0, 1.0, rgba[3])
    return (Part(shape, material(rgba), X, kind),)


@lru_cache(maxsize=4096)
def material(rgba: Color) -> Material:
    """Director's look: diffuse only, both sides, points of 2 px; the colour is meant as displays show it (sRGB)."""
    r, g, b, a = rgba
    return Material(
        base_color=(linear_from_srgb(r), linear_from_srgb(g), linear_from_srgb(b), a),
        metallic=0.0,
        roughness=1.0,
        alpha_mode=AlphaMode.BLEND if a < 1.0 else AlphaMode.OPAQUE,
        double_sided=True,
        point_size=POINT_SIZE,
    )


def _box(params: Mapping[str, Any], context: Context) -> Shape:
    return Box(fields.triple(params, "lengths", context.warnings))


def _sphere(params: Mapping[str, Any], context: Context) -> Shape:
    return Sphere(fields.radius(params, context.warnings))


def _ellipsoid(params: Mapping[str, Any], context: Context) -> Shape:
    return Ellipsoid(fields.triple(params, "radii", context.warnings))


def _cylinder(params: Mapping[str, Any], context: Context) -> Shape:
    return Cylinder(fields.radius(params, context.warnings), fields.length(params, context.warnings))


def _capsule(params: Mapping[str, Any], context: Context) -> Shape:
    return Capsule(fields.radius(params, context.warnings), fields.length(params, context.warnings))


def _triad(params: Mapping[str, Any], context: Context) -> Shape:
    scale = params.get("scale")
    value = 1.0 if scale is None else fields.drawable(fields.number(scale, "scale"), "scale")
    if abs(value) < LEAST_TRIAD_SCALE:
        raise NothingToDraw(f"scale is {value:g}, so nothing is drawn")
    return Triad(value, bool(params.get("tube")))


def _line(params: Mapping[str, Any], context: Context) -> Shape | None:
    points = _finite(_floats(params, "points", (3,), context.limits.points, context))[0]
    radius = params.get("radius")
    head_radius = fields.size(params, "head_radius", 0.05)
    if len(points) < 2:
        return None
    return Line(
        points,
        0.01 if radius is None else fields.drawable(fields.number(radius, "radius"), "radius"),
        bool(params.get("closed")),
        bool(params.get("start_head")),
        bool(params.get("end_head")),
        head_radius,
        fields.size(params, "head_length", head_radius),
    )


def _mesh_data(params: Mapping[str, Any], context: Context) -> Shape | None:
    vertices = _floats(params, "vertices", (3,), context.limits.vertices, context)
    if params.get("faces") is None:
        raise CommandError("faces is missing")
    try:
        faces = context.numbers.indices(params["faces"], len(vertices), context.limits.faces)
    except ArrayError as error:
        raise CommandError(f"faces {error}") from None
    finite = _drawable_rows(vertices)
    if finite is not None:
        faces = np.ascontiguousarray(faces[finite[faces].all(axis=1)])
        vertices[~finite] = 0.0
        context.warnings.append(f"{int((~finite).sum())} vertices are not finite; their faces are not drawn")
    if not len(faces):
        return None
    positions, elements, normals = smooth_mesh(vertices, faces)
    return Surface(Mesh(positions, elements, normals))


FARTHEST_F32: Final = np.float32(fields.FARTHEST)


def _pointcloud(params: Mapping[str, Any], context: Context) -> Shape:
    points = _floats(params, "points", (3,), context.limits.points, context)
    return _cloud(points, params, context)


def _planar_lidar(params: Mapping[str, Any], context: Context) -> Shape:
    """Angles are start + i * step, computed so that no rounding adds or loses one (Director's arange does)."""
    ranges = _floats(params, "ranges", (1,), context.limits.points, context).astype(np.float64)
    angles = []
    for name in ("angle_start", "angle_step"):
        if params.get(name) is None:
            raise CommandError(f"{name} is missing")
        angles.append(fields.drawable(fields.number(params[name], name), name))
    at = angles[0] + angles[1] * np.arange(len(ranges))
    points = np.zeros((len(ranges), 3), np.float32)
    with np.errstate(invalid="ignore", over="ignore"):
        points[:, 0] = ranges * np.cos(at)
        points[:, 1] = ranges * np.sin(at)
    return _cloud(points, params, context)


def _cloud(points: NDArray[np.float32], params: Mapping[str, Any], context: Context) -> PointCloud:
    kept, finite = _finite(points)
    channels = _channels(params.get("channels"), len(points), context)
    if finite is not None:
        channels = {name: np.ascontiguousarray(values[finite]) for name, values in channels.items()}
    return PointCloud(kept, MappingProxyType(channels))


def _channels(value: Any, count: int, context: Context) -> dict[str, NDArray[np.float32]]:
    """The channels of ``count`` points; one that does not fit is left out (a C++ client sends ``"rgb": []``)."""
    if not isinstance(value, dict):
        if value not in (None, []):
            context.warnings.append(f"channels is not an object but {show(value)}; it is ignored")
        return {}
    if len(value) > context.limits.channels:
        raise CommandError(f"channels has {len(value)} entries, the limit is {context.limits.channels}")
    channels: dict[str, NDArray[np.float32]] = {}
    for name, values in value.items():
        if values is None or (not isinstance(values, PackedArray) and values in ([], {})):
            continue
        if not isinstance(name, str):
            context.warnings.append(f"channel {show(name)} has no text as its name; it is ignored")
            continue
        columns = (3, 4) if name == "rgb" else (1,) if name == "intensity" else tuple(range(1, 17))
        try:
            array = context.numbers.floats(values, columns, context.limits.points)
        except ArrayError as error:
            context.warnings.append(f"channel {show(name)} {error}; it is ignored")
            continue
        if len(array) != count:
            context.warnings.append(f"channel {show(name)} has {len(array)} values for {count} points; it is ignored")
            continue
        if name in ("rgb", "intensity"):
            if isinstance(values, PackedArray) and values.of_bytes:
                array /= np.float32(255.0)
            json_kernels.to_unit_interval(array.reshape(-1))
        channels[name] = array
    return channels


def _mesh_file(params: Mapping[str, Any], rgba: Color, X: NDArray[np.float64], context: Context) -> tuple[Part, ...]:
    filename = params.get("filename")
    if not isinstance(filename, str):
        raise CommandError(
            "filename is missing" if filename is None else f"filename must be a string, not {show(filename)}"
        )
    if context.meshes is None:
        raise CommandError("filename: no folder of mesh files is open to clients")
    given = params.get("scale")
    if given is None:
        scale = (1.0, 1.0, 1.0)
    elif isinstance(given, list) and len(given) == 3:
        x, y, z = (fields.drawable(v, "scale") for v in fields.numbers(given, "scale", 3))
        scale = (x, y, z)
    else:
        single = given[0] if isinstance(given, list) and len(given) == 1 else given
        if not isinstance(single, (int, float)):
            raise CommandError(f"scale must be a number or three, not {show(given)}")
        value = fields.drawable(fields.number(single, "scale"), "scale")
        scale = (value, value, value)
    try:
        parts = context.meshes.load(filename, scale)
    except (ValueError, OSError) as error:
        if getattr(error, "missing", isinstance(error, FileNotFoundError)):
            raise NothingToDraw(f"{error}, so nothing is drawn") from None
        raise CommandError(f"filename: {error}") from None
    return tuple(
        msgspec.structs.replace(
            part,
            material=_tinted(part.material, rgba),
            X_node_part=part.X_node_part if X is IDENTITY else X @ part.X_node_part,
            kind="mesh_file",
            source=part.source or filename,
        )
        for part in parts
    )


def _tinted(given: Material, rgba: Color) -> Material:
    """The file's material times the command's colour: white leaves it, and a file without one gets the colour."""
    if rgba == (1.0, 1.0, 1.0, 1.0):
        return given
    r, g, b, a = rgba
    base = given.base_color
    alpha = base[3] * a
    return replace(
        given,
        base_color=(base[0] * linear_from_srgb(r), base[1] * linear_from_srgb(g), base[2] * linear_from_srgb(b), alpha),
        alpha_mode=AlphaMode.BLEND if a < 1.0 and given.alpha_mode is AlphaMode.OPAQUE else given.alpha_mode,
    )


def _floats(
    params: Mapping[str, Any], name: str, columns: tuple[int, ...], most: int, context: Context
) -> NDArray[np.float32]:
    value = params.get(name)
    if value is None:
        raise CommandError(f"{name} is missing")
    try:
        return context.numbers.floats(value, columns, most)
    except ArrayError as error:
        raise CommandError(f"{name} {error}") from None


def _finite(points: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_] | None]:
    """The points that can be drawn, and which they are; None when all are."""
    finite = _drawable_rows(points)
    return (points, None) if finite is None else (np.ascontiguousarray(points[finite]), finite)


def _drawable_rows(points: NDArray[np.float32]) -> NDArray[np.bool_] | None:
    """(N,) which points can be drawn; None: all of them, which is quick to see."""
    if json_kernels.all_within(points.reshape(-1), FARTHEST_F32):
        return None
    return np.asarray((np.abs(points) <= FARTHEST_F32).all(axis=1))


_MAKERS: Final[dict[str, Callable[[Mapping[str, Any], Context], Shape | None]]] = {
    "box": _box,
    "sphere": _sphere,
    "ellipsoid": _ellipsoid,
    "cylinder": _cylinder,
    "capsule": _capsule,
    "triad": _triad,
    "line": _line,
    "mesh_data": _mesh_data,
    "pointcloud": _pointcloud,
    "planar_lidar": _planar_lidar,
}
