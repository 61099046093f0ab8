"""Converts shapes to meshes. Boxes, spheres and cylinders share unit meshes, which the instance's transform scales."""

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.weak_memo import cached_by_weak_key
from gateway.scene.tree.geometry import Line, PointCloud, Shape, Surface
from gateway.scene.tree.transforms import IDENTITY, Matrix, scaling, translation
from renderers import primitives
from renderers.color import linear_colors_from_srgb
from renderers.drawlist import Light, Material, Mesh
from renderers.tubes import clean_polyline, tube
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere, Triad

TRIAD_TUBE_RADIUS: Final = 0.002
"""Radius of the tubes of a triad of any scale, metres; the same as in Director."""
MAX_CAPSULE_ASPECT: Final = 1e6
"""Maximum ratio of a capsule's length to its radius. The ends of a longer capsule are below float32's resolution."""
MIN_THICKNESS_RATIO: Final = 1e-6
"""Minimum thickness of a solid, as a fraction of its largest extent. It is invisible, but it keeps the transform of a
flat solid, such as a box of height 0, invertible for normals."""

MAX_CUT: Final = 0.99
"""Maximum part of a line's segment that arrowheads replace."""
MIN_EXTENT: Final = 1e-12
"""Minimum extent of a shape, metres. A smaller one counts as zero, so that squares and ratios stay within float32."""
MAX_EXTENT: Final = 1e15
"""Maximum extent of a shape, metres. A larger one counts as infinite, so that squares stay within float32."""

PlacedMesh = tuple[Mesh, Material, Matrix]
"""(mesh, material, X_part_mesh)."""

_ShapeMesh = tuple[Mesh, bool, Matrix]
"""(mesh, True if its vertex colours replace the material's colour, X_part_mesh)."""


def meshes_of(shape: Shape, material: Material) -> tuple[PlacedMesh, ...]:
    """Return the meshes that draw ``shape``, with their materials and their transforms to the part's frame.

    No value that a client can send raises an error. A shape draws nothing if its extent is zero or one of its numbers
    is not finite. A cylinder or capsule without a positive radius is a hairline, a sphere draws nothing then. The signs
    of lengths, and of the radii of ellipsoids, are ignored, since the mirrored shapes look the same.
    """
    shape_meshes = _shape_meshes(shape)
    if isinstance(shape, Triad) or (isinstance(shape, Line) and (shape.start_head or shape.end_head)):
        material = replace(material, casts_shadow=False)  # arrows and axes are drawn into the scene: they are not in it
    white = material
    if any(has_own_colors for _, has_own_colors, _ in shape_meshes):  # the renderer multiplies both colours
        white = replace(material, base_color=(1.0, 1.0, 1.0, material.base_color[3]))
    return tuple(
        (mesh, white if has_own_colors else material, X_part_mesh) for mesh, has_own_colors, X_part_mesh in shape_meshes
    )


def _shape_meshes(shape: Shape) -> tuple[_ShapeMesh, ...]:
    match shape:
        case Surface(mesh):
            return ((mesh, False, IDENTITY),)
        case Box(lengths):
            return _scaled_unit_mesh(primitives.box(), lengths)
        case Sphere(radius):
            return _scaled_unit_mesh(primitives.sphere(), (radius, radius, radius)) if radius > 0.0 else ()
        case Ellipsoid(radii):
            return _scaled_unit_mesh(primitives.sphere(), radii)
        case Cylinder(radius, length):
            return _cylinder_meshes(radius, abs(length))
        case Capsule(radius, length):
            return _capsule_meshes(radius, abs(length))
        case Triad(scale, with_tubes):
            return _triad_meshes(scale, with_tubes)
        case PointCloud():
            return _cloud_meshes(shape)
        case Line():
            return _line_meshes(shape)
        case Light():
            return ()
    raise TypeError(f"{type(shape).__name__} has no meshes")


def _scaled_unit_mesh(mesh: Mesh, scale: Iterable[float]) -> tuple[_ShapeMesh, ...]:
    """Return a unit mesh with a scale along x, y, z; nothing if the scale is zero, too large or not finite."""
    x, y, z = (abs(float(value)) for value in scale)
    longest = max(x, y, z)
    if not _is_drawable(longest) or math.isnan(x + y + z):
        return ()
    thickness = MIN_THICKNESS_RATIO * longest
    return ((mesh, False, scaling(max(x, thickness), max(y, thickness), max(z, thickness))),)


def _is_drawable(extent: float) -> bool:
    return MIN_EXTENT <= extent <= MAX_EXTENT


def _cylinder_meshes(radius: float, length: float) -> tuple[_ShapeMesh, ...]:
    if not (_is_drawable(length) and radius <= MAX_EXTENT):
        return ()
    if radius < MIN_EXTENT:
        return ((_unit_segment(), False, scaling(length, length, length)),)
    return _scaled_unit_mesh(primitives.cylinder(), (radius, radius, length))


def _capsule_meshes(radius: float, length: float) -> tuple[_ShapeMesh, ...]:
    is_finite = _is_drawable(radius) and length <= MAX_EXTENT  # False for NaN, too
    if not is_finite or length > MAX_CAPSULE_ASPECT * radius:
        return _cylinder_meshes(radius, length)  # nothing, or one whose missing ends cannot be seen
    aspect = length / radius
    mesh = primitives.capsule(aspect) if aspect > 1.0 / MAX_CAPSULE_ASPECT else primitives.sphere()
    return _scaled_unit_mesh(mesh, (radius, radius, radius))


@lru_cache(maxsize=1)
def _unit_segment() -> Mesh:
    """Return a hairline of length 1 along z, centred on the origin."""
    return _hairlines(np.array(((0.0, 0.0, -0.5), (0.0, 0.0, 0.5))), closed=False)


def _hairlines(points: NDArray[np.float64], *, closed: bool) -> Mesh:
    """Return hairlines from each point to the next, and from the last point to the first one if ``closed``."""
    index = np.arange(len(points), dtype=np.uint32)
    elements = np.stack((index, np.roll(index, -1)), axis=1)
    elements = elements if closed and len(points) > 2 else elements[:-1]
    return Mesh(np.ascontiguousarray(points, dtype=np.float32), np.ascontiguousarray(elements))


_AXIS_COLORS: Final = ((1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0))
"""RGBA of the x, y and z axis of a triad."""


def _triad_meshes(scale: float, with_tubes: bool) -> tuple[_ShapeMesh, ...]:
    if not _is_drawable(abs(scale)):
        return ()
    hairlines = (_triad_lines(), True, scaling(scale, scale, scale))
    # Tubes as thin as Director's are invisible from a distance; the hairlines inside them stay visible.
    return ((_triad_tubes(float(scale)), True, IDENTITY), hairlines) if with_tubes else (hairlines,)


@lru_cache(maxsize=1)
def _triad_lines() -> Mesh:
    positions = np.zeros((6, 3), dtype=np.float32)
    positions[1::2] = np.eye(3)
    colors = np.repeat(np.array(_AXIS_COLORS, dtype=np.float32), 2, axis=0)
    return Mesh(positions, np.arange(6, dtype=np.uint32).reshape(3, 2), colors=colors)


@lru_cache(maxsize=64)
def _triad_tubes(scale: float) -> Mesh:
    """Return a triad's tubes as one mesh with vertex colours. Clients choose the scale, so the cache is bounded."""
    positions, elements, normals, colors = [], [], [], []
    vertex_count = 0
    for axis, color in zip(np.eye(3), _AXIS_COLORS, strict=True):
        mesh = tube(np.stack((np.zeros(3), axis * scale)), TRIAD_TUBE_RADIUS)
        assert mesh is not None
        assert mesh.normals is not None
        positions.append(mesh.positions)
        elements.append(mesh.elements + np.uint32(vertex_count))
        normals.append(mesh.normals)
        colors.append(np.tile(np.array(color, dtype=np.float32), (len(mesh.positions), 1)))
        vertex_count += len(mesh.positions)
    return Mesh(
        np.concatenate(positions), np.concatenate(elements), np.concatenate(normals), colors=np.concatenate(colors)
    )


@cached_by_weak_key
def _cloud_meshes(cloud: PointCloud) -> tuple[_ShapeMesh, ...]:
    """Return a mesh of those points that are finite, with the colours of ``_cloud_colors``."""
    points, colors = np.ascontiguousarray(cloud.points, dtype=np.float32), _cloud_colors(cloud)
    if not (points.min(initial=0.0) > -MAX_EXTENT and points.max(initial=0.0) < MAX_EXTENT):  # false for NaN, too
        finite = (np.abs(points) < MAX_EXTENT).all(axis=1)
        points, colors = points[finite], None if colors is None else colors[finite]
    if not len(points):
        return ()
    elements = np.arange(len(points), dtype=np.uint32)[:, None]
    return ((Mesh(points, elements, colors=colors), colors is not None, IDENTITY),)


def _cloud_colors(cloud: PointCloud) -> NDArray[np.float32] | None:
    """Return the linear colours of all points, (N, 4) float32, from ``rgb``, or else in grey from ``intensity``.

    Channels are sRGB, 0 to 1. Those of the wrong shape are ignored: some clients send empty ones. None if none is left.
    """
    count = len(cloud.points)
    rgb = cloud.channels.get("rgb")
    if rgb is not None and rgb.ndim == 2 and len(rgb) == count and rgb.shape[1] in (3, 4):
        values = rgb
    else:
        intensity = cloud.channels.get("intensity")
        if intensity is None or intensity.size != count or len(intensity) != count:
            return None
        values = np.repeat(intensity.reshape(count, 1), 3, axis=1)
    colors = np.ones((count, 4), dtype=np.float32)
    srgb = np.fmin(np.fmax(values, np.float32(0.0)), np.float32(1.0))  # NaN becomes 0
    colors[:, : values.shape[1]] = linear_colors_from_srgb(srgb)
    return colors


@cached_by_weak_key
def _line_meshes(line: Line) -> tuple[_ShapeMesh, ...]:
    points = clean_polyline(line.points, MAX_EXTENT, closed=line.closed)
    if len(points) < 2:
        return ()
    heads, shaft = _line_heads(line, points)
    radius = float(line.radius)
    mesh = tube(shaft, radius, closed=line.closed) if _is_drawable(radius) else None
    if mesh is None:
        mesh = _hairlines(shaft, closed=line.closed)
    return ((mesh, False, IDENTITY), *heads)


def _line_heads(line: Line, points: NDArray[np.float64]) -> tuple[list[_ShapeMesh], NDArray[np.float64]]:
    """Return the cones at the ends of a line, and the points of the shaft, which is shortened at these ends.

    As in Director, the tip of a cone lies at the end point, its base one head length behind the tip, and the shaft ends
    half a head length before the tip, but at most ``MAX_CUT`` of its segment. A closed line has no end to shorten.
    """
    radius = float(line.head_radius)
    length = radius if line.head_length is None else float(line.head_length)
    has_head = [line.start_head, line.end_head]
    if not (any(has_head) and _is_drawable(radius) and _is_drawable(length)):
        return [], points
    shaft = points.copy()
    heads: list[_ShapeMesh] = []
    is_shared = all(has_head) and len(points) == 2  # both ends shorten the only segment
    max_cut = 0.5 * MAX_CUT if is_shared else MAX_CUT
    for end, neighbour in ((0, 1), (-1, -2)):
        if not has_head[end]:
            continue
        tip, direction = points[end], points[end] - points[neighbour]
        distance = float(np.linalg.norm(direction))
        direction /= distance
        heads.append((primitives.cone(), False, _cone_pose(tip, direction, radius, length)))
        if not line.closed:
            shaft[end] = tip - direction * min(0.5 * length, max_cut * distance)
    return heads, shaft


def _cone_pose(tip: NDArray[np.float64], direction: NDArray[np.float64], radius: float, length: float) -> Matrix:
    """Return the (4, 4) transform of the unit cone (tip at the origin, +z forward) to a tip and a unit direction."""
    least_parallel_axis = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(least_parallel_axis, direction)
    x /= np.linalg.norm(x)
    matrix = translation(*tip.tolist())
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x * radius, np.cross(direction, x) * radius, direction * length
    return matrix
