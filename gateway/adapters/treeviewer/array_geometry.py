"""Make parts of lines, meshes, point clouds and lidars. "Drawable" means finite and within ``MAX_DISTANCE``."""

from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.treeviewer.context import ReadContext, scale_colors
from gateway.adapters.treeviewer.fields import is_unicode
from gateway.adapters.treeviewer.number_arrays import ArrayError, PackedArray
from gateway.scene.draw.crease_normals import smooth_mesh
from gateway.scene.tree.geometry import Line, Part, PointCloud, Surface
from gateway.scene.tree.materials import POINT_SIZE, Color, material
from renderers.color import linear_colors_from_srgb
from renderers.drawlist import Mesh
from scenegate.messages.field_kinds import MAX_CHANNEL_COLUMNS, MAX_DISTANCE, CommandError, show

MAX_DISTANCE_F32: Final = np.float32(MAX_DISTANCE)
_COLUMNS: Final = {"rgb": (3, 4), "intensity": (1,)}
"""Possible numbers of values per point of the channels that the protocol defines."""
_ANY_COLUMNS: Final = tuple(range(1, MAX_CHANNEL_COLUMNS + 1))
"""Possible numbers of values per point of all other channels."""


def line(
    rgba: Color,
    context: ReadContext,
    *,
    points: NDArray[np.float32],
    radius: float | None,
    line_width: float | None,
    closed: bool,
    start_head: bool,
    end_head: bool,
    head_radius: float,
    head_length: float | None,
) -> tuple[Part, ...]:
    """Return a polyline through drawable points, or nothing. Without ``radius``, ``line_width`` makes a hairline."""
    drawable_points, drawable = _drop_undrawable(points)
    if drawable is not None:
        count = len(points) - len(drawable_points)
        context.warnings.append(
            f"{count} of {len(points)} points are NaN, infinite or too far; the line joins the others"
        )
    if len(drawable_points) < 2:
        return ()
    if radius is None:
        radius = 0.01 if line_width is None else 0.0
    head_length = head_radius if head_length is None else head_length
    shape = Line(drawable_points, radius, closed, start_head, end_head, head_radius, head_length)
    return (Part(shape, material(rgba, POINT_SIZE, line_width or 1.0)),)


def mesh_data(rgba: Color, context: ReadContext, *, vertices: NDArray[np.float32], faces: Any) -> tuple[Part, ...]:
    """Return a triangle mesh; nothing if no face is left. Faces with an undrawable vertex are left out."""
    triangle_indices = drawable_triangles(vertices, faces, context)
    if not len(triangle_indices):
        return ()
    return (Part(Surface(Mesh(*smooth_mesh(vertices, triangle_indices))), material(rgba)),)


def drawable_triangles(vertices: NDArray[np.float32], faces: Any, context: ReadContext) -> NDArray[np.uint32]:
    """Return those of ``faces``, (M, 3), whose ``vertices``, (N, 3), are drawable; set the other vertices to 0."""
    try:
        indices = context.arrays.indices(faces, len(vertices), context.limits.faces)
    except ArrayError as error:
        raise CommandError(f"faces {error}") from None
    drawable = _drawable_rows(vertices)
    if drawable is not None:
        indices = np.ascontiguousarray(indices[drawable[indices].all(axis=1)])
        vertices[~drawable] = 0.0
        context.warnings.append(f"{int((~drawable).sum())} vertices are not finite; their faces are not drawn")
    return indices


def pointcloud(
    rgba: Color, context: ReadContext, *, points: NDArray[np.float32], channels: Any, point_size: float | None
) -> tuple[Part, ...]:
    """Return the drawable points with their channels."""
    drawable_points, drawable = _drop_undrawable(points)
    arrays = _channel_arrays(channels, len(points), context)
    if drawable is not None:
        arrays = {name: np.ascontiguousarray(values[drawable]) for name, values in arrays.items()}
    if "rgb" in arrays or "intensity" in arrays:  # the material multiplies their colours: only its alpha is kept
        rgba = (1.0, 1.0, 1.0, rgba[3])
    return (Part(PointCloud(drawable_points, MappingProxyType(arrays)), material(rgba, point_size or POINT_SIZE)),)


def planar_lidar(
    rgba: Color,
    context: ReadContext,
    *,
    ranges: NDArray[np.float32],
    angle_start: float,
    angle_step: float,
    **cloud_fields: Any,
) -> tuple[Part, ...]:
    """Return the points of a scan in the plane z = 0. Range i is at the angle ``angle_start + i * angle_step`` to x."""
    distances = ranges.astype(np.float64)
    angles = angle_start + angle_step * np.arange(len(distances))
    points = np.zeros((len(distances), 3), np.float32)
    with np.errstate(invalid="ignore", over="ignore"):
        points[:, 0] = distances * np.cos(angles)
        points[:, 1] = distances * np.sin(angles)
    return pointcloud(rgba, context, points=points, **cloud_fields)


def _channel_arrays(value: Any, count: int, context: ReadContext) -> dict[str, NDArray[np.float32]]:
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
        is_empty = not isinstance(values, PackedArray) and values in (None, [], {})
        if is_empty:
            continue
        if not isinstance(name, str) or not is_unicode(name):
            context.warnings.append(f"channel {show(name)} has no text as its name; it is ignored")
            continue
        try:
            array = context.arrays.floats(values, _COLUMNS.get(name, _ANY_COLUMNS), context.limits.points)
        except ArrayError as error:
            context.warnings.append(f"channel {show(name)} {error}; it is ignored")
            continue
        if len(array) != count:
            context.warnings.append(f"channel {show(name)} has {len(array)} values for {count} points; it is ignored")
            continue
        if name in ("rgb", "intensity"):
            scale_colors(array, values, f"channel {show(name)}", context.warnings)
        channels[name] = array
    return channels


def vertex_colors(srgb: NDArray[np.float32] | None, count: int) -> NDArray[np.float32] | None:
    """Return sRGB colours of ``count`` vertices, (N, 3) or (N, 4), as linear RGBA, (count, 4); None for None."""
    if srgb is None:
        return None
    check_row_count("colors", srgb, count)
    colors = np.ones((count, 4), np.float32)
    colors[:, : srgb.shape[1]] = linear_colors_from_srgb(srgb)
    return colors


def check_row_count(name: str, rows: NDArray[np.float32], count: int) -> None:
    """Raise CommandError if a field does not have one row for each of ``count`` vertices."""
    if len(rows) != count:
        raise CommandError(f"{name} has {len(rows)} rows for {count} vertices")


def _drop_undrawable(points: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_] | None]:
    """Return the drawable points, and ``_drawable_rows(points)``."""
    drawable = _drawable_rows(points)
    return (points, None) if drawable is None else (np.ascontiguousarray(points[drawable]), drawable)


def _drawable_rows(points: NDArray[np.float32]) -> NDArray[np.bool_] | None:
    """Return a mask, (N,), that is True for drawable points; None if all points are drawable."""
    if not points.size or (points.max() <= MAX_DISTANCE_F32 and points.min() >= -MAX_DISTANCE_F32):
        return None
    return np.asarray((np.abs(points) <= MAX_DISTANCE_F32).all(axis=1))  # NaN fails both comparisons
