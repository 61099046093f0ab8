"""Read shapes that consist of arrays: lines, meshes, point clouds and planar lidars. ``geometry`` calls these readers.

"Drawable" means finite and within ``fields.MAX_DISTANCE``.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.crease_normals import smooth_mesh
from gateway.scene.geometry import Line, PointCloud, Shape, Surface
from gateway.treeviewer import fields
from gateway.treeviewer.context import ReadContext
from gateway.treeviewer.fields import CommandError, show
from gateway.treeviewer.packed_arrays import ArrayError, PackedArray
from renderers.color import linear_colors_from_srgb
from renderers.drawlist import Mesh

MAX_DISTANCE_F32: Final = np.float32(fields.MAX_DISTANCE)
MAX_CHANNEL_COLUMNS: Final = 16
"""Maximum number of values per point in one channel."""

Params = Mapping[str, Any]
"""Fields of a decoded geometry."""


def line(params: Params, context: ReadContext) -> Shape | None:
    """Return a polyline through the drawable points; None if there are fewer than two."""
    points, _ = _drop_undrawable(floats(params, "points", (3,), context.limits.points, context))
    radius = params.get("radius")
    default_radius = 0.01 if params.get("line_width") is None else 0.0
    head_radius = fields.size(params, "head_radius", 0.05)
    if len(points) < 2:
        return None
    return Line(
        points,
        default_radius if radius is None else fields.drawable(fields.number(radius, "radius"), "radius"),
        bool(params.get("closed")),
        bool(params.get("start_head")),
        bool(params.get("end_head")),
        head_radius,
        fields.size(params, "head_length", head_radius),
    )


def mesh_data(params: Params, context: ReadContext) -> Shape | None:
    """Return a triangle mesh; None if no face is left. Faces with an undrawable vertex are left out."""
    vertices, faces = triangles(params, context)
    if not len(faces):
        return None
    positions, triangle_indices, normals = smooth_mesh(vertices, faces)
    return Surface(Mesh(positions, triangle_indices, normals))


def triangles(params: Params, context: ReadContext) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return ``vertices``, (N, 3), and those of ``faces``, (M, 3), whose vertices are drawable. Others become 0."""
    vertices = floats(params, "vertices", (3,), context.limits.vertices, context)
    if params.get("faces") is None:
        raise CommandError("faces is missing")
    try:
        faces = context.arrays.indices(params["faces"], len(vertices), context.limits.faces)
    except ArrayError as error:
        raise CommandError(f"faces {error}") from None
    drawable = _drawable_rows(vertices)
    if drawable is not None:
        faces = np.ascontiguousarray(faces[drawable[faces].all(axis=1)])
        vertices[~drawable] = 0.0
        context.warnings.append(f"{int((~drawable).sum())} vertices are not finite; their faces are not drawn")
    return vertices, faces


def pointcloud(params: Params, context: ReadContext) -> Shape:
    """Return the drawable points with their channels."""
    points = floats(params, "points", (3,), context.limits.points, context)
    return _cloud(points, params, context)


def planar_lidar(params: Params, context: ReadContext) -> Shape:
    """Return the points of a scan in the plane z = 0. Range i is at the angle ``angle_start + i * angle_step`` to x."""
    ranges = floats(params, "ranges", (1,), context.limits.points, context).astype(np.float64)
    start, step = fields.required(params, "angle_start"), fields.required(params, "angle_step")
    angles = start + step * np.arange(len(ranges))
    points = np.zeros((len(ranges), 3), np.float32)
    with np.errstate(invalid="ignore", over="ignore"):
        points[:, 0] = ranges * np.cos(angles)
        points[:, 1] = ranges * np.sin(angles)
    return _cloud(points, params, context)


def _cloud(points: NDArray[np.float32], params: Params, context: ReadContext) -> PointCloud:
    """Return the drawable ones of ``points``, with their channels from ``params``."""
    drawable_points, drawable = _drop_undrawable(points)
    channels = _channels(params.get("channels"), len(points), context)
    if drawable is not None:
        channels = {name: np.ascontiguousarray(values[drawable]) for name, values in channels.items()}
    return PointCloud(drawable_points, MappingProxyType(channels))


def _channels(value: Any, count: int, context: ReadContext) -> dict[str, NDArray[np.float32]]:
    """Return the valid channels of ``count`` points, each (count,) or (count, k).

    Invalid channels are ignored with a warning, empty ones without (a C++ client sends ``"rgb": []``).
    """
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
        columns = (3, 4) if name == "rgb" else (1,) if name == "intensity" else tuple(range(1, MAX_CHANNEL_COLUMNS + 1))
        try:
            array = context.arrays.floats(values, columns, context.limits.points)
        except ArrayError as error:
            context.warnings.append(f"channel {show(name)} {error}; it is ignored")
            continue
        if len(array) != count:
            context.warnings.append(f"channel {show(name)} has {len(array)} values for {count} points; it is ignored")
            continue
        if name in ("rgb", "intensity"):
            _scale_colors(array, values)
        channels[name] = array
    return channels


def vertex_colors(params: Params, count: int, context: ReadContext) -> NDArray[np.float32] | None:
    """Return the field ``colors`` of ``count`` vertices as linear RGBA, (count, 4); None if it is absent."""
    if params.get("colors") is None:
        return None
    srgb = per_vertex(params, "colors", (3, 4), count, context)
    _scale_colors(srgb, params["colors"])
    colors = np.ones((count, 4), np.float32)
    colors[:, : srgb.shape[1]] = linear_colors_from_srgb(srgb)
    return colors


def per_vertex(
    params: Params, name: str, columns: tuple[int, ...], count: int, context: ReadContext
) -> NDArray[np.float32]:
    """Return a field with a row for each of ``count`` vertices, as ``floats`` does."""
    values = floats(params, name, columns, context.limits.vertices, context)
    if len(values) != count:
        raise CommandError(f"{name} has {len(values)} rows for {count} vertices")
    return values


def _scale_colors(colors: NDArray[np.float32], field: Any) -> None:
    """Scale the colours read from a field, in place, to 0 to 1. NaN becomes 0."""
    if isinstance(field, PackedArray) and field.is_uint8:
        colors /= np.float32(255.0)
    colors[np.isnan(colors)] = 0.0
    np.clip(colors, 0.0, 1.0, out=colors)


def floats(
    params: Params, name: str, columns: tuple[int, ...], max_rows: int, context: ReadContext
) -> NDArray[np.float32]:
    """Return a required field as ``NumberArrays.floats`` does."""
    value = params.get(name)
    if value is None:
        raise CommandError(f"{name} is missing")
    try:
        return context.arrays.floats(value, columns, max_rows)
    except ArrayError as error:
        raise CommandError(f"{name} {error}") from None


def _drop_undrawable(points: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_] | None]:
    """Return the drawable points, and ``_drawable_rows(points)``."""
    drawable = _drawable_rows(points)
    return (points, None) if drawable is None else (np.ascontiguousarray(points[drawable]), drawable)


def _drawable_rows(points: NDArray[np.float32]) -> NDArray[np.bool_] | None:
    """Return a mask, (N,), that is True for drawable points; None if all points are drawable."""
    if not points.size or (points.max() <= MAX_DISTANCE_F32 and points.min() >= -MAX_DISTANCE_F32):
        return None
    return np.asarray((np.abs(points) <= MAX_DISTANCE_F32).all(axis=1))
