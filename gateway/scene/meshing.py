"""Shapes as meshes: shared unit meshes, scaled by the instance's transform, where possible."""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from functools import lru_cache
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from gateway.scene.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Line,
    PointCloud,
    Shape,
    Sphere,
    Surface,
    Triad,
)
from gateway.scene.transforms import IDENTITY, Matrix, scaling, translation
from renderers import primitives
from renderers.drawlist import Material, Mesh
from renderers.tubes import clean_polyline, tube

TRIAD_TUBE_RADIUS: Final = 0.002
"""Metres, whatever the triad's scale (Director)."""
SLENDER: Final = 1e6
"""Ratio of length to radius above which the ends of a capsule are below float32's resolution."""
POINT_SIZE: Final = 2.0
"""Minimum point size, pixels (Director)."""
THINNEST: Final = 1e-6
"""Thickness of a solid that is flat along an axis (a floor as a box of height 0), as a fraction of its largest extent.
This is invisible, but keeps the transform invertible for normals."""

SMALLEST: Final = 1e-12
LARGEST: Final = 1e15
"""Metres. Smaller extents count as zero and larger ones as infinite, so that their squares and ratios stay within
float32."""

MeshPart = tuple[Mesh, Material, Matrix]
"""(mesh, material, X_part_mesh (4, 4) float64)."""

_Piece = tuple[Mesh, bool, Matrix]
"""(mesh, True if its vertex colours replace the material's colour, X_part_mesh)."""


def meshes_of(shape: Shape, material: Material) -> tuple[MeshPart, ...]:
    """Return the meshes that draw ``shape`` in the part's frame.

    No value that a client can send raises an error. Shapes without extent or with numbers that are not finite draw
    nothing. A cylinder or capsule without radius is a hairline. Negative lengths and radii of boxes and ellipsoids
    count as positive ones, since the mirror images look the same.
    """
    pieces = _pieces(shape)
    if isinstance(shape, PointCloud) and material.point_size < POINT_SIZE:
        material = replace(material, point_size=POINT_SIZE)
    return tuple((mesh, _white(material) if coloured else material, matrix) for mesh, coloured, matrix in pieces)


def _white(material: Material) -> Material:
    """Return the material in white, with its alpha, for meshes with vertex colours."""
    return replace(material, base_color=(1.0, 1.0, 1.0, material.base_color[3]))


def _pieces(shape: Shape) -> tuple[_Piece, ...]:
    match shape:
        case Surface(mesh):
            return ((mesh, False, IDENTITY),)
        case Box(lengths):
            return _scaled(primitives.box(), lengths)
        case Sphere(radius):
            return _scaled(primitives.sphere(), (radius, radius, radius)) if radius > 0.0 else ()
        case Ellipsoid(radii):
            return _scaled(primitives.sphere(), radii)
        case Cylinder(radius, length):
            return _cylinder(radius, abs(length))
        case Capsule(radius, length):
            return _capsule(radius, abs(length))
        case Triad(scale, with_tubes):
            return _triad(scale, with_tubes)
        case PointCloud() | Line():
            return _cached_pieces(shape)


def _scaled(mesh: Mesh, scale: tuple[float, float, float]) -> tuple[_Piece, ...]:
    x, y, z = (abs(float(value)) for value in scale)
    largest = max(x, y, z)
    if not _drawable(largest) or math.isnan(x + y + z):
        return ()
    thinnest = THINNEST * largest
    return ((mesh, False, scaling(max(x, thinnest), max(y, thinnest), max(z, thinnest))),)


def _drawable(extent: float) -> bool:
    return SMALLEST <= extent <= LARGEST


def _cylinder(radius: float, length: float) -> tuple[_Piece, ...]:
    if not (_drawable(length) and radius <= LARGEST):
        return ()
    if radius < SMALLEST:
        return ((_unit_segment(), False, scaling(length, length, length)),)
    return _scaled(primitives.cylinder(), (radius, radius, length))


def _capsule(radius: float, length: float) -> tuple[_Piece, ...]:
    if not (_drawable(radius) and length <= LARGEST) or length > SLENDER * radius:
        return _cylinder(radius, length)
    aspect = length / radius
    mesh = primitives.capsule(aspect) if aspect > 1.0 / SLENDER else primitives.sphere()
    return _scaled(mesh, (radius, radius, radius))


@lru_cache(maxsize=1)
def _unit_segment() -> Mesh:
    """Return a hairline of length 1 along z, around the origin."""
    return _lines(np.array(((0.0, 0.0, -0.5), (0.0, 0.0, 0.5))), closed=False)


def _lines(points: NDArray[np.float64], *, closed: bool) -> Mesh:
    """Return hairlines from each point to the next."""
    index = np.arange(len(points), dtype=np.uint32)
    elements = np.stack((index, np.roll(index, -1)), axis=1)
    elements = elements if closed and len(points) > 2 else elements[:-1]
    return Mesh(np.ascontiguousarray(points, dtype=np.float32), np.ascontiguousarray(elements))


_AXIS_COLORS: Final = ((1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0))


def _triad(scale: float, with_tubes: bool) -> tuple[_Piece, ...]:
    if not _drawable(abs(scale)):
        return ()
    hairlines = (_triad_lines(), True, scaling(scale, scale, scale))
    # Tubes as thin as Director's vanish at a distance; the hairlines inside them stay visible.
    return ((_triad_tubes(float(scale)), True, IDENTITY), hairlines) if with_tubes else (hairlines,)


@lru_cache(maxsize=1)
def _triad_lines() -> Mesh:
    positions = np.zeros((6, 3), dtype=np.float32)
    positions[1::2] = np.eye(3)
    colors = np.repeat(np.array(_AXIS_COLORS, dtype=np.float32), 2, axis=0)
    return Mesh(positions, np.arange(6, dtype=np.uint32).reshape(3, 2), colors=colors)


@lru_cache(maxsize=64)
def _triad_tubes(scale: float) -> Mesh:
    """Return the three tubes as one mesh with vertex colours. The cache is bounded, since clients choose the scale."""
    tubes = [tube(np.stack((np.zeros(3), axis * scale)), TRIAD_TUBE_RADIUS) for axis in np.eye(3)]
    meshes = [mesh for mesh in tubes if mesh is not None]
    positions, normals = ([m.positions for m in meshes], [m.normals for m in meshes if m.normals is not None])
    first = np.cumsum([0] + [len(p) for p in positions[:-1]], dtype=np.uint32)
    colors = [
        np.tile(np.array(color, dtype=np.float32), (len(p), 1))
        for color, p in zip(_AXIS_COLORS, positions, strict=True)
    ]
    return Mesh(
        np.concatenate(positions),
        np.concatenate([m.elements + offset for m, offset in zip(meshes, first, strict=True)]),
        np.concatenate(normals),
        colors=np.concatenate(colors),
    )


_pieces_by_shape: WeakKeyDictionary[PointCloud | Line, tuple[_Piece, ...]] = WeakKeyDictionary()
_pieces_lock = threading.Lock()


def _cached_pieces(shape: PointCloud | Line) -> tuple[_Piece, ...]:
    """Return the pieces of a shape, computed once per object."""
    with _pieces_lock:
        found = _pieces_by_shape.get(shape)
    if found is None:
        found = _point_cloud(shape) if isinstance(shape, PointCloud) else _line(shape)
        with _pieces_lock:
            found = _pieces_by_shape.setdefault(shape, found)
    return found


def _point_cloud(cloud: PointCloud) -> tuple[_Piece, ...]:
    """Return the finite points, coloured by ``rgb``, else by ``intensity`` as grey.

    Channels of the wrong length are ignored: some clients send empty ones.
    """
    finite = (np.abs(cloud.points) < LARGEST).all(axis=1)
    if not finite.any():
        return ()
    colors = _cloud_colors(cloud)
    points = np.ascontiguousarray(cloud.points[finite], dtype=np.float32)
    elements = np.arange(len(points), dtype=np.uint32)[:, None]
    if colors is None:
        return ((Mesh(points, elements), False, IDENTITY),)
    return ((Mesh(points, elements, colors=np.ascontiguousarray(colors[finite])), True, IDENTITY),)


def _cloud_colors(cloud: PointCloud) -> NDArray[np.float32] | None:
    """Return (N, 4) float32 in 0 .. 1; None without a usable channel."""
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
    colors[:, : values.shape[1]] = np.clip(np.nan_to_num(values), 0.0, 1.0)
    return colors


def _line(line: Line) -> tuple[_Piece, ...]:
    points = clean_polyline(line.points, LARGEST, closed=line.closed)
    if len(points) < 2:
        return ()
    heads, shaft = _heads(line, points)
    radius = float(line.radius)
    solid = tube(shaft, radius, closed=line.closed) if _drawable(radius) else None
    body = solid if solid is not None else _lines(shaft, closed=line.closed)
    return ((body, False, IDENTITY), *heads)


def _heads(line: Line, points: NDArray[np.float64]) -> tuple[list[_Piece], NDArray[np.float64]]:
    """Return the cones at the ends, and the points of the shortened shaft.

    As in Director, the tip lies at the end point, the base one head length behind it, and the shaft ends half a head
    length before the tip. A shorter shaft keeps a hundredth of its last segment.
    """
    radius = float(line.head_radius)
    length = radius if line.head_length is None else float(line.head_length)
    wanted = [line.start_head, line.end_head]
    if not (any(wanted) and _drawable(radius) and _drawable(length)):
        return [], points
    shaft = points.copy()
    heads: list[_Piece] = []
    share = 0.495 if all(wanted) and len(points) == 2 else 0.99
    for end, neighbour in ((0, 1), (-1, -2)):
        if not wanted[end]:
            continue
        tip, direction = points[end], points[end] - points[neighbour]
        distance = float(np.linalg.norm(direction))
        direction = direction / distance
        heads.append((primitives.cone(), False, _cone_pose(tip, direction, radius, length)))
        if not line.closed:
            shaft[end] = tip - direction * min(0.5 * length, share * distance)
    return heads, shaft


def _cone_pose(tip: NDArray[np.float64], direction: NDArray[np.float64], radius: float, length: float) -> Matrix:
    """Return the (4, 4) transform of the unit cone to a tip and a unit direction."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(other, direction)
    x /= np.linalg.norm(x)
    matrix = translation(*tip.tolist())
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x * radius, np.cross(direction, x) * radius, direction * length
    return matrix
