"""Unit meshes of box, sphere, capsule, cylinder and cone. Instances share a mesh and scale it by their transform.

Every mesh is closed, wound counter-clockwise seen from outside, and has unit outward normals: smooth on curved faces,
flat on plane ones. Vertices of curved solids lie exactly on the ideal surface, so that their faces lie inside it.
"""

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import Mesh

SEGMENTS: Final = 48
"""Sides of sphere, capsule and cylinder. The silhouette of an inscribed 48-gon is off by r (1 - cos(pi / 48)), 0.2 %
of r: half a pixel for a sphere 470 pixels wide. Director uses 24, which is off by more than 1 % of the volume."""
RINGS: Final = 24
"""Bands of a sphere from pole to pole. With this number, quads at the equator are about square."""
CONE_SEGMENTS: Final = 32
"""Sides of a cone."""

Vertices = NDArray[np.float64]
Triangles = NDArray[np.int64]


def frozen_mesh(positions: Vertices, triangles: Triangles, normals: Vertices) -> Mesh:
    """Return a mesh with read-only arrays."""
    arrays = (
        np.ascontiguousarray(positions, dtype=np.float32),
        np.ascontiguousarray(triangles, dtype=np.uint32),
        np.ascontiguousarray(normals, dtype=np.float32),
    )
    for array in arrays:
        array.flags.writeable = False
    return Mesh(*arrays)


def circle(segments: int) -> Vertices:
    """Return points of the unit circle, (segments, 2) float64, counter-clockwise from +x, exact on the axes."""
    angle = np.arange(segments) * (2.0 * math.pi / segments)
    points = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    points[np.abs(points) < 1e-15] = 0.0
    return points


def band(lower: NDArray[np.integer], upper: NDArray[np.integer]) -> Triangles:
    """Return the triangles between two closed rings of n vertices each, counter-clockwise seen from outside.

    Args:
        lower: (n,) vertex indices, counter-clockwise seen from above; or (S, n) for S pairs of rings.
        upper: vertex indices of the rings above, of the same shape.

    Returns:
        (2 n, 3) or (2 S n, 3) int64.
    """
    next_lower, next_upper = np.roll(lower, -1, axis=-1), np.roll(upper, -1, axis=-1)
    quads = np.stack((lower, next_lower, next_upper, lower, next_upper, upper), axis=-1)
    return quads.reshape(-1, 3).astype(np.int64)


def fan(centre: int, ring: NDArray[np.integer], *, up: bool) -> Triangles:
    """Return the triangles from ``centre`` to a closed ring, (n, 3) int64; ``up``: front faces point along +z."""
    following = np.roll(ring, -1)
    pair = (ring, following) if up else (following, ring)
    return np.stack((np.full(len(ring), centre), *pair), axis=1).astype(np.int64)


@lru_cache(maxsize=1)
def box() -> Mesh:
    """Return a cube of side 1 around the origin: 24 vertices, 12 triangles, flat normals."""
    positions: list[Vertices] = []
    normals: list[Vertices] = []
    triangles: list[tuple[int, ...]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal, u_axis = np.zeros(3), np.zeros(3)
            normal[axis], u_axis[(axis + 1) % 3] = sign, 1.0
            v_axis = np.cross(normal, u_axis)
            first_vertex = len(positions)
            positions.extend(0.5 * (normal + u * u_axis + v * v_axis) for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
            normals.extend([normal] * 4)
            triangles.extend(
                ((first_vertex, first_vertex + 1, first_vertex + 2), (first_vertex, first_vertex + 2, first_vertex + 3))
            )
    return frozen_mesh(np.array(positions), np.array(triangles), np.array(normals))


@lru_cache(maxsize=16)
def sphere(segments: int = SEGMENTS, rings: int = RINGS) -> Mesh:
    """Return the unit sphere, poles on the z axis."""
    positions, triangles = _ball(segments, rings, 0.0)
    return frozen_mesh(positions, triangles, positions)


@lru_cache(maxsize=256)
def capsule(aspect: float) -> Mesh:
    """Return a cylinder of radius 1 and length ``aspect`` along z with a hemisphere at each end (about 60 kB)."""
    positions, triangles = _ball(SEGMENTS, RINGS, 0.5 * aspect)
    normals = positions.copy()
    normals[:, 2] -= np.copysign(0.5 * aspect, positions[:, 2])
    return frozen_mesh(positions, triangles, normals)


def _ball(segments: int, rings: int, half_length: float) -> tuple[Vertices, Triangles]:
    """Return positions and triangles of a unit sphere whose halves are moved apart by ``half_length`` each along z.

    ``rings`` is the number of bands from pole to pole; even if the halves are moved.
    """
    around = circle(segments)
    polar = np.arange(1, rings) * (math.pi / rings)
    if half_length:
        polar = np.insert(polar, rings // 2, 0.5 * math.pi)
    z, r = np.cos(polar), np.sin(polar)
    z[np.abs(z) < 1e-15] = 0.0
    if half_length:
        z[: rings // 2] += half_length
        z[rings // 2 :] -= half_length
    body = np.empty((len(polar), segments, 3))
    body[:, :, :2] = r[:, None, None] * around
    body[:, :, 2] = z[:, None]
    top = 1.0 + half_length
    positions = np.concatenate((body.reshape(-1, 3), [(0.0, 0.0, top), (0.0, 0.0, -top)]))
    index = np.arange(len(polar) * segments).reshape(len(polar), segments)
    north, south = index.size, index.size + 1
    parts = [fan(north, index[0], up=True), fan(south, index[-1], up=False)]
    parts.extend(band(index[i + 1], index[i]) for i in range(len(polar) - 1))
    return positions, np.concatenate(parts)


@lru_cache(maxsize=16)
def cylinder(segments: int = SEGMENTS) -> Mesh:
    """Return a capped cylinder of radius 1 and length 1 along z around the origin."""
    around = circle(segments)
    sides = np.zeros((segments, 3))
    sides[:, :2] = around
    low, high = np.array((0.0, 0.0, -0.5)), np.array((0.0, 0.0, 0.5))
    down, up = np.tile((0.0, 0.0, -1.0), (segments + 1, 1)), np.tile((0.0, 0.0, 1.0), (segments + 1, 1))
    positions = np.concatenate((sides + low, sides + high, sides + low, [low], sides + high, [high]))
    normals = np.concatenate((sides, sides, down, up))
    ring = np.arange(segments)
    bottom, top = 2 * segments, 3 * segments + 1
    triangles = np.concatenate(
        (
            band(ring, ring + segments),
            fan(bottom + segments, ring + bottom, up=False),
            fan(top + segments, ring + top, up=True),
        )
    )
    return frozen_mesh(positions, triangles, normals)


@lru_cache(maxsize=16)
def cone(segments: int = CONE_SEGMENTS) -> Mesh:
    """Return a cone with its tip at the origin, pointing along +z, and a closed base of radius 1 at z = -1."""
    around = circle(segments)
    base = np.zeros((segments, 3))
    base[:, :2], base[:, 2] = around, -1.0
    side_normals = np.zeros((segments, 3))
    side_normals[:, :2], side_normals[:, 2] = around, 1.0
    side_normals *= math.sqrt(0.5)
    # The tip has one vertex per side, with the normal of the side's middle. A shared vertex would be shaded as a star.
    tip_normals = side_normals + np.roll(side_normals, -1, axis=0)
    tip_normals /= np.linalg.norm(tip_normals, axis=1, keepdims=True)
    positions = np.concatenate((base, np.zeros((segments, 3)), base, [(0.0, 0.0, -1.0)]))
    normals = np.concatenate((side_normals, tip_normals, np.tile((0.0, 0.0, -1.0), (segments + 1, 1))))
    ring = np.arange(segments)
    sides = np.stack((ring, np.roll(ring, -1), ring + segments), axis=1)
    triangles = np.concatenate((sides, fan(3 * segments, ring + 2 * segments, up=False)))
    return frozen_mesh(positions, triangles, normals)
